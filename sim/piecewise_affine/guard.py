"""Guards: inequalities that hold while a mode lasts, and the tolerances with which they are looked at."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.piecewise_affine.kernel import STANDSTILL, STOP_TOLERANCE, TOLERANCE
from sim.piecewise_affine.system import Array, System


@dataclass(frozen=True)
class Guard:
    """What the state alone says about the branches of one component, all rows stacked.

    `rows` must not be negative (inequalities, and speeds that must be zero, twice); `of_signals` are those rows that
    depend on signals alone, with their derivatives, shape (4, m, state).
    """

    branches: int
    rows: Array
    sizes: Array
    loose: Array
    branch: NDArray[np.int64]
    of_signals: Array
    signal_branch: NDArray[np.int64]

    @classmethod
    def of(cls, system: System, i: int) -> "Guard":
        rows, loose, branch = [np.zeros((0, system.width))], [np.zeros(0)], [np.zeros(0, np.int64)]
        for number in range(system.branch_counts[i]):
            piece = system.piece(i, number)
            alone = ~piece.holds[:, system.known :].any(axis=1)
            by_state = piece.holds[alone]
            rows += [by_state, piece.stops, -piece.stops]
            loose += [np.full(len(by_state), TOLERANCE), np.full(2 * len(piece.stops), STOP_TOLERANCE)]
            branch.append(np.full(len(by_state) + 2 * len(piece.stops), number))
        stacked, owner = system.state_rows(np.vstack(rows)), np.concatenate(branch)
        alone = (stacked != 0).any(axis=1) & (stacked[:, : 2 * system.freedom] == 0).all(axis=1)
        derivatives, flow = [stacked[alone]], system.signal_flow()
        for _ in range(3):
            derivatives.append(derivatives[-1] @ flow)
        return cls(
            system.branch_counts[i],
            stacked,
            np.abs(stacked),
            np.concatenate(loose),
            owner,
            np.array(derivatives),
            owner[alone],
        )

    def allowed(self, x: Array, scale: Array) -> list[int]:
        """Branches that are not ruled out at x."""
        out = set(self.branch[self.rows @ x < -self.loose * (self.sizes @ scale) - STANDSTILL].tolist())
        if len(self.signal_branch):
            values, sizes = self.of_signals @ x, np.abs(self.of_signals) @ scale
            values[np.abs(values) <= TOLERANCE * sizes] = 0.0
            first = np.take_along_axis(values, np.argmax(values != 0, axis=0)[None], axis=0)[0]
            out.update(self.signal_branch[first < 0].tolist())
        return [branch for branch in range(self.branches) if branch not in out]


class Guards(dict[int, Guard]):
    """Guards of the components of one system, each made when it is first asked for."""

    def __init__(self, system: System) -> None:
        super().__init__()
        self.system = system

    def __missing__(self, component: int) -> Guard:
        self[component] = guard = Guard.of(self.system, component)
        return guard
