"""Which sound belongs to which telemetry, and what several files are called; light, for who only takes files in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from sim.errors import AxisError


def check_pairs(telemetries: int, sounds: int) -> None:
    """The k-th sound belongs to the k-th telemetry; sounds alone are recordings of their own.

    Raises
    ------
    AxisError
        where there is nothing to investigate, or a sound without its telemetry.
    """
    if not telemetries and not sounds:
        raise AxisError("nothing to investigate: give telemetry, sound or both")
    if telemetries and sounds > telemetries:
        beside = "one telemetry" if telemetries == 1 else f"{telemetries} telemetries"
        raise AxisError(
            f"{sounds} sounds beside {beside}: give at most one sound for each telemetry, in the same order; "
            "the k-th sound starts with the k-th telemetry"
        )


def distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names that tell recordings apart: of equal ones, each with its place.

    >>> distinct(["a.csv", "b.csv", "a.csv"])
    ('a.csv (1)', 'b.csv', 'a.csv (3)')
    """
    count = Counter(names)
    return tuple(name if count[name] == 1 else f"{name} ({k})" for k, name in enumerate(names, start=1))
