"""Which combinations of branches may follow: ruled out by the state alone, then tried by how many components change."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from sim.piecewise_affine.kernel import STANDSTILL, STOP_TOLERANCE, TOLERANCE
from sim.piecewise_affine.system import Array, System

MOST_COMBINATIONS = 200_000
NO_START = "no mode of the drive train holds at the start; give start values that agree with its friction"
MOTION = 1e-3
"""Angles [rad] and speeds [rad/s] of this size are taken to occur; what is rounding beside them is rounding."""
REST = 1e-2
"""Share of the fastest speed so far that every speed may have had, for judging what is rounding."""
Key = tuple[int, ...]
Change = tuple[str, int, int, str, str]


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


def sizes(system: System, x: Array) -> Array:
    """How large each state may be taken to have been, at least `MOTION`, for judging what is rounding."""
    out = np.abs(x)
    moving = slice(0, 2 * system.freedom)
    out[moving] = np.maximum(out[moving], MOTION)
    return out


def possible_branches(system: System, guards: Sequence[Guard], x: Array, scale: Array) -> list[list[int]]:
    """Branches of every component that the state x alone does not rule out; `scale` is how large x has been."""
    speeds = slice(system.freedom, 2 * system.freedom)
    scale = scale.copy()
    scale[speeds] = np.maximum(scale[speeds], REST * scale[speeds].max(initial=0.0))
    return [guard.allowed(x, scale) if guard.branches > 1 else [0] for guard in guards]


def combinations_near(system: System, key: Key, first: frozenset[int], allowed: list[list[int]]) -> Iterator[Key]:
    """Combinations that differ from `key`: in the components `first`, then in more and more others."""
    others = [i for i, count in enumerate(system.branch_counts) if count > 1 and i not in first]
    tried = 0
    for more in range(len(others) + 1):
        for extra in combinations(others, more):
            changing = [*sorted(first), *extra]
            for choice in product(*(allowed[i] for i in changing)):
                new = dict(zip(changing, choice, strict=True))
                if any(new[i] == key[i] for i in extra) or (first and all(new[i] == key[i] for i in first)):
                    continue
                tried += 1
                if tried > MOST_COMBINATIONS:
                    return
                yield tuple(new.get(i, branch) for i, branch in enumerate(key))


def first_combinations(system: System, allowed: list[list[int]]) -> Iterator[Key]:
    """Combinations at the start: every component in its first possible branch, then more and more in others."""
    if all(allowed):
        yield from combinations_near(system, tuple(branches[0] for branches in allowed), frozenset(), allowed)


def broken_away(system: System, key: Key, allowed: list[list[int]]) -> list[tuple[int, int]]:
    """Components at rest that could be stuck, but slide from the first instant on: (component, mode)."""
    out = []
    for i, branches in enumerate(allowed):
        mode = system.mode(i, key[i])
        if any(system.piece(i, branch).stops.size for branch in branches) and mode is not None and abs(mode) == 1:
            out.append((i, mode))
    return out


def describe_modes(system: System, key: Key) -> str:
    """The modes of all components in words."""
    words = []
    for i, branch in enumerate(key):
        mode = system.mode(i, branch)
        if mode is not None and system.branch_counts[i] > 1:
            words.append(f"{system.names[i]} {system.components[i].mode_names.get(mode, mode)}")
    return ", ".join(words)


def changes(system: System, old: Key, new: Key) -> Iterator[Change]:
    """Changes of the components' modes between two combinations of branches."""
    for i, (a, b) in enumerate(zip(old, new, strict=True)):
        was, now = system.mode(i, a), system.mode(i, b)
        if was is not None and now is not None and was != now:
            yield named_change(system, i, was, now)


def named_change(system: System, i: int, was: int, now: int) -> tuple[str, int, int, str, str]:
    """Component, old and new mode in numbers and in words."""
    names = system.components[i].mode_names
    return system.names[i], was, now, names.get(was, str(was)), names.get(now, str(now))
