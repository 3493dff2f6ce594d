"""The equations of one mode for Runge-Kutta: what does not change is solved once, the rest at each state."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.piecewise_affine.mode import combined, compile_mode, constraints, equations, flow, solve_unknowns
from sim.piecewise_affine.mode_search import Key
from sim.piecewise_affine.system import Array, Mode, System
from sim.runge_kutta import kernel

Tables = tuple[Array, ...]
Curves = tuple[NDArray[np.int64], Array, Array]
Signals = tuple[NDArray[np.int64], Array, Array]


@dataclass(frozen=True)
class Reduced:
    """Unknowns z = base x + ways w, where w solves the rows that change with the state, `tables` for the kernel."""

    base: Array
    ways: Array
    tables: Tables


class Law:
    """The equations of one mode, `key` its branches; compiled at the system's present point.

    A mode without curves is affine. One that has curves and is regular is reduced: only the balances at the flanges of
    components with curves, and these components' own equations, are solved anew at each state. Of the others
    (`reduced` None: torques that nothing determines, shafts without inertia beside curves) the whole is.
    """

    def __init__(self, system: System, key: Key) -> None:
        self.system, self.key = system, key
        self.bent = [i for i, branch in enumerate(key) if system.bent(i, branch)]
        self._straight = equations(system, key, [i for i in range(len(key)) if i not in self.bent])
        curved = [system.curved(i, key[i]) for i in self.bent]
        every = tuple(curve for one in curved for curve in one.curves)
        rows = np.vstack([np.zeros((0, system.known)), *[one.rows for one in curved]])
        self.curves: Curves = (*kernel.packed(every), np.ascontiguousarray(rows @ system.to_known))
        self.places = np.cumsum([0, *[len(one.curves) for one in curved]]).tolist()
        self._mode = compile_mode(system, key)
        self.reduced: Reduced | None = None
        if not self.bent:
            self.reduced = self._affine()
        elif self._mode.regular:
            self.reduced = self._reduce()

    def _affine(self) -> Reduced:
        system, mode = self.system, self._mode
        width, count = system.state_width, system.freedom
        none = np.zeros((0, 0))
        tables = _contiguous(
            mode.matrix[count : 2 * count],
            np.zeros((count, 0)),
            none[None],
            np.zeros((1, 0, width)),
            mode.holds.rows[None],
            np.zeros((1, len(mode.holds.rows), 0)),
        )
        return Reduced(mode.solve, np.zeros((len(mode.solve), 0)), tables)

    def _reduce(self) -> Reduced:
        system, known = self.system, self.system.known
        nodes = sorted({node for i in self.bent for node in system.piece(i, self.key[i]).nodes})
        kept = np.delete(self._straight, nodes, axis=0)
        unknown = kept[:, known:]
        scale, columns = np.abs(unknown).max(axis=1, keepdims=True), np.abs(unknown).max(axis=0)
        columns[columns == 0] = 1.0  # of what stands in changing rows alone
        left, size, right = np.linalg.svd(unknown / scale / columns)
        ways = right[len(size) :].T / columns[:, None]
        solved = (right[: len(size)].T / size) @ left[:, : len(size)].T / columns[:, None]
        base = -solved @ (system.state_rows(kept) / scale)
        count = 1 + self.places[-1]
        balances = np.zeros((count, len(nodes), system.width))
        balances[0] = self._straight[nodes]
        laws, limits = [balances], []
        for i, branch in enumerate(self.key):
            piece, *parts = system.uncurved(i, branch)
            law, holds = (np.zeros((count, len(rows), system.width)) for rows in (piece.equations, piece.holds))
            first = 1 + self.places[self.bent.index(i)] if i in self.bent else 1
            for number, part in ((0, piece), *enumerate(parts, first)):
                law[number], holds[number] = part.equations, part.holds
                if i in self.bent:
                    for node, torque in zip(part.nodes, part.torques, strict=True):
                        balances[number, nodes.index(node)] += torque
            limits.append(holds)
            if i in self.bent:
                laws.append(law)

        def split(rows: Array) -> tuple[Array, Array]:
            return rows[..., :known] @ system.to_known + rows[..., known:] @ base, rows[..., known:] @ ways

        right_side, left_side = split(np.concatenate(laws, axis=1))
        by_state, by_choice = split(np.concatenate(limits, axis=1))
        node_count = system.node_count
        accelerations = system.coordinates @ base[:node_count], system.coordinates @ ways[:node_count]
        return Reduced(base, ways, _contiguous(*accelerations, left_side, right_side, by_state, by_choice))

    def at(self, x: Array) -> Mode:
        """The mode with its curves kept at their values at x."""
        if not self.bent:
            return self._mode
        system = self.system
        system.point = system.to_known @ x
        if self.reduced is None:
            return compile_mode(system, self.key)
        c = kernel.coefficients(x, self.curves)
        left, right, by_state, by_choice = (np.tensordot(c, part, 1) for part in self.reduced.tables[2:])
        choice = -np.linalg.solve(left, right)
        solve = self.reduced.base + self.reduced.ways @ choice
        pieces = [system.piece(i, branch) for i, branch in enumerate(self.key)]
        holds = constraints(by_state, by_choice, choice, pieces)
        mode = self._mode
        return Mode(self.key, flow(system, solve), holds, mode.stops, mode.enter, solve, True, mode.rows)

    def unknowns(self, x: Array) -> Array:
        """Accelerations and torques at states x (n, state), shape (n, unknowns)."""
        if self.reduced is not None:
            _, w = kernel.unknown(x, self.reduced.tables, self.curves)
            return np.asarray(x @ self.reduced.base.T + w @ self.reduced.ways.T)
        return np.array([self._solved(one) for one in x])

    def _solved(self, x: Array) -> Array:
        system = self.system
        system.point = system.to_known @ x
        losses = np.vstack([system.piece(i, branch).losses for i, branch in enumerate(self.key)])
        rows = combined(system, self._straight, self.key, self.bent)
        return np.asarray(solve_unknowns(system, rows, losses)[0] @ x)

    def rate(self, moving: Array, elapsed: float, signals: Signals) -> Array:
        """Time derivative of angles and speeds `elapsed` [s] after the signals' pieces began."""
        if self.reduced is not None:
            return np.asarray(kernel.rate(moving, elapsed, self.reduced.tables, self.curves, signals))
        system = self.system
        x = np.empty(system.state_width)
        kernel.full(moving, elapsed, signals, x)
        return np.concatenate([moving[system.freedom :], system.coordinates @ self._solved(x)[: system.node_count]])

    def margins(self, moving: Array, elapsed: Array, scale: Array, signals: Signals) -> tuple[Array, Array, Array]:
        """States, values of all inequalities and sizes of their terms, at k times; the state is at most `scale`."""
        if self.reduced is not None:
            found = kernel.margins(moving, elapsed, scale, self.reduced.tables, self.curves, signals)
            return found[0], found[1], found[2]
        states, values, sizes = [], [], []
        for one, time in zip(moving, elapsed.tolist(), strict=True):
            x = np.empty(self.system.state_width)
            kernel.full(one, time, signals, x)
            rows = self.at(x).holds.rows
            states.append(x)
            values.append(rows @ x)
            sizes.append(np.abs(rows) @ np.maximum(scale, np.abs(x)))
        return np.array(states), np.array(values), np.array(sizes)

    def owners(self, x: Array) -> list[frozenset[int]]:
        """Components that each inequality belongs to."""
        if self.reduced is not None and self.bent:
            branches = [self.system.piece(i, branch).holds for i, branch in enumerate(self.key)]
            return [frozenset([i]) for i, holds in enumerate(branches) for _ in holds]
        return list(self.at(x).holds.owners)

    def channel(self, i: int, rows: list[Array], x: Array, variables: Array) -> Array:
        """Values at n states of a row of component i: what no curve scales, then what each of its curves does."""
        out = variables @ rows[0]
        if i in self.bent:
            kinds, tables, arguments = self.curves
            for j, row in enumerate(rows[1:], self.places[self.bent.index(i)]):
                values = np.array([kernel.value(kinds, tables, j, s) for s in x @ arguments[j]])
                out = out + values * (variables @ row)
        return np.asarray(out)


def _contiguous(*parts: Array) -> Tables:
    return tuple(np.ascontiguousarray(part) for part in parts)
