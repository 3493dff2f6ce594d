"""Units in which logs are written, and what one of each is of the unit of a channel."""

import math
from collections.abc import Mapping
from types import MappingProxyType

ISO8601, SAMPLE, COUNT = "iso8601", "sample", "count"
TIMES: Mapping[str, float] = MappingProxyType({"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9})
"""[s] per unit; `iso8601` and `sample` stand beside them."""
QUANTITIES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "rad": {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi, "mrad": 1e-3, "m": 1.0, "mm": 1e-3},
        "rad/s": {
            "rad/s": 1.0,
            "deg/s": math.pi / 180.0,
            "rev/s": 2.0 * math.pi,
            "rpm": math.pi / 30.0,
            "m/s": 1.0,
            "mm/s": 1e-3,
        },
        "N m": {"N.m": 1.0, "mN.m": 1e-3, "N": 1.0},
        "Cel": {"degC": 1.0},
    }
)
"""By the unit of a channel: what one of each unit is of it. A linear axis has N and m where N m and rad stand."""
WITH_FACTOR = ("A", "%")
"""Units of a torque that only a factor [N m per unit] makes one."""
SPELLED = (
    "µs",
    "°",
    "turn",
    "turns",
    "counts",
    "inc",
    "°/s",
    "1/min",
    "Nm",
    "N m",
    "mNm",
    "mN m",
    "mA",
    "V",
    "°C",
    "K",
)
"""Other units, and other ways to write these, that stand below the names of a log."""
WORDS = frozenset({"", *TIMES, COUNT, *WITH_FACTOR, *SPELLED, *(unit for each in QUANTITIES.values() for unit in each)})


def are_units(cells: tuple[str, ...]) -> bool:
    """Whether a row has units and nothing else.

    >>> are_units(("[ms]", "rpm", "")), are_units(("time", "rpm", ""))
    (True, False)
    """
    return all(cell.strip(" []()") in WORDS for cell in cells)
