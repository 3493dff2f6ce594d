"""Engine 2 for any composition: Runge-Kutta of order 8 over the same component equations, with located events.

It takes what the exact engine cannot: loss tables of several rows, quadratic torques, whatever a component makes of the
present state. Components that are not affine are asked anew at every instant; a mode ends where one of its
inequalities becomes negative, found on the step's interpolant and then integrated to. Robot axes go the fast way of
`sim.chain`; this one is for reach, not for speed.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

from sim.affine_mode import combined, compile_mode, equations, solve_unknowns
from sim.affine_search import (
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
from sim.affine_system import Array, Mode, System
from sim.component import STUCK
from sim.errors import RunError
from sim.trajectory import Channels, Event, Trajectory
from sim.verification import Residual, Verifier, check_finite, instants

RELATIVE_TOLERANCE = 1e-11
LONGEST_STEP_S = 0.02
CHECKS = 8
"""Points within a step at which inequalities are looked at."""
MOST_EVENTS_AT_ONCE = 50
MOST_STEPS = 2000


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
        self.rate = sample_rate_hz
        self.end = (samples - 1) / sample_rate_hz
        self.moving = 2 * system.freedom
        self.run_ = _Run(np.empty((samples, system.state_width)))
        self.scale = np.zeros(system.state_width)
        self.key: Key = ()
        self.laws: dict[Key, Law] = {}
        self._pieces_from = 0.0
        self._pieces = np.zeros(system.signal_width)

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
        self._pieces_from = time
        self._pieces = self.system.signal_values(np.array([time]))[0]

    def _full(self, time: float, moving: Array) -> Array:
        """The whole state: angles and speeds, signals at `time` by their pieces, one."""
        x = np.empty(self.system.state_width)
        x[: self.moving] = moving
        values, elapsed = self._pieces.tolist(), time - self._pieces_from
        for signal, (_, swing) in zip(self.system.signals, self.system.signal_columns, strict=True):
            column, w, d = swing - 2 * self.system.node_count, signal.omega, signal.damping
            s, r = values[column : column + 2]
            if w == 0:
                values[column] = s + r * elapsed
            else:
                left = math.exp(-d * elapsed)
                c, n, b = left * math.cos(w * elapsed), left * math.sin(w * elapsed), (r + d * s) / w
                values[column : column + 2] = s * c + b * n, r * c - (d * b + w * s) * n
        x[self.moving : -1] = values
        x[-1] = 1.0
        return x

    def _next_stop(self, time: float) -> float:
        stops = [signal.breakpoints(time, self.end) for signal in self.system.signals]
        later = np.concatenate([*stops, [self.end]])
        later = later[later > time + 1e-15]
        return float(later.min(initial=self.end))

    def _at(self, x: Array) -> None:
        self.system.point = self.system.to_known @ x

    def _accelerations(self, time: float, moving: Array) -> Array:
        x = self._full(time, moving)
        count = self.system.freedom
        z = self.law.unknowns(x)
        return np.concatenate([moving[count:], self.system.coordinates @ z[: self.system.node_count]])

    # ---- modes ------------------------------------------------------------------------------------------------

    def _begin(self) -> Array:
        x = self.system.start()
        self.scale = sizes(self.system, x)
        self._set_pieces(0.0)
        self._at(x)
        allowed = possible_branches(self.system, x, self.scale)
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
        self.key = key
        if key not in self.laws:
            self.laws[key] = Law(self.system, key)
        self.law = self.laws[key]

    def _enter(self, key: Key, x: Array) -> Array | None:
        """The state after entering a mode at x, or None if it does not hold there."""
        mode = compile_mode(self.system, key)
        if not self._resting(mode, x):
            return None
        entered: Array = mode.enter @ x
        return entered if first_broken(mode, entered, self.scale) < 0 else None

    def _resting(self, mode: Mode, x: Array) -> bool:
        """Whether all is zero that has to be in the mode."""
        return bool(np.all(np.abs(mode.stops @ x) <= 1e-9 * (np.abs(mode.stops) @ self.scale) + 1e-12))

    def _broken(self, x: Array) -> frozenset[int] | None:
        """Owners of what does not hold after a signal's breakpoint, or None."""
        self._at(x)
        mode = compile_mode(self.system, self.key)
        row = first_broken(mode, x, self.scale)
        if row < 0 and not self._resting(mode, x):
            row = len(mode.holds.owners)
        return None if row < 0 else mode.holds.owner(row)

    def _switch(self, time: float, x: Array, owners: frozenset[int]) -> Array:
        from sim import affine_kernel as kernel

        self._at(x)
        mode = compile_mode(self.system, self.key)
        kernel.enlarge(x, self.scale, mode.matrix, self.moving, mode.rate)
        allowed = possible_branches(self.system, x, self.scale)
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
        solver = self._solver(time, x, bound)
        steps = 0
        while solver.status == "running":
            message = solver.step()
            steps += 1
            if steps > MOST_STEPS and solver.t - time < steps * 1e-9:
                raise RunError(
                    f"the motion at {solver.t:.9g} s needs steps below a nanosecond; is a torque not continuous?"
                )
            if message is not None:
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

    def _solver(self, time: float, x: Array, bound: float) -> DOP853:
        scale = np.maximum(self.scale[: self.moving], 1e-6)
        return DOP853(
            self._accelerations,  # type: ignore[arg-type]
            time,
            x[: self.moving],
            bound,
            max_step=LONGEST_STEP_S,
            rtol=RELATIVE_TOLERANCE,
            atol=RELATIVE_TOLERANCE * 1e-2 * scale,  # type: ignore[arg-type]
        )

    def _corrected(
        self, dense: Callable[[float], Array], old: float, new: float, when: float, row: int
    ) -> tuple[float, Array]:
        """The instant of an event and the state there to the order of the steps, not of the interpolant."""
        begin = dense(old)
        x = self._full(when, self._precisely(old, begin, when))
        width = 1e-3 * (new - old)
        for _ in range(3):
            value = self.law.margins(x)[row]
            ahead = self.law.margins(self._full(when + width, dense(when + width)))[row]
            behind = self.law.margins(self._full(when - width, dense(when - width)))[row]
            if ahead == behind or abs(value) <= 1e-15 * max(abs(ahead), abs(behind)):
                break
            when = float(np.clip(when - value * 2 * width / (ahead - behind), old, new))
            x = self._full(when, self._precisely(old, begin, when))
        return when, x

    def _precisely(self, begin: float, moving: Array, end: float) -> Array:
        """Integrate to `end` by steps of its own: the interpolant is of lower order than the steps."""
        if end - begin < 1e-13:
            return moving
        solver = self._solver(begin, self._full(begin, moving), end)
        while solver.status == "running":
            solver.step()
        return np.asarray(solver.y)

    def _first_break(self, dense: Callable[[float], Array], old: float, new: float) -> tuple[float, int | None]:
        """First instant of a step at which an inequality becomes negative, and which; the step's end and None."""

        def margin(row: int, time: float) -> float:
            return float(self.law.margins(self._full(time, dense(time)))[row])

        times = np.linspace(old, new, CHECKS + 1)
        before = self.law.margins(self._full(old, dense(old)))
        for low, high in pairwise(times):
            x = self._full(high, dense(high))
            after = self.law.margins(x)
            least = self.law.negligible(np.maximum(self.scale, np.abs(x)))
            found = [
                (brentq(partial(margin, row), low, high, xtol=1e-15, rtol=1e-14) if before[row] > 0 else low, row)
                for row in np.flatnonzero(after < -least)
            ]
            if found:
                when, row = min(found)
                return float(when), int(row)
            before = after
        return new, None

    # ---- samples ----------------------------------------------------------------------------------------------

    def _sample(self, time: float, x: Array) -> None:
        """Take the state at `time` if a sample stands there."""
        i = round(time * self.rate)
        if abs(i - time * self.rate) < 1e-9 and i < len(self.run_.states):
            self._put(i, x)

    def _sample_within(self, dense: Callable[[float], Array], old: float, new: float) -> None:
        first, last = int(np.ceil(old * self.rate - 1e-9)), int(np.floor(new * self.rate + 1e-9))
        for i in range(max(first, len(self.run_.keys)), min(last + 1, len(self.run_.states))):
            time = i / self.rate
            self._put(i, self._full(time, dense(time)))

    def _put(self, i: int, x: Array) -> None:
        self.run_.states[i] = x
        del self.run_.keys[i:]
        self.run_.keys.append(self.key)


class Law:
    """The equations of one mode; components that are not affine are asked for theirs at each state."""

    def __init__(self, system: System, key: Key) -> None:
        self.system, self.key = system, key
        mode = compile_mode(system, key)
        self._bent = [i for i, branch in enumerate(key) if system.bent(i, branch)]
        self.mode = None if self._bent else mode
        self._regular = mode.regular
        self._limits = np.zeros((0, system.width))
        self._places: list[tuple[int, slice]] = []
        self._straight = equations(system, key, [i for i in range(len(key)) if i not in self._bent])
        if self._regular and self.mode is None:
            self._reduce()

    def _reduce(self) -> None:
        """Solve once for all what does not change: z = base x + ways c, with c from the rows that do."""
        system, known = self.system, self.system.known
        pieces = [system.piece(i, self.key[i]) for i in self._bent]
        self._nodes = sorted({node for piece in pieces for node in piece.nodes})
        kept = np.delete(self._straight, self._nodes, axis=0)
        unknown = kept[:, known:]
        scale, columns = np.abs(unknown).max(axis=1, keepdims=True), np.abs(unknown).max(axis=0)
        columns[columns == 0] = 1.0  # of what stands in changing rows alone
        left, size, right = np.linalg.svd(unknown / scale / columns)
        self._ways = right[len(size) :].T / columns[:, None]
        solved = (right[: len(size)].T / size) @ left[:, : len(size)].T / columns[:, None]
        self._base = -solved @ (system.state_rows(kept) / scale)

    def _changing(self) -> Array:
        """The rows that change with the state: balances of the nodes that bent components touch, and their laws."""
        balances = self._straight[self._nodes]
        laws = [balances]
        for i in self._bent:
            piece = self.system.piece(i, self.key[i])
            for node, torque in zip(piece.nodes, piece.torques, strict=True):
                balances[self._nodes.index(node)] += torque
            laws.append(piece.equations)
        return np.concatenate(laws)

    def unknowns(self, x: Array) -> Array:
        """Accelerations and torques at x, shape (unknowns,)."""
        if self.mode is not None:
            return np.asarray(self.mode.solve @ x)
        system, known = self.system, self.system.known
        system.point = system.to_known @ x
        if not self._regular:
            losses = np.vstack([system.piece(i, branch).losses for i, branch in enumerate(self.key)])
            rows = combined(system, self._straight, self.key, self._bent)
            return np.asarray(solve_unknowns(system, rows, losses)[0] @ x)
        rows, z = self._changing(), self._base @ x
        choice = np.linalg.solve(rows[:, known:] @ self._ways, -rows[:, :known] @ system.point - rows[:, known:] @ z)
        return np.asarray(z + self._ways @ choice)

    def _inequalities(self) -> Array:
        """All inequalities as rows over (y, z); those of bent components are asked for anew."""
        if not len(self._limits):
            self._limits = np.vstack([self.system.piece(i, branch).holds for i, branch in enumerate(self.key)])
            counts = [len(self.system.piece(i, branch).holds) for i, branch in enumerate(self.key)]
            self._places = [(i, slice(sum(counts[:i]), sum(counts[: i + 1]))) for i in self._bent]
        for i, place in self._places:
            self._limits[place] = self.system.piece(i, self.key[i]).holds
        return self._limits

    def margins(self, x: Array) -> Array:
        """Values of all inequalities at x."""
        if self.mode is not None:
            return np.asarray(self.mode.holds.rows @ x)
        if not self._regular:
            self.system.point = self.system.to_known @ x
            return np.asarray(compile_mode(self.system, self.key).holds.rows @ x)
        z = self.unknowns(x)
        self._limits = self._inequalities()
        return np.asarray(self._limits @ np.concatenate([self.system.point, z]))

    def negligible(self, scale: Array) -> Array:
        """How far below zero each inequality may be by rounding, the state being at most `scale`."""
        if self.mode is not None:
            rows = self.mode.holds.rows
        elif self._regular:
            rows = self.system.state_rows(self._limits)
        else:
            rows = compile_mode(self.system, self.key).holds.rows
        return np.asarray(1e-12 * (np.abs(rows) @ scale))

    def owners(self, x: Array) -> list[frozenset[int]]:
        """Components that each inequality belongs to."""
        if self.mode is None and self._regular:
            branches = [self.system.piece(i, branch).holds for i, branch in enumerate(self.key)]
            return [frozenset([i]) for i, holds in enumerate(branches) for _ in holds]
        self.system.point = self.system.to_known @ x
        return list(compile_mode(self.system, self.key).holds.owners)


def first_broken(mode: Mode, x: Array, scale: Array) -> int:
    """First inequality that does not hold from x on (its value, else its first derivative that is not zero), or -1."""
    from sim import affine_kernel as kernel

    rows = np.ascontiguousarray(mode.holds.rows)
    derivatives = np.zeros((kernel.DERIVATIVES, len(rows), len(x)))
    kernel.differentiate(np.ascontiguousarray(mode.matrix), rows, derivatives)
    return int(kernel.holding(x, scale, derivatives, mode.holds.strict, len(rows)))


def simulate_runge_kutta(system: System, samples: int, sample_rate_hz: float) -> Trajectory:
    """Simulate with this engine; parameters and errors as of `sim.solver.simulate`."""
    run = RungeKutta(system, samples, sample_rate_hz).run()
    reader = _Reader(system, run)
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
    """Computes all channels of all samples when the first one is read."""

    def __init__(self, system: System, run: _Run) -> None:
        from sim.solver import channel_units

        self._system, self._run = system, run
        self._values: dict[str, Array] = {}
        self.units: Mapping[str, str] = channel_units(system)
        self.sources: dict[str, Callable[[], NDArray[np.float64]]] = {
            name: partial(self._read, name) for name in self.units
        }

    def _read(self, name: str) -> Array:
        if not self._values:
            self._values = {key: np.empty(len(self._run.states)) for key in self.units}
            laws = {key: Law(self._system, key) for key in set(self._run.keys)}
            for i, (x, key) in enumerate(zip(self._run.states, self._run.keys, strict=True)):
                z = laws[key].unknowns(x)
                self._system.point = self._system.to_known @ x
                for channel, value in self._channels(key, np.concatenate([self._system.point, z])):
                    self._values[channel][i] = value
        return self._values[name]

    def _channels(self, key: Key, variables: Array) -> Iterator[tuple[str, float]]:
        for i, branch_number in enumerate(key):
            branch = self._system.piece(i, branch_number).branch
            name = self._system.names[i]
            for channel, row in branch.channels.items():
                yield f"{name}.{channel}", float(row @ variables)
            for channel, (one, other) in branch.powers.items():
                yield f"{name}.{channel}", float((one @ variables) * (other @ variables))
            if branch.mode is not None:
                yield f"{name}.mode", float(branch.mode)
