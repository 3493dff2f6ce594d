"""Which sound belongs to which telemetry, and what several files are called; light, for who only takes files in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from sim.errors import AxisError

NOT_COMPARED = (
    "recordings from when the axis was new are compared with sound alone: give them with sound and without telemetry, "
    "which needs no comparison"
)


def check_pairs(telemetries: int, sounds: int, as_new: int = 0, *, channel_map: bool = False) -> None:
    """The k-th sound belongs to the k-th telemetry; sounds alone are recordings of their own.

    `as_new`: how many recordings from when the axis was new. `channel_map`: whether one says how telemetry is read.

    Raises
    ------
    AxisError
        where there is nothing to investigate, a sound without its telemetry, nothing to compare as new with, or a
        channel map of no telemetry.
    """
    if not telemetries and not sounds:
        raise AxisError("nothing to investigate: give telemetry, sound or both")
    if channel_map and not telemetries:
        raise AxisError("channels: a channel map says how telemetry is read, and there is none")
    if as_new and (telemetries or not sounds):
        raise AxisError(NOT_COMPARED)
    if telemetries and sounds > telemetries:
        beside = "one telemetry" if telemetries == 1 else f"{telemetries} telemetries"
        raise AxisError(
            f"{sounds} sounds beside {beside}: give at most one sound for each telemetry, in the same order; "
            "the k-th sound starts with the k-th telemetry"
        )


def check_as_new(sounds: Iterable[str], as_new: Iterable[str]) -> None:
    """A recording is not compared with itself; both by their hashes.

    Raises
    ------
    AxisError
        where one is given as both.
    """
    if set(sounds) & set(as_new):
        raise AxisError("as_new: the same recording is given as sound as well; give one of when the axis was new")


def distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names that tell recordings apart: of equal ones, each with its place.

    >>> distinct(["a.csv", "b.csv", "a.csv"])
    ('a.csv (1)', 'b.csv', 'a.csv (3)')
    """
    count = Counter(names)
    return tuple(name if count[name] == 1 else f"{name} ({k})" for k, name in enumerate(names, start=1))
