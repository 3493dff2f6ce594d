"""What is looked at of an exact run: one that does not obey its own equations is an error.

At `INSTANTS` samples, evenly spread: the equations of the mode (balances of torques, gears and shafts, laws) and its
limits; each flange that follows a signal, against that signal; from a sample to the next, the motion by a power series
of its own, and the change of kinetic energy against the work of all torques (sources, stores, losses) by quadrature.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunError
from sim.piecewise_affine.system import Array, Mode, System, describe
from sim.residual import SMALLEST, TOLERANCE
from sim.rotational.component import Signal

ORDER = 16
LONGEST = 0.7
"""Step times the largest eigenvalue up to which the power series of this order is exact to rounding."""
MOST_PARTS = 64
"""Steps of `LONGEST` between samples up to which flow and energy are looked at."""
NODES, WEIGHTS = (np.polynomial.legendre.leggauss(8)[i] for i in (0, 1))


class Followed(NamedTuple):
    """A row of the state that follows a signal, and the component that says so."""

    component: str
    row: Array
    signal: Signal


class Verifier:
    """Checks runs of one train at one sample rate; keeps what it needs of each mode."""

    def __init__(self, system: System, h: float) -> None:
        self._system, self._h = system, h
        self._laws: dict[int, _Law] = {}
        self._kinetic = system.kinetic
        self._followed = [
            Followed(name, system.state_rows(row[None])[0], signal)
            for name, part, v in zip(system.names, system.components, system.rows, strict=True)
            for row, signal in part.follows(v)
        ]

    def motion(self, time_s: Array, x: Array) -> float:
        """Residual of flanges that follow signals, at states x of shape (n, state)."""
        worst = 0.0
        for name, row, signal in self._followed:
            wanted = signal(time_s)
            off = np.abs(x @ row - wanted) / (float(np.abs(wanted).max()) + SMALLEST)
            worst = max(worst, _within(off, time_s, partial(_unfollowed, name)))
        return worst

    def laws(
        self, modes: Sequence[Mode], numbers: NDArray[np.int32], time_s: Array, x: Array, after: Array, quiet: Array
    ) -> tuple[float, float, float, float]:
        """Residuals of equations, limits, flow and energy.

        `numbers` are those of the modes at the states x (n, state), `after` the angles and speeds one sample later, and
        `quiet` says where no event and no signal's breakpoint lies between; flow and energy are looked at there.
        """
        visited, at = np.unique(numbers, return_inverse=True)
        for number in visited.tolist():
            if number not in self._laws:
                self._laws[number] = _Law.of(self._system, modes[number], self._h)
        laws = [self._laws[number] for number in visited.tolist()]
        equations = max(len(law.equations) for law in laws)
        counts = equations, max(len(law.limits) for law in laws)
        rows = np.array([law.stacked((law.equations, law.limits, law.flow), counts) for law in laws])
        sizes = np.array([law.stacked((law.terms, np.abs(law.limits), law.flown), counts) for law in laws])
        works = np.array([law.work for law in laws])
        largest = np.maximum(np.abs(x).max(axis=0), SMALLEST)
        ratio = np.matmul(rows[at], x[:, :, None])[:, :, 0]
        moving, limits = after.shape[1], sum(counts)
        ratio[:, limits:] -= after
        ratio[np.logical_not(quiet), limits:] = 0.0
        np.minimum(ratio[:, equations:limits], 0.0, out=ratio[:, equations:limits])
        size = sizes[at] @ largest
        ratio = np.abs(ratio) / (np.maximum(size, SMALLEST * size.max(axis=0)) + 1e-300)
        parts = ratio[:, :equations], ratio[:, equations:limits], ratio[:, limits:]
        out = [
            _within(part.max(axis=1, initial=0.0), time_s, partial(self._told, what, part, numbers))
            for part, what in zip(parts, ("equations", "limits", "flow"), strict=True)
        ]
        speeds = slice(moving // 2, moving)
        energies = [0.5 * ((v @ self._kinetic) * v).sum(axis=1) for v in (x[:, speeds], after[:, speeds])]
        work = (np.matmul(works[at], x[:, :, None])[:, :, 0] * x).sum(axis=1)
        most = largest[speeds] @ np.abs(self._kinetic) @ largest[speeds]
        size = most + np.matmul(np.abs(works[at]), largest) @ largest + 1e-300
        off = np.where(quiet, np.abs(energies[1] - energies[0] - work) / size, 0.0)
        energy = _within(off, time_s, lambda _: "all inertias: the balance of energy is not fulfilled")
        return out[0], out[1], out[2], energy

    def _told(self, what: str, ratio: Array, numbers: NDArray[np.int32], instant: int) -> str:
        """Whose residual is too large, and which."""
        row = int(np.argmax(ratio[instant]))
        if what == "flow":
            return f"{self.coordinate(row)}: a sample does not follow from the one before"
        law = self._laws[int(numbers[instant])]
        if what == "limits":
            names = " and ".join(self._system.names[i] for i in sorted(law.mode.holds.owners[row]))
            return f"{names}: the mode goes beyond its limits"
        if row < self._system.node_count:
            return f"{describe(self._system, row)}: the torques do not balance"
        return f"{law.owners(self._system)[row - self._system.node_count]}: its equations are not fulfilled"

    def coordinate(self, column: int) -> str:
        """The flanges whose angle or speed a column of the state is."""
        coordinate = self._system.coordinates[column % self._system.freedom]
        return describe(self._system, int(np.argmax(np.abs(coordinate))))


@dataclass(frozen=True)
class _Law:
    """Rows of one mode over the state: residuals of its equations with the sizes of their terms, its limits, the state
    one sample later with the sizes of its terms (zero where a sample is too long), the work of all torques as x' W x.
    """

    mode: Mode
    equations: Array
    terms: Array
    limits: Array
    flow: Array
    flown: Array
    work: Array

    @classmethod
    def of(cls, system: System, mode: Mode, h: float) -> "_Law":
        known, unknown = mode.rows[:, : system.known], mode.rows[:, system.known :]
        flow, work = _flow_and_work(system, mode, h)
        sizes = np.abs(mode.solve)
        for alike in (sizes[: system.node_count], sizes[system.node_count :]):  # accelerations, torques
            np.maximum(alike, SMALLEST * alike.max(axis=0, initial=0.0), out=alike)
        flown = np.abs(flow) + np.eye(len(flow), system.state_width) * bool(flow.any())
        return cls(
            mode,
            system.state_rows(mode.rows) + unknown @ mode.solve,
            np.abs(known) @ np.abs(system.to_known) + np.abs(unknown) @ sizes,
            mode.holds.rows,
            flow,
            flown,
            work,
        )

    def stacked(self, parts: tuple[Array, Array, Array], counts: tuple[int, int]) -> Array:
        """Equations, limits and flow, each filled up with zeros to the count."""
        filled = [np.pad(part, ((0, count - len(part)), (0, 0))) for part, count in zip(parts[:2], counts, strict=True)]
        return np.vstack([*filled, parts[2]])

    def owners(self, system: System) -> list[str]:
        """Components whose equations the rows after the balances are."""
        parts = zip(system.names, system.components, system.rows, strict=True)
        kinematics = [name for name, part, v in parts for _ in part.kinematics(v)]
        branches = zip(system.names, self.mode.key, range(len(self.mode.key)), strict=True)
        return kinematics + [name for name, key, i in branches for _ in system.pieces[i][key].equations]


def _flow_and_work(system: System, mode: Mode, h: float) -> tuple[Array, Array]:
    """Rows of angles and speeds h [s] later, and the work of all torques on the inertias till then as a square form."""
    count, width = system.freedom, system.state_width
    parts = max(1, int(np.ceil(mode.rate * h / LONGEST)))
    if parts > MOST_PARTS:
        return np.zeros((2 * count, width)), np.zeros((width, width))
    step = h / parts
    terms = [np.eye(width)]
    for k in range(1, ORDER + 1):
        terms.append(terms[-1] @ mode.matrix * (step / k))
    powers = np.append(0.5 * (NODES + 1), 1.0)[:, None] ** np.arange(ORDER + 1)
    path = np.tensordot(powers, np.array(terms), 1)
    power = mode.matrix[count : 2 * count].T @ system.kinetic
    work = sum(
        0.5 * step * weight * (now.T @ power @ now[count : 2 * count])
        for weight, now in zip(WEIGHTS, path[:-1], strict=True)
    )
    moved, total = path[-1], np.asarray(work)
    for _ in range(parts - 1):
        total = work + path[-1].T @ total @ path[-1]
        moved = moved @ path[-1]
    return moved[: 2 * count], total


def _unfollowed(name: str, _: int) -> str:
    return f"{name}: it does not follow its signal"


def _within(ratio: Array, time_s: Array, told: Callable[[int], str]) -> float:
    worst = int(np.argmax(ratio))
    value = float(ratio[worst])
    if not value <= TOLERANCE:
        raise RunError(f"{told(worst)} at {time_s[worst]:.9g} s (residual {value:.1e}, at most {TOLERANCE:g})")
    return value
