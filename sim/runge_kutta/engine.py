"""Engine 2 for any composition: Runge-Kutta of order 8 over the same component equations, with located events.

It takes what the exact engine cannot: loss tables of several rows, quadratic torques, whatever is a curve over the
present state (`sim.rotational.curves`). A mode is linear but for its curves: what does not depend on them is solved
once, the rest and the steps are compiled (`sim.runge_kutta.kernel`). A mode ends where one of its inequalities becomes
negative, found on the step's interpolant and then integrated to.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from sim.errors import RunError
from sim.piecewise_affine import kernel as affine_kernel
from sim.piecewise_affine.channels import channel_names, channel_units
from sim.piecewise_affine.guard import Guards
from sim.piecewise_affine.mode import compile_mode
from sim.piecewise_affine.mode_search import (
    NO_START,
    Key,
    broken_away,
    changes,
    combinations_near,
    describe_modes,
    first_combinations,
    named_change,
    possible_branches,
    sizes,
)
from sim.piecewise_affine.system import Array, Mode, System
from sim.rotational.component import STUCK
from sim.rotational.trajectory import Channels, Event, Residual, Trajectory
from sim.runge_kutta import kernel
from sim.runge_kutta.law import Law, Signals
from sim.runge_kutta.steps import CompiledSteps, Steps
from sim.verification import Verifier, check_finite, instants

CHECKS = 8
"""Points within a step at which inequalities are looked at."""
MOST_EVENTS_AT_ONCE = 50
MOST_STEPS = 2000
ROUNDING = 1e-12
"""How far below zero an inequality may be, relative to its terms."""
Dense = Callable[[float | Array], Array]


@dataclass
class _Run:
    """Samples so far, and the mode of each."""

    states: Array
    keys: list[Key] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)


class RungeKutta:
    """One simulation: integrates angles and speeds; the signals are known in closed form between their breakpoints."""

    def __init__(self, system: System, samples: int, sample_rate_hz: float) -> None:
        self.system = system
        self.guards = Guards(system)
        self.rate = sample_rate_hz
        self.end = (samples - 1) / sample_rate_hz
        self.moving = 2 * system.freedom
        self.run_ = _Run(np.empty((samples, system.state_width)))
        self.scale = np.zeros(system.state_width)
        self.key: Key = ()
        self.laws: dict[Key, Law] = {}
        columns = [swing - 2 * system.node_count for _, swing in system.signal_columns]
        self._swings = (
            np.array(columns, np.int64),
            np.array([(s.omega, s.damping) for s in system.signals]).reshape(-1, 2),
        )
        self._set_pieces(0.0)

    def run(self) -> _Run:
        """Integrate to the end.

        Raises
        ------
        RunError
            when no mode continues, or events storm without time passing.
        """
        x, time = self._begin(), 0.0
        at_once = 0
        while time < self.end:
            bound = self._next_stop(time)
            new_time, x, broken = self._segment(time, x, bound)
            at_once = at_once + 1 if new_time - time < 1e-12 else 0
            if at_once > MOST_EVENTS_AT_ONCE:
                raise RunError(f"events storm at {time:.9g} s: {describe_modes(self.system, self.key)}")
            time = new_time
            if time == bound:
                self._set_pieces(time)
                x = self._full(time, x[: self.moving])
                broken = self._broken(x) if broken is None else broken
            if broken is not None:
                x = self._switch(time, x, broken)
            self._sample(time, x)
        return self.run_

    # ---- the state --------------------------------------------------------------------------------------------

    def _set_pieces(self, time: float) -> None:
        self._began = time
        self._signals: Signals = (*self._swings, self.system.signal_values(np.array([time]))[0])

    def _full(self, time: float, moving: Array) -> Array:
        """The whole state: angles and speeds, signals at `time` by their pieces, one."""
        x = np.empty(self.system.state_width)
        kernel.full(moving, time - self._began, self._signals, x)
        return x

    def _next_stop(self, time: float) -> float:
        stops = [signal.breakpoints(time, self.end) for signal in self.system.signals]
        later = np.concatenate([*stops, [self.end]])
        later = later[later > time + 1e-15]
        return float(later.min(initial=self.end))

    def _at(self, x: Array) -> None:
        self.system.point = self.system.to_known @ x

    # ---- modes ------------------------------------------------------------------------------------------------

    def _begin(self) -> Array:
        x = self.system.start()
        self.scale = sizes(self.system, x)
        self._set_pieces(0.0)
        self._at(x)
        allowed = possible_branches(self.system, self.guards, x, self.scale)
        for key in first_combinations(self.system, allowed):
            entered = self._enter(key, x)
            if entered is not None:
                self._take(key)
                away = broken_away(self.system, key, allowed)
                self.run_.events += [Event(0.0, *named_change(self.system, i, STUCK, to)) for i, to in away]
                self._sample(0.0, entered)
                return entered
        raise RunError(NO_START)

    def _take(self, key: Key) -> None:
        self.key, self.law = key, self._law(key)

    def _law(self, key: Key) -> Law:
        if key not in self.laws:
            self.laws[key] = Law(self.system, key)
        return self.laws[key]

    def _enter(self, key: Key, x: Array) -> Array | None:
        """The state after entering a mode at x, or None if it does not hold there."""
        mode = self._law(key).at(x)
        if not self._resting(mode, x):
            return None
        entered: Array = mode.enter @ x
        return entered if first_broken(mode, entered, self.scale) < 0 else None

    def _resting(self, mode: Mode, x: Array) -> bool:
        """Whether all is zero that has to be in the mode."""
        return bool(np.all(np.abs(mode.stops @ x) <= 1e-9 * (np.abs(mode.stops) @ self.scale) + 1e-12))

    def _broken(self, x: Array) -> frozenset[int] | None:
        """Owners of what does not hold after a signal's breakpoint, or None."""
        mode = self.law.at(x)
        row = first_broken(mode, x, self.scale)
        if row < 0 and not self._resting(mode, x):
            row = len(mode.holds.owners)
        return None if row < 0 else mode.holds.owner(row)

    def _switch(self, time: float, x: Array, owners: frozenset[int]) -> Array:
        self._at(x)
        mode = self.law.at(x)
        affine_kernel.enlarge(x, self.scale, mode.matrix, self.moving, mode.rate)
        allowed = possible_branches(self.system, self.guards, x, self.scale)
        for key in combinations_near(self.system, self.key, owners, allowed):
            entered = self._enter(key, x)
            if entered is not None:
                self.run_.events += [Event(time, *change) for change in changes(self.system, self.key, key)]
                self._take(key)
                return entered
        raise RunError(f"no mode continues at {time:.9g} s after {describe_modes(self.system, self.key)}")

    # ---- time -------------------------------------------------------------------------------------------------

    def _segment(self, time: float, x: Array, bound: float) -> tuple[float, Array, frozenset[int] | None]:
        """Integrate until an inequality breaks or `bound`: time, state there, and whose inequality."""
        solver = self._solver(time, x[: self.moving], bound)
        steps = 0
        while solver.status == "running":
            message = solver.step()
            steps += 1
            if steps > MOST_STEPS and solver.t - time < steps * 1e-9:
                raise RunError(
                    f"the motion at {solver.t:.9g} s needs steps below a nanosecond; is a torque not continuous?"
                )
            if message is not None:
                self._ask_curves(solver.t, solver.y)
                raise RunError(f"the step size vanished at {solver.t:.9g} s: {message}")
            dense = solver.dense_output()
            old = solver.t_old if solver.t_old is not None else time
            when, row = self._first_break(dense, old, solver.t)
            self._sample_within(dense, old, when)
            self.scale[: self.moving] = np.maximum(self.scale[: self.moving], np.abs(solver.y))
            if row is not None:
                when, x = self._corrected(dense, old, solver.t, when, row)
                return when, x, self.law.owners(x)[row]
        return bound, self._full(bound, solver.y), None

    def _solver(self, time: float, moving: Array, bound: float) -> Steps:
        kind = Steps if self.law.reduced is None else CompiledSteps
        return kind(self.law, self._began, self._signals, time, moving, bound, self.scale[: self.moving])

    def _ask_curves(self, time: float, moving: Array) -> None:
        """Raise the error of a curve that is not above zero a step of the least size later."""
        rate = self.law.rate(moving, time - self._began, self._signals)
        ahead = moving + 1e-12 * max(time, 1.0) * rate
        self._at(self._full(time, ahead))
        for i in self.law.bent:
            self.system.piece(i, self.key[i])

    def _margins(self, time: float, moving: Array) -> tuple[Array, Array]:
        """The whole state and the values of all inequalities."""
        found = self.law.margins(moving[None], np.array([time - self._began]), self.scale, self._signals)
        return found[0][0], found[1][0]

    def _corrected(self, dense: Dense, old: float, new: float, when: float, row: int) -> tuple[float, Array]:
        """The instant of an event and the state there to the order of the steps, not of the interpolant."""
        begin = dense(old)
        x, values = self._margins(when, self._precisely(old, begin, when))
        width = 1e-3 * (new - old)
        for _ in range(3):
            value = values[row]
            ahead, behind = (self._margins(at, dense(at))[1][row] for at in (when + width, when - width))
            if ahead == behind or abs(value) <= 1e-15 * max(abs(ahead), abs(behind)):
                break
            when = float(np.clip(when - value * 2 * width / (ahead - behind), old, new))
            x, values = self._margins(when, self._precisely(old, begin, when))
        return when, x

    def _precisely(self, begin: float, moving: Array, end: float) -> Array:
        """Integrate to `end` by steps of its own: the interpolant is of lower order than the steps."""
        if end - begin < 1e-13:
            return moving
        solver = self._solver(begin, moving, end)
        while solver.status == "running":
            solver.step()
        return np.asarray(solver.y)

    def _first_break(self, dense: Dense, old: float, new: float) -> tuple[float, int | None]:
        """First instant of a step at which an inequality becomes negative, and which; the step's end and None."""

        def margin(row: int, time: float) -> float:
            return float(self._margins(time, dense(time))[1][row])

        times = np.linspace(old, new, CHECKS + 1)
        moving = np.ascontiguousarray(np.asarray(dense(times)).T)
        _, values, sizes = self.law.margins(moving, times - self._began, self.scale, self._signals)
        for k in np.flatnonzero((values[1:] < -ROUNDING * sizes[1:]).any(axis=1)):
            low, high = times[k : k + 2]
            found = [
                (brentq(partial(margin, row), low, high, xtol=1e-15, rtol=1e-14) if values[k, row] > 0 else low, row)
                for row in np.flatnonzero(values[k + 1] < -ROUNDING * sizes[k + 1])
            ]
            when, row = min(found)
            return float(when), int(row)
        return new, None

    # ---- samples ----------------------------------------------------------------------------------------------

    def _sample(self, time: float, x: Array) -> None:
        """Take the state at `time` if a sample stands there."""
        i = round(time * self.rate)
        if abs(i - time * self.rate) < 1e-9 and i < len(self.run_.states):
            self._put(i, x)

    def _sample_within(self, dense: Dense, old: float, new: float) -> None:
        first, last = int(np.ceil(old * self.rate - 1e-9)), int(np.floor(new * self.rate + 1e-9))
        numbers = range(max(first, len(self.run_.keys)), min(last + 1, len(self.run_.states)))
        if numbers:
            times = np.array(numbers) / self.rate
            for i, time, moving in zip(numbers, times.tolist(), np.ascontiguousarray(dense(times).T), strict=True):
                self._put(i, self._full(time, moving))

    def _put(self, i: int, x: Array) -> None:
        self.run_.states[i] = x
        del self.run_.keys[i:]
        self.run_.keys.append(self.key)


def first_broken(mode: Mode, x: Array, scale: Array) -> int:
    """First inequality that does not hold from x on (its value, else its first derivative that is not zero), or -1."""
    rows = np.ascontiguousarray(mode.holds.rows)
    derivatives = np.zeros((affine_kernel.DERIVATIVES, len(rows), len(x)))
    affine_kernel.differentiate(np.ascontiguousarray(mode.matrix), rows, derivatives)
    return int(affine_kernel.holding(x, scale, derivatives, mode.holds.strict, len(rows)))


def simulate_runge_kutta(system: System, samples: int, sample_rate_hz: float) -> Trajectory:
    """Simulate with this engine; parameters and errors as of `sim.solver.simulate`."""
    engine = RungeKutta(system, samples, sample_rate_hz)
    run = engine.run()
    reader = _Reader(system, run, engine.laws)
    time = np.arange(samples) / sample_rate_hz
    residual = _verify(system, run, time)
    return Trajectory(time, Channels(reader.sources), reader.units, tuple(run.events), "runge-kutta", residual)


def _verify(system: System, run: _Run, time: Array) -> Residual:
    """Look at equations, limits and prescribed motion; flow and energy are left to the steps' own error control."""
    h = float(time[-1]) / max(len(time) - 1, 1)
    verifier = Verifier(system, h)
    check_finite(time, run.states, verifier.coordinate)
    at = instants(len(time))
    motion = verifier.motion(time[at], run.states[at])
    equations = limits = 0.0
    after = np.zeros((1, 2 * system.freedom))
    for i in at.tolist():
        system.point = system.to_known @ run.states[i]
        one = Verifier(system, h)
        mode = compile_mode(system, run.keys[i])
        found = one.laws(
            [mode], np.zeros(1, np.int32), time[i : i + 1], run.states[i : i + 1], after, np.zeros(1, np.bool_)
        )
        equations, limits = max(equations, found[0]), max(limits, found[1])
    return Residual(equations, limits, motion)


class _Reader:
    """Computes each channel of all samples when it is asked for."""

    def __init__(self, system: System, run: _Run, laws: Mapping[Key, Law]) -> None:
        self._system, self._run = system, run
        self._laws = {key: laws[key] for key in dict.fromkeys(run.keys)}
        numbers = {key: i for i, key in enumerate(self._laws)}
        self._key = np.array([numbers[key] for key in run.keys])
        self.units: Mapping[str, str] = channel_units(system)
        self.sources: dict[str, Callable[[], NDArray[np.float64]]] = {
            f"{name}.{channel}": partial(self._read, i, channel)
            for i, name in enumerate(system.names)
            for channel in channel_names(system, i)
        }

    @cached_property
    def _variables(self) -> list[tuple[NDArray[np.int64], Array, Array]]:
        """Of each mode, where its samples are, their states, and all variables there."""
        out = []
        for number, law in enumerate(self._laws.values()):
            at = np.flatnonzero(self._key == number)
            x = self._run.states[at]
            out.append((at, x, np.hstack([x @ self._system.to_known.T, law.unknowns(x)])))
        return out

    def _read(self, i: int, channel: str) -> Array:
        out = np.empty(len(self._run.states))
        for law, (at, x, variables) in zip(self._laws.values(), self._variables, strict=True):
            branches = [piece.branch for piece in self._system.uncurved(i, law.key[i])]
            if channel == "mode":
                out[at] = 0 if branches[0].mode is None else branches[0].mode
            elif channel in branches[0].channels:
                out[at] = law.channel(i, [branch.channels[channel] for branch in branches], x, variables)
            else:
                pairs = zip(*(branch.powers[channel] for branch in branches), strict=True)
                one, other = (law.channel(i, list(rows), x, variables) for rows in pairs)
                out[at] = one * other
        return out
