"""Which combinations of branches may follow: ruled out by the state alone, then tried by how many components change."""

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from sim.piecewise_affine.guard import Guards
from sim.piecewise_affine.system import Array, System

MOST_COMBINATIONS = 200_000
NO_START = "no mode of the drive train holds at the start; give start values that agree with its friction"
MOTION = 1e-3
"""Angles [rad] and speeds [rad/s] of this size are taken to occur; what is rounding beside them is rounding."""
REST = 1e-2
"""Share of the fastest speed so far that every speed may have had, for judging what is rounding."""
Key = tuple[int, ...]
Change = tuple[str, int, int, str, str]


def sizes(system: System, x: Array) -> Array:
    """How large each state may be taken to have been, at least `MOTION`, for judging what is rounding."""
    out = np.abs(x)
    moving = slice(0, 2 * system.freedom)
    out[moving] = np.maximum(out[moving], MOTION)
    return out


def possible_branches(system: System, guards: Guards, x: Array, scale: Array) -> list[list[int]]:
    """Branches of every component that the state x alone does not rule out; `scale` is how large x has been."""
    speeds = slice(system.freedom, 2 * system.freedom)
    scale = scale.copy()
    scale[speeds] = np.maximum(scale[speeds], REST * scale[speeds].max(initial=0.0))
    possible = []
    for i, count in enumerate(system.branch_counts):
        if count == 1:
            possible.append([0])
            continue
        possible.append(guards[i].allowed(x, scale))
    return possible


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
