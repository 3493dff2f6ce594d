"""Units in which logs are written, and what one of each is of the unit of a channel."""

import math
from collections.abc import Mapping
from types import MappingProxyType

from signals.telemetry import CHANNELS, TIME

ISO8601, FORMAT, SAMPLE, COUNT = "iso8601", "format", "sample", "count"
TIMES: Mapping[str, float] = MappingProxyType({"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9})
"""[s] per unit; `iso8601`, `format` and `sample` stand beside them."""
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
BRACKETS = " []()<>{}"
WITH_FACTOR = ("A", "%")
"""Units of a torque that only a factor [N m per unit] makes one."""


def _key(text: str) -> str:
    """How a unit is looked up: in small letters, but for those of one letter, where size tells."""
    return text if len(text) == 1 else text.lower()


SPELLINGS: Mapping[str, str] = MappingProxyType(
    {
        **{_key(unit): unit for unit in (*TIMES, COUNT, *WITH_FACTOR)},
        **{_key(unit): unit for each in QUANTITIES.values() for unit in each},
        **dict.fromkeys(("sec", "secs", "second", "seconds", "sek", "sekunden"), "s"),
        **dict.fromkeys(("msec", "msecs", "millisec", "millisecond", "milliseconds"), "ms"),
        **dict.fromkeys(("\u00b5s", "\u03bcs", "usec", "usecs", "microsecond", "microseconds"), "us"),
        **dict.fromkeys(("nsec", "nsecs", "nanosecond", "nanoseconds"), "ns"),
        **dict.fromkeys(("radian", "radians"), "rad"),
        **dict.fromkeys(("\u00b0", "degree", "degrees"), "deg"),
        **dict.fromkeys(("turn", "turns", "revs", "revolution", "revolutions", "umdrehungen"), "rev"),
        **dict.fromkeys(("counts", "inc", "incs", "increment", "increments", "inkremente", "tick", "ticks"), COUNT),
        **dict.fromkeys(("radps", "rad/sec", "radians/s", "rad*s^-1", "rad s^-1", "rad s-1"), "rad/s"),
        **dict.fromkeys(("\u00b0/s", "dps", "deg/sec", "degrees/s"), "deg/s"),
        **dict.fromkeys(("turn/s", "turns/s", "revs/s", "rev/sec", "rps", "u/s"), "rev/s"),
        **dict.fromkeys(("1/min", "r/min", "rev/min", "u/min", "umdr/min", "min-1", "min^-1", "/min"), "rpm"),
        **dict.fromkeys(("nm", "n m", "n-m", "n*m", "n\u00b7m", "n\u22c5m", "n\u2219m", "newton meter"), "N.m"),
        **dict.fromkeys(("mnm", "mn m", "mn*m", "mn\u00b7m", "mn\u22c5m"), "mN.m"),
        **dict.fromkeys(("amp", "amps", "ampere", "amperes", "arms", "aeff", "a rms", "ma", "milliampere"), "A"),
        **dict.fromkeys(("percent", "per cent", "prozent", "\u2030", "permille", "0.1%", "0.1 %"), "%"),
        **dict.fromkeys(("\u00b0c", "C", "celsius", "deg c"), "degC"),
    }
)
"""By what stands in logs (`_key`): the unit. A and % also stand for their like (mA, thousandths), since the factor
is of what stands in the column."""
OTHERS = frozenset({"", "-", "V", "mv", "W", "kw", "K", "hz", "rad/s^2", "deg/s^2", "m/s^2"})
"""Units of what is no channel, which may stand among units."""


def unit_of(text: str) -> str | None:
    """Return the unit that a text is, or None where it is none of those that channels come in.

    >>> unit_of("[N\u00b7m]"), unit_of("1/min"), unit_of("knots")
    ('N.m', 'rpm', None)
    """
    return SPELLINGS.get(_key(text.strip(BRACKETS)))


def are_units(cells: tuple[str, ...]) -> bool:
    """Whether a row has units and nothing else.

    >>> are_units(("[ms]", "rpm", "")), are_units(("time", "rpm", ""))
    (True, False)
    """
    return all(unit_of(cell) is not None or _key(cell.strip(BRACKETS)) in OTHERS for cell in cells)


def units_of(channel: str) -> tuple[str, ...]:
    """Return the units that a column of a channel, or of the clock, may have."""
    if channel == TIME:
        return (*TIMES, ISO8601, FORMAT, SAMPLE)
    quantity = CHANNELS[channel]
    more = (COUNT,) if quantity == "rad" else WITH_FACTOR if quantity == "N m" else ()
    return (*QUANTITIES[quantity], *more)
