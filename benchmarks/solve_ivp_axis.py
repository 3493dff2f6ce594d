"""The paper's axis as one would write it for solve_ivp or CVODE: right-hand side, event functions, restart loop.

Motor inertia with torque A sin(2 pi f t), gear of ratio 100 (mesh efficiency and bearing friction by Modelica's
LossyGear), stiffness with backlash and damping by Modelica's ElastoBacklash, load inertia. States: motor angle and
speed, twist and its rate.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Piece = tuple[Array, tuple[float, Array, int] | None]
"""States at the samples that were reached, and the event that ended it: time, state, which."""
RATIO = 100.0


@dataclass(frozen=True)
class Case:
    """Parameters of one run, SI units."""

    load_inertia: float
    damping: float
    backlash: float
    amplitude: float = 12.0
    frequency: float = 0.45
    motor_inertia: float = 0.6
    stiffness: float = 1e5
    efficiency: float = 0.9
    bearing: float = 0.9


class SolveIvpAxis:
    """Mode machine around solve_ivp: the gear sticks, or rolls one way."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.direction = 0

    def torque(self, t: float) -> float:
        return self.case.amplitude * math.sin(2 * math.pi * self.case.frequency * t)

    def mesh(self, twist: float, rate: float) -> float:
        case = self.case
        if case.backlash == 0:
            return case.stiffness * twist + case.damping * rate
        side = 1.0 if twist > 0 else -1.0
        spring = case.stiffness * (side * twist - case.backlash / 2)
        damper = case.damping * side * rate
        return 0.0 if spring <= 0 or spring + damper <= 0 else side * (spring + min(spring, damper))

    def gear(self, load: float) -> float:
        """Torque into the rolling gear, by who drives."""
        case, way = self.case, self.direction
        driven = (way * load + case.bearing) / case.efficiency
        return way * (driven if driven >= 0 else case.efficiency * (way * load + case.bearing))

    def rates(self, t: float, y: Array) -> list[float]:
        case = self.case
        tau = self.mesh(y[2], y[3])
        a = 0.0 if self.direction == 0 else (self.torque(t) - self.gear(-tau / RATIO)) / case.motor_inertia
        return [y[1], a, y[3], -tau / case.load_inertia - a / RATIO]

    def margins(self, t: float, y: Array) -> tuple[float, float]:
        """How far the sticking gear is from rolling forward and backward [N.m]."""
        eta, bearing, torque = self.case.efficiency, self.case.bearing, self.torque(t)
        loss = torque + self.mesh(y[2], y[3]) / RATIO
        most = max((1 - eta) * torque, (1 - 1 / eta) * torque) + bearing
        least = min((1 - eta) * torque, (1 - 1 / eta) * torque) - bearing
        return most - loss, loss - least

    def events(self, y: Array) -> list[Callable[[float, Array], float]]:
        """Functions that are zero where the mode changes; the mesh's torque itself does not depend on the mode.

        solve_ivp misses a contact that opens and closes within one step; so nothing but the restart depends on it.
        """
        found: list[Callable[[float, Array], float]] = []
        if self.direction:
            found.append(_terminal(lambda t, y: y[1], -self.direction))
        else:
            found.append(_terminal(lambda t, y: self.margins(t, y)[0], -1))
            found.append(_terminal(lambda t, y: self.margins(t, y)[1], -1))
        for edge in (self.case.backlash / 2, -self.case.backlash / 2) if self.case.backlash else ():
            above = y[3] >= 0 if abs(y[2] - edge) < 1e-12 else y[2] > edge
            found.append(_terminal(lambda t, y, edge=edge: y[2] - edge, -1 if above else 1))
        return found

    def switch(self, t: float, y: Array, which: int) -> None:
        """Change the mode after event number `which`."""
        if which >= (1 if self.direction else 2):
            return
        if self.direction:
            y[1] = 0.0
            self.direction = 0
            forward, backward = self.margins(t, y)
            self.direction = 1 if forward < 0 else -1 if backward < 0 else 0
        else:
            self.direction = 1 if which == 0 else -1

    def run(self, duration: float, rate: float, method: str, rtol: float, atol: float) -> Array:
        """States at the samples, shape (n, 4)."""
        grid = np.arange(round(duration * rate) + 1) / rate
        out = np.zeros((len(grid), 4))
        t, y, done = 0.0, np.zeros(4), 1
        solve = self._cvode if method.startswith("CVODE") else self._solve_ivp
        while t < duration and done < len(grid):
            states, event = solve(t, y, grid[done:], method, rtol, atol)
            out[done : done + len(states)] = states
            done += len(states)
            if event is None:
                break
            t, y, which = event
            self.switch(t, y, which)
        return out

    def _solve_ivp(self, t: float, y: Array, grid: Array, method: str, rtol: float, atol: float) -> Piece:
        events = self.events(y)
        found = solve_ivp(self.rates, (t, grid[-1]), y, method=method, rtol=rtol, atol=atol, events=events, t_eval=grid)
        if found.status != 1:
            return found.y.T, None
        which = next(i for i, times in enumerate(found.t_events) if len(times))
        return found.y.T, (float(found.t_events[which][-1]), found.y_events[which][-1].copy(), which)

    def _cvode(self, t: float, y: Array, grid: Array, method: str, rtol: float, atol: float) -> Piece:
        """The same with SUNDIALS' CVODE, by its wheel scikit-sundae; `method` is `CVODE Adams` or `CVODE BDF`."""
        from sksundae.cvode import CVODE

        events = self.events(y)

        def rates(t: float, y: Array, out: Array) -> None:
            out[:] = self.rates(t, y)

        def margins(t: float, y: Array, out: Array) -> None:
            out[:] = [event(t, y) for event in events]

        margins.terminal = [True] * len(events)  # type: ignore[attr-defined]
        margins.direction = [event.direction for event in events]  # type: ignore[attr-defined]
        solver = CVODE(
            rates, method=method.split()[1], rtol=rtol, atol=atol, eventsfn=margins, num_events=len(events),
            max_num_steps=100_000,
        )  # fmt: skip
        found = solver.solve(np.concatenate([[t], grid]), y)
        if found.t_events is None or not len(found.t_events):
            return found.y[1:], None
        which = int(np.flatnonzero(found.i_events[-1])[0])
        reached = np.searchsorted(grid, found.t_events[-1], side="right")
        return found.y[1 : 1 + reached], (float(found.t_events[-1]), np.array(found.y_events[-1]), which)


def _terminal(function: Callable[[float, Array], float], direction: int) -> Callable[[float, Array], float]:
    function.terminal = True  # type: ignore[attr-defined]
    function.direction = direction  # type: ignore[attr-defined]
    return function
