"""Which combinations of branches may follow: ruled out by the state alone, then tried by how many components change."""

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from sim.affine_system import Array, System

MOST_COMBINATIONS = 200_000
NO_START = "no mode of the drive train holds at the start; give start values that agree with its friction"
TOLERANCE, STOP_TOLERANCE = 1e-11, 1e-9
"""Relative to the terms: a value this small is zero; a speed this small stands still."""
REST = 1e-2
"""Share of the fastest speed so far that every speed may have had, for judging what is rounding."""

Key = tuple[int, ...]
Change = tuple[str, int, int, str, str]


def possible_branches(system: System, x: Array, scale: Array) -> list[list[int]]:
    """Branches of every component that the state x alone does not rule out; `scale` is how large x has been."""
    known, speeds = system.known, slice(system.freedom, 2 * system.freedom)
    scale = scale.copy()
    scale[speeds] = np.maximum(scale[speeds], REST * scale[speeds].max(initial=0.0))
    possible = []
    for i in range(len(system.components)):
        allowed = []
        for branch, piece in enumerate(system.branches(i)):
            by_state = piece.holds[~piece.holds[:, known:].any(axis=1)]
            rows = system.state_rows(np.vstack([by_state, piece.stops, -piece.stops]))
            loose = np.full(len(rows), TOLERANCE)
            loose[len(by_state) :] = STOP_TOLERANCE
            if np.all(rows @ x >= -loose * (np.abs(rows) @ scale)) and _signals_allow(system, rows, x, scale):
                allowed.append(branch)
        possible.append(allowed)
    return possible


def _signals_allow(system: System, rows: Array, x: Array, scale: Array) -> bool:
    """Whether rows of signals alone that are zero now do not become negative at once."""
    of_signals = rows[(rows != 0).any(axis=1) & (rows[:, : 2 * system.freedom] == 0).all(axis=1)]
    flow = system.signal_flow()
    open_rows = np.ones(len(of_signals), dtype=np.bool_)
    for _ in range(4):
        value, size = of_signals @ x, np.abs(of_signals) @ scale
        zero = np.abs(value) <= TOLERANCE * size
        if np.any(open_rows & ~zero & (value < 0)):
            return False
        open_rows &= zero
        of_signals = of_signals @ flow
    return True


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
        pieces = system.branches(i)
        mode = pieces[key[i]].branch.mode
        if any(pieces[branch].stops.size for branch in branches) and mode is not None and abs(mode) == 1:
            out.append((i, mode))
    return out


def describe_modes(system: System, key: Key) -> str:
    """The modes of all components in words."""
    words = []
    for i, branch in enumerate(key):
        mode = system.branches(i)[branch].branch.mode
        if mode is not None and system.branch_counts[i] > 1:
            words.append(f"{system.names[i]} {system.components[i].mode_names.get(mode, mode)}")
    return ", ".join(words)


def changes(system: System, old: Key, new: Key) -> Iterator[Change]:
    """Changes of the components' modes between two combinations of branches."""
    for i, (a, b) in enumerate(zip(old, new, strict=True)):
        was, now = (system.branches(i)[branch].branch.mode for branch in (a, b))
        if was is not None and now is not None and was != now:
            yield named_change(system, i, was, now)


def named_change(system: System, i: int, was: int, now: int) -> tuple[str, int, int, str, str]:
    """Component, old and new mode in numbers and in words."""
    names = system.components[i].mode_names
    return system.names[i], was, now, names.get(was, str(was)), names.get(now, str(now))
