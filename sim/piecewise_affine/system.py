"""Equations of a whole drive train, put together from its components' rows: one linear system per mode.

A row is a vector over all variables: angles and speeds of the nodes, the signals' pieces, the constant one (together
`y`, known at an instant), then accelerations of the nodes and unknown torques (together `z`, solved for). The state
x = (q, v, signals, one) has as coordinates q the relative angles of compliant parts first, as Modelica prefers, so
that no digits are lost between large angles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.errors import CompositionError, RunError
from sim.rotational.component import Branch, Component, Row, Signal, Variables
from sim.rotational.drive_train import DriveTrain

Array = NDArray[np.float64]
ZERO = 1e-10
"""Below this, relative to the largest, a coefficient or a pivot is rounding."""


class _Rows(Variables):
    """The variables of one component as rows; a flange on ground is a row of zeros."""

    def __init__(self, system: "System", nodes: dict[str, int], first_unknown: int, signals: list[int]) -> None:
        self._system, self._nodes, self._first, self._signals = system, nodes, first_unknown, signals
        self._unit = system.unit
        self.one = system.unit[system.known - 1]

    def _node(self, flange: str, offset: int) -> Row:
        node = self._nodes[flange]
        return self._column(node + offset) if node >= 0 else np.zeros(self._system.width)

    def _column(self, i: int) -> Row:
        row: Row = self._unit[i]
        return row

    def phi(self, flange: str) -> Row:
        return self._node(flange, 0)

    def w(self, flange: str) -> Row:
        return self._node(flange, self._system.node_count)

    def a(self, flange: str) -> Row:
        return self._node(flange, self._system.known)

    def unknown(self, i: int) -> Row:
        return self._column(self._first + i)

    def signal(self, i: int = 0, derivative: int = 0) -> Row:
        number = self._signals[i]
        level, swing = self._system.signal_columns[number]
        if derivative == 1:
            return self._column(swing + 1)
        if derivative == 2:
            by_swing, by_rate = bend(self._system.signals[number])
            return by_swing * self._column(swing) + by_rate * self._column(swing + 1)
        return self._column(swing) if level < 0 else self._column(level) + self._column(swing)


@dataclass(frozen=True)
class Constraints:
    """A row of `holds` with the components that own it, after all unknowns are eliminated: g(x) = row . x >= 0.

    Where `strict`, g may be zero at an instant but not for good.
    """

    rows: Array
    strict: NDArray[np.bool_]
    owners: tuple[frozenset[int], ...]

    def owner(self, row: int) -> frozenset[int]:
        """Components whose law breaks with a row; none beyond the last row, where what has to be zero is not."""
        return self.owners[row] if row < len(self.owners) else frozenset()


@dataclass(frozen=True)
class Mode:
    """One combination of branches: x' = matrix x while all rows of `holds` are >= 0.

    `stops` are rows that must be zero to enter: speeds, and what a prescribed motion has to be; `enter` maps x on
    entry, `solve` gives z = solve x. `rows` are all equations, over (y, z).
    """

    key: tuple[int, ...]
    matrix: Array
    holds: Constraints
    stops: Array
    enter: Array
    solve: Array
    rows: Array

    @cached_property
    def rate(self) -> float:
        """Largest eigenvalue [1/s]."""
        return float(np.abs(np.linalg.eigvals(self.matrix)).max(initial=0.0))


class System:
    """All rows of a train, and the linear system of each mode.

    Raises
    ------
    CompositionError
        when start values contradict each other or a shaft is fixed twice.
    """

    def __init__(self, train: DriveTrain) -> None:
        self.train = train
        self.names = list(train.components)
        self.components: list[Component] = list(train.components.values())
        node_of = self._number_nodes()
        self._lay_out()
        first = self.known + self.node_count
        self.rows: list[_Rows] = []
        number = 0
        for name, component in zip(self.names, self.components, strict=True):
            nodes = {flange: node_of[f"{name}.{flange}"] for flange in component.flanges}
            count = len(component.signals)
            self.rows.append(_Rows(self, nodes, first, list(range(number, number + count))))
            first, number = first + component.unknowns, number + count
        self._choose_coordinates()
        parts = list(zip(self.components, self.rows, strict=True))
        self.pieces = [
            tuple(Piece.of(self, v, branch, part.unknowns - len(part.kinematics(v))) for branch in part.branches(v))
            for part, v in parts
        ]
        self.branch_counts = [len(pieces) for pieces in self.pieces]

    # ---- layout -----------------------------------------------------------------------------------------------

    def _number_nodes(self) -> dict[str, int]:
        node_of: dict[str, int] = {}
        self.node_flanges: list[frozenset[str]] = []
        for flanges in sorted(self.train.nodes(), key=lambda node: min(self._place(flange) for flange in node)):
            only = next(iter(flanges))
            name, _, flange = only.rpartition(".")
            if len(flanges) == 1 and flange in self.train[name].grounded:
                node_of[only] = -1
                continue
            node_of.update(dict.fromkeys(flanges, len(self.node_flanges)))
            self.node_flanges.append(flanges)
        self.node_count = len(self.node_flanges)
        return node_of

    def _place(self, flange: str) -> tuple[int, str]:
        return self.names.index(flange.rpartition(".")[0]), flange

    def _lay_out(self) -> None:
        self.signals: list[Signal] = [signal for part in self.components for signal in part.signals]
        column = 2 * self.node_count
        self.signal_columns: list[tuple[int, int]] = []
        for signal in self.signals:
            self.signal_columns.append((column if signal.has_level else -1, column + signal.has_level))
            column += 2 + signal.has_level
        self.signal_width = column - 2 * self.node_count
        self.known = column + 1
        self.width = self.known + self.node_count + sum(part.unknowns for part in self.components)
        self.unit = np.eye(self.width)

    def signal_values(self, time_s: Array) -> Array:
        """Pieces of all signals valid from the times on, shape (n, signal_width)."""
        out = np.zeros((len(time_s), self.signal_width))
        for signal, (level, swing) in zip(self.signals, self.signal_columns, strict=True):
            pieces = signal.pieces(time_s)
            first = swing - 2 * self.node_count
            out[:, first : first + 2] = pieces[:, 1:]
            if level >= 0:
                out[:, first - 1] = pieces[:, 0]
            else:
                out[:, first] += pieces[:, 0]
        return out

    def states(self, time_s: Array, moving: Array) -> Array:
        """Whole states of angles and speeds `moving` at the times, shape (n, state)."""
        out = np.empty((len(time_s), self.state_width))
        width = moving.shape[1]
        out[:, :width] = moving
        out[:, width:-1] = self.signal_values(time_s)
        out[:, -1] = 1.0
        return out

    def signal_flow(self) -> Array:
        """Matrix S of the signals' own motion: x' = S x where nothing else moves; shape (state, state)."""
        flow = np.zeros((self.state_width, self.state_width))
        for signal, (_, swing) in zip(self.signals, self.signal_columns, strict=True):
            column = swing - 2 * self.node_count + 2 * self.freedom
            flow[column, column + 1] = 1.0
            flow[column + 1, column : column + 2] = bend(signal)
        return flow

    # ---- coordinates and start --------------------------------------------------------------------------------

    def _choose_coordinates(self) -> None:
        parts = list(zip(self.components, self.rows, strict=True))
        owners = [i for i, (part, v) in enumerate(parts) for _ in part.kinematics(v)]
        self.kinematics = _stack([row for part, v in parts for row in part.kinematics(v)], self.width)
        n = self.node_count
        relative: list[Row] = []
        absolute: list[Row] = []
        for part, v in zip(self.components, self.rows, strict=True):
            (absolute if part.inertia else relative).extend(row[:n] for row in part.states(v))
        self.candidates = [*relative, *absolute, *np.eye(n)]
        basis = Basis(n)
        fixed = [i for i, row in enumerate(self.kinematics) if basis.take(row[:n])]
        for i, row in enumerate(self.kinematics):
            if i not in fixed and abs(row[self.known - 1]) > 0:
                raise CompositionError("a shaft is fixed at two angles; leave one Fixed out")
            if i not in fixed:
                self._check_loop([owners[j] for j in (*_made_of(row[:n], self.kinematics[fixed, :n], fixed), i)])
        chosen = [row for row in self.candidates if basis.take(row)]
        self.coordinates = np.array(chosen).reshape(-1, n)
        count = len(chosen)
        inverse = np.linalg.inv(np.vstack([self.kinematics[fixed, :n], self.coordinates])) if n else np.zeros((0, 0))
        shape, offset = inverse[:, len(fixed) :], -inverse[:, : len(fixed)] @ self.kinematics[fixed, self.known - 1]
        self.state_width = 2 * count + self.signal_width + 1
        self.to_known = np.zeros((self.known, self.state_width))
        self.to_known[:n, :count] = shape
        self.to_known[:n, -1] = offset
        self.to_known[n : 2 * n, count : 2 * count] = shape
        self.to_known[2 * n :, 2 * count :] = np.eye(self.signal_width + 1)
        self.freedom = count
        self.fixed = fixed
        self._find_prescribed()

    def _check_loop(self, loop: list[int]) -> None:
        """Refuse a closed loop of rigid parts in which a loss depends on a torque that nothing determines."""
        lossy = [self.names[i] for i in dict.fromkeys(loop) if self.components[i].loses_torque]
        if lossy:
            names = ", ".join(self.names[i] for i in dict.fromkeys(loop))
            raise CompositionError(
                f"{lossy[0]}: it lies in a closed loop of rigid parts ({names}), so nothing determines how they share "
                "the torque, and its loss depends on that; put a Spring or SpringDamper into the loop"
            )

    def _find_prescribed(self) -> None:
        """`unprescribed`: an orthonormal basis of how the coordinates can move where no motion is prescribed."""
        parts = zip(self.names, self.components, self.rows, strict=True)
        given = [(name, row) for name, part, v in parts for row in part.prescribed(v)]
        along = self.state_rows(_stack([row for _, row in given], self.width))[:, : self.freedom]
        basis, taken = Basis(self.freedom), list[int]()
        for i, (name, _) in enumerate(given):
            if basis.take(along[i]):
                taken.append(i)
                continue
            others = " and ".join(given[j][0] for j in _made_of(along[i], along[taken], taken))
            raise CompositionError(
                f"{name}: its flange is moved by {others} already; leave one source of motion out"
                if others
                else f"{name}: its flange is fixed and cannot be moved; leave the source or what fixes it out"
            )
        _, size, right = np.linalg.svd(along)
        self.unprescribed = right[len(size) :].T

    def start(self) -> Array:
        """Return the state at time 0: start values that were given, zero where none was."""
        n = self.node_count
        given = [
            (name, start)
            for name, part, v in zip(self.names, self.components, self.rows, strict=True)
            for start in part.starts(v)
        ]
        state = np.zeros(self.state_width)
        for level in range(2):
            rows = slice(level * n, (level + 1) * n)
            basis, system, values = Basis(n), [], []
            for i in self.fixed:
                basis.take(self.kinematics[i, :n])
                system.append(self.kinematics[i, :n])
                values.append(0.0 if level else -float(self.kinematics[i, self.known - 1]))
            for name, start in given:
                row = start.row[rows]
                if not row.any():
                    continue
                if basis.take(row):
                    system.append(row)
                    values.append(start.value)
                    continue
                so_far = np.linalg.lstsq(np.array(system), np.array(values), rcond=None)[0]
                if abs(row @ so_far - start.value) > 1e-9 * (1 + abs(start.value)):
                    what = "speed" if level else "angle"
                    raise CompositionError(
                        f"{name}: its start {what} {start.value:g} contradicts the others, which give {row @ so_far:g}"
                    )
            for row in self.candidates:
                if basis.take(row):
                    system.append(row)
                    values.append(0.0)
            nodes = np.linalg.solve(np.array(system), np.array(values)) if n else np.zeros(0)
            state[level * self.freedom : (level + 1) * self.freedom] = self.coordinates @ nodes
        state[2 * self.freedom : -1] = self.signal_values(np.zeros(1))[0]
        state[-1] = 1.0
        return state

    # ---- rows of the branches ---------------------------------------------------------------------------------

    @cached_property
    def light(self) -> Array:
        """Inertia matrix of what is not prescribed, with a little where there is none."""
        energy = self.unprescribed.T @ self.kinetic @ self.unprescribed
        return np.asarray(energy + 1e-9 * (np.trace(energy) / max(len(energy), 1) + 1e-12) * np.eye(len(energy)))

    @cached_property
    def kinetic(self) -> Array:
        """Inertia matrix in the coordinates, shape (freedom, freedom)."""
        masses = np.zeros(self.node_count)
        for part, v in zip(self.components, self.rows, strict=True):
            if part.inertia:
                masses += part.inertia * v.phi(part.flanges[0])[: self.node_count]
        shape = self.to_known[: self.node_count, : self.freedom]
        return np.asarray(shape.T @ (masses[:, None] * shape))

    def state_rows(self, rows: Array) -> Array:
        """Rows of known variables as rows over the state."""
        return np.asarray(rows[:, : self.known] @ self.to_known)


@dataclass(frozen=True)
class Piece:
    """A branch with its rows stacked: what it adds to the balance of each node, its equations and inequalities."""

    branch: Branch
    nodes: tuple[int, ...]
    torques: Array
    equations: Array
    holds: Array
    strict: NDArray[np.bool_]
    stops: Array
    losses: Array

    @classmethod
    def of(cls, system: System, v: _Rows, branch: Branch, equations: int) -> "Piece":
        if len(branch.equations) != equations:
            raise CompositionError(f"a branch needs {equations} equations, has {len(branch.equations)}")
        pairs = [(v._nodes[flange], row) for flange, row in branch.torques.items() if v._nodes[flange] >= 0]
        return cls(
            branch,
            tuple(node for node, _ in pairs),
            _stack([row for _, row in pairs], system.width),
            _stack(branch.equations, system.width),
            _stack((*branch.holds, *branch.strict), system.width),
            np.array([False] * len(branch.holds) + [True] * len(branch.strict), dtype=np.bool_),
            _stack(branch.stops, system.width),
            _stack([torques[0] for name, torques in branch.powers.items() if name == "lossPower"], system.width),
        )


def _stack(rows: Sequence[Row], width: int) -> Array:
    return np.array(rows, dtype=np.float64).reshape(-1, width)


def _made_of(row: Row, others: Array, numbers: list[int]) -> list[int]:
    """Numbers of the rows `others` that combine to `row`."""
    if not len(others):
        return []
    shares = np.abs(np.linalg.lstsq(others.T, row, rcond=None)[0])
    return [i for i, share in zip(numbers, shares.tolist(), strict=True) if share > 1e-9]


class Basis:
    """Rows taken one by one while they are independent of those taken before (Gram-Schmidt, twice)."""

    def __init__(self, width: int) -> None:
        self._taken = np.zeros((0, width))

    def take(self, row: Row) -> bool:
        size = float(np.linalg.norm(row))
        if size == 0:
            return False
        rest = row / size
        for _ in range(2):
            rest = rest - self._taken.T @ (self._taken @ rest)
        left = float(np.linalg.norm(rest))
        if left < 1e-9:
            return False
        self._taken = np.vstack([self._taken, rest / left])
        return True


def bend(signal: Signal) -> tuple[float, float]:
    """Factors of swing and rate in the rate's derivative."""
    return -(signal.omega**2 + signal.damping**2), -2 * signal.damping


def describe(system: System, node: int) -> str:
    """The flanges of a node in words."""
    return " = ".join(sorted(system.node_flanges[node]))


def no_inertia(system: System, direction: Array) -> RunError:
    node = int(np.argmax(np.abs(direction)))
    return RunError(
        f"{describe(system, node)}: nothing there has inertia or holds it; add an Inertia, or connect it to one"
    )
