"""The exact engine: every mode is x' = M x, solved by its matrix exponential; mode changes are located in time.

What it costs does not depend on stiffness or accuracy, and the samples do not depend on the sample rate: between events
the solution is exact to rounding, and an event's instant is the root of an exact power series. A train whose motion
is chaotic (backlash with little damping, driven) is followed exactly too, but a rounding error grows like any other
disturbance there: see tests/sim/test_solver.py.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunError
from sim.piecewise_affine import kernel
from sim.piecewise_affine.mode import compile_mode
from sim.piecewise_affine.mode_search import (
    NO_START,
    Change,
    Guard,
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
from sim.piecewise_affine.verification import Verifier
from sim.rotational.component import STUCK
from sim.rotational.trajectory import Event

RESEED_SAMPLES = 1024
"""Every so many samples sinusoids are set to their true values again; until then rounding adds up to 1e-13 of them."""
LARGEST_ANGLE = 0.7
"""Largest eigenvalue times step up to which the power series is exact to rounding."""
LOG_ROWS = 4096


@dataclass
class Run:
    """Samples: angles and speeds, shape (n, 2 freedom), the number of the mode of each; mode changes.

    A change is (time, old mode, new mode); the old mode -1 - i means component i at rest before the start.
    """

    states: Array
    modes: NDArray[np.int32]
    change_times: Array
    changes: NDArray[np.int64]

    @property
    def visited(self) -> set[int]:
        """Numbers of all modes of the run."""
        return {int(self.modes[0]), *self.changes[self.changes[:, 0] >= 0, 1].tolist()}


class _Tables:
    """Arrays of all modes known so far, for the compiled loop; they grow as modes are met."""

    def __init__(self, width: int, rows: int, room: int = 16, follow: int = 4) -> None:
        self.rows, self.room, self.width = rows, room, width
        self.counts = np.zeros(room, np.int64)
        self.stop_counts = np.zeros(room, np.int64)
        self.derivatives = np.zeros((room, kernel.DERIVATIVES, rows, width))
        self.strict = np.zeros((room, rows), np.bool_)
        self.stops = np.zeros((room, rows, width))
        self.enter = np.zeros((room, width, width))
        self.follow = np.full((room, rows + 1, follow), -1, np.int64)
        self.matrices = np.zeros((room, width, width))
        self.steps = np.zeros((room, width, width))
        self.lengths = np.zeros(room)
        self.rates = np.zeros(room)
        self.products = np.zeros((room, width, kernel.CHUNK * (width + rows) + width))
        self.reaches = np.zeros((room, rows, width))

    def grown(self, room: int, rows: int, follow: int) -> "_Tables":
        """The same with room for more."""
        new = _Tables(self.width, rows, room, follow)
        for name, old in vars(self).items():
            if isinstance(old, np.ndarray):
                getattr(new, name)[tuple(map(slice, old.shape))] = old
        return new

    def fill(self, number: int, mode: Mode, h: float, moving: int) -> None:
        """Write a mode, of whose state the first `moving` are angles and speeds, for steps of `h`.

        `products` give, from x, the moving states after 1 .. CHUNK steps, then the signals after the last, then for
        each inequality its values after these steps. By `reaches` times |x| an inequality changes at most meanwhile: by
        the largest change of its coefficients, and between samples by their second difference.
        """
        holds, matrix, derivatives = mode.holds.rows, mode.matrix, self.derivatives[number]
        rows, width = holds.shape
        self.counts[number], self.stop_counts[number] = rows, len(mode.stops)
        self.strict[number, :rows] = mode.holds.strict
        self.stops[number, : len(mode.stops)] = mode.stops
        self.enter[number], self.matrices[number] = mode.enter, matrix
        self.lengths[number], self.rates[number] = h, mode.rate
        derivatives[0, :rows] = holds
        for k in range(1, kernel.DERIVATIVES):
            parts = derivatives[k - 1, :rows, :, None] * matrix
            total, size = parts.sum(axis=1), np.abs(parts).sum(axis=1)
            derivatives[k, :rows] = np.where(np.abs(total) > kernel.CANCELLED * size, total, 0.0)
        self.steps[number] = step = _exponential(matrix * h)
        powers = np.array(list(accumulate([step] * kernel.CHUNK, np.dot)))
        margins = np.concatenate([holds[None], holds @ powers])
        after = powers[:, :moving].reshape(-1, width), powers[-1, moving:-1]
        product = np.vstack([*after, np.moveaxis(margins[1:], 1, 0).reshape(-1, width)])
        self.products[number, :, : len(product)] = product.T
        bend = np.abs(np.diff(margins, 2, axis=0)).max(axis=0)
        self.reaches[number, :rows] = np.abs(margins[1:] - holds).max(axis=0) + bend

    @property
    def for_switch(self) -> tuple[NDArray[np.generic], ...]:
        return (self.counts, self.derivatives, self.strict, self.stops, self.stop_counts, self.enter, self.follow)


def _exponential(matrix: Array) -> Array:
    """Taylor series and squaring: the matrices are small, and scipy's own starts threads for them."""
    squarings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300)))) + 1)
    part = matrix / 2.0**squarings
    terms = accumulate(range(1, 20), lambda term, k: term @ part / k, initial=np.eye(len(matrix)))
    out = np.sum(list(terms), axis=0)
    for _ in range(squarings):
        out = out @ out
    return np.asarray(out)


class ExactEngine:
    """A drive train made ready for one sample rate; it learns modes as runs meet them and keeps them."""

    def __init__(self, system: System, sample_rate_hz: float) -> None:
        self.system = system
        self.guards = [Guard.of(system, i) for i in range(len(system.components))]
        self.h = 1.0 / sample_rate_hz
        self.verifier = Verifier(system, self.h)
        self.modes: list[Mode] = []
        self._numbers: dict[tuple[int, ...], int] = {}
        self._impossible: set[tuple[int, ...]] = set()
        self._tables = _Tables(system.state_width, 8)
        self._begun: tuple[int, Array, list[tuple[int, int]]] | None = None

    # ---- modes ------------------------------------------------------------------------------------------------

    def _number(self, key: tuple[int, ...]) -> int:
        """Number of the mode, compiled when first asked for; -1 if it can never hold."""
        if key in self._impossible:
            return -1
        if key not in self._numbers:
            mode = compile_mode(self.system, key)
            if np.any((np.abs(mode.holds.rows[:, :-1]).max(axis=1, initial=0) == 0) & (mode.holds.rows[:, -1] < 0)):
                self._impossible.add(key)
                return -1
            self._numbers[key] = self._store(mode)
        return self._numbers[key]

    def _store(self, mode: Mode) -> int:
        number, rows, tables = len(self.modes), len(mode.holds.rows), self._tables
        most = max(rows, len(mode.stops))
        if number >= tables.room or most > tables.rows:
            room = 2 * tables.room if number >= tables.room else tables.room
            tables = self._tables = tables.grown(room, max(tables.rows, most), tables.follow.shape[2])
        parts = max(1, int(np.ceil(mode.rate * self.h / LARGEST_ANGLE)))
        if parts > 1_000_000:
            raise RunError(f"a time constant of {1 / mode.rate:g} s is too short for a sample interval of {self.h:g} s")
        tables.fill(number, mode, self.h / parts, 2 * self.system.freedom)
        self.modes.append(mode)
        return number

    def _holds(self, number: int, x: Array, scale: Array) -> Array | None:
        """The state after entering the mode at x, or None if the mode does not hold there."""
        t = self._tables
        if not kernel.resting(x, scale, t.stops[number], t.stop_counts[number]):
            return None
        entered: Array = t.enter[number] @ x
        if kernel.holding(entered, scale, t.derivatives[number], t.strict[number], t.counts[number]) >= 0:
            return None
        return entered

    def begin(self, x: Array) -> tuple[int, Array, list[tuple[int, int]]]:
        """Return the mode at the start, the state in it, and (component, mode) of those that break away at once."""
        scale = sizes(self.system, x)
        allowed = possible_branches(self.system, self.guards, x, scale)
        for key in first_combinations(self.system, allowed):
            number = self._number(key)
            entered = self._holds(number, x, scale) if number >= 0 else None
            if entered is not None:
                return number, entered, broken_away(self.system, key, allowed)
        raise RunError(NO_START)

    def _learn(self, mode: int, row: int, x: Array, scale: Array) -> int:
        """Find the mode that follows when `row` of `mode` breaks at x; remember all that were looked at."""
        key = self.modes[mode].key
        owners = self.modes[mode].holds.owner(row)
        allowed = possible_branches(self.system, self.guards, x, scale)
        for new_key in combinations_near(self.system, key, owners, allowed):
            number = self._number(new_key)
            if number < 0:
                continue
            self._remember(mode, row, number)
            if self._holds(number, x, scale) is not None:
                return number
        return -1

    def _remember(self, mode: int, row: int, number: int) -> None:
        follow = self._tables.follow[mode, row]
        if number in follow:
            return
        if follow[-1] >= 0:
            t = self._tables
            self._tables = t.grown(t.room, t.rows, 2 * t.follow.shape[2])
            follow = self._tables.follow[mode, row]
        follow[int(np.argmax(follow < 0))] = number

    # ---- running ----------------------------------------------------------------------------------------------

    def run(self, samples: int) -> Run:
        """Return the samples 0 .. samples - 1.

        Raises
        ------
        RunError
            when no mode continues, or events storm without time passing.
        """
        if self._begun is None:
            self._begun = self.begin(self.system.start())
        mode, x, away = self._begun
        x = x.copy()
        states, modes = np.empty((samples, 2 * self.system.freedom)), np.empty(samples, np.int32)
        states[0], modes[0] = x[: states.shape[1]], mode
        when, what = self._advance(x, sizes(self.system, x), mode, states[1:], modes[1:])
        begun = np.array([[-1 - i, to] for i, to in away], np.int64).reshape(-1, 2)
        return Run(states, modes, np.concatenate([np.zeros(len(away)), when]), np.concatenate([begun, what]))

    def _advance(
        self, x: Array, scale: Array, mode: int, out: Array, modes: NDArray[np.int32]
    ) -> tuple[Array, NDArray[np.int64]]:
        """Fill the samples after the first, x being its state; return all changes of mode."""
        count = len(out)
        where, offsets, values = self._stops(count)
        state = np.array([0, mode, 0, 0, -1, 0, 0], np.int64)
        clock = np.zeros(1)
        times, changes = [], []
        log_where, log_modes = np.empty((LOG_ROWS, 2)), np.empty((LOG_ROWS, 2), np.int64)
        while True:
            t = self._tables
            status = kernel.advance(
                self.h, count, x, scale, state, clock, where, offsets, values,
                t.matrices, t.steps, t.lengths, t.rates, t.products, t.reaches, t.for_switch, out, modes,
                log_where, log_modes,
            )  # fmt: skip
            logged = int(state[kernel.LOGGED])
            if logged:
                times.append(log_where[:logged, 0] * self.h + log_where[:logged, 1])
                changes.append(log_modes[:logged].copy())
            state[kernel.LOGGED] = 0
            if status == kernel.DONE:
                when = np.concatenate(times) if times else np.empty(0)
                what = np.concatenate(changes) if changes else np.empty((0, 2), np.int64)
                return when, what
            now = state[kernel.SAMPLE] * self.h + clock[0]
            if status == kernel.STORM:
                key = self.modes[int(state[kernel.MODE])].key
                raise RunError(f"events storm at {now:.9g} s: {describe_modes(self.system, key)}")
            if status == kernel.ASK:
                old, row = int(state[kernel.MODE]), int(state[kernel.ROW])
                if self._learn(old, row, x, scale) < 0:
                    raise RunError(
                        f"no mode continues at {now:.9g} s after {describe_modes(self.system, self.modes[old].key)}"
                    )

    def _stops(self, count: int) -> tuple[NDArray[np.int64], Array, Array]:
        """Instants at which pieces of signals begin anew: interval, offset in it [s], values."""
        times = [signal.breakpoints(-self.h, (count + 1) * self.h) for signal in self.system.signals]
        knots = np.unique(np.concatenate(times)) if times else np.empty(0)
        position = knots / self.h
        whole = np.rint(position)
        on_grid = np.abs(position - whole) < 1e-9
        interval = np.where(on_grid, whole - 1, np.floor(position)).astype(np.int64)
        offset = np.where(on_grid, self.h, knots - interval * self.h)
        inside = (interval >= 0) & (interval < count)
        interval, offset, knots = interval[inside], offset[inside], knots[inside]
        if self.system.signals:
            seeds = np.arange(RESEED_SAMPLES, count + 1, RESEED_SAMPLES, dtype=np.int64) - 1
            seeds = np.setdiff1d(seeds, interval[offset == self.h])
            interval = np.concatenate([interval, seeds])
            offset = np.concatenate([offset, np.full(len(seeds), self.h)])
            knots = np.concatenate([knots, (seeds + 1) * self.h])
            order = np.lexsort((offset, interval))
            interval, offset, knots = interval[order], offset[order], knots[order]
        return interval, offset, self.system.signal_values(knots)


def component_events(engine: ExactEngine, run: Run) -> Iterator[Event]:
    """Translate changes of the train's mode into changes of its components' modes."""
    known: dict[tuple[int, int], list[Change]] = {}
    for time, pair in zip(run.change_times.tolist(), map(tuple, run.changes.tolist()), strict=True):
        if pair not in known:
            old, new = pair
            if old < 0:
                known[pair] = [named_change(engine.system, -1 - old, STUCK, new)]
            else:
                known[pair] = list(changes(engine.system, engine.modes[old].key, engine.modes[new].key))
        for change in known[pair]:
            yield Event(time, *change)
