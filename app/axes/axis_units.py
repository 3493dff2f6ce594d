"""Units in which people have the numbers of an axis: each quantity of a description and what it may be given in."""

import math
import re

from sim.errors import ParameterError

ARC_MINUTE = math.pi / 10800
PER_THOUSAND_RPM = 60 / (2000 * math.pi)
UNITS: dict[str, dict[str, float]] = {
    "kg_m2": {"kg m2": 1.0, "kg cm2": 1e-4, "g cm2": 1e-7},
    "n_m": {"N m": 1.0, "mN m": 1e-3},
    "n_m_s_per_rad": {"N m s/rad": 1.0, "N m/1000 rpm": PER_THOUSAND_RPM},
    "n_m_per_rad": {"N m/rad": 1.0, "N m/arcmin": 1 / ARC_MINUTE},
    "rad": {"rad": 1.0, "mrad": 1e-3, "arcmin": ARC_MINUTE, "deg": math.pi / 180},
    "rad_s": {"rad/s": 1.0, "rpm": 2 * math.pi / 60, "deg/s": math.pi / 180},
    "s": {"s": 1.0, "ms": 1e-3},
}
"""By the unit at the end of a key: words of units and their factor to SI; the first one is SI."""
QUANTITY = re.compile(r"\s*([-+]?[0-9]*[.,]?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(.*)")


def units_of(key: str) -> dict[str, float]:
    """Return what a key of a description may be given in; its own unit alone where there is no other.

    >>> list(units_of("backlash_rad"))
    ['rad', 'mrad', 'arcmin', 'deg']
    """
    endings = sorted((ending for ending in UNITS if key.endswith(f"_{ending}")), key=len)
    return UNITS[endings[-1]] if endings else {"": 1.0}


def in_si(key: str, text: str, unit: str = "") -> float:
    """Return a number that somebody gave for a key, in SI; a unit may stand behind it. A decimal comma is one.

    >>> round(in_si("backlash_rad", "1 arcmin"), 7), in_si("inertia_kg_m2", "0,5", "kg cm2")
    (0.0002909, 5e-05)

    Raises:
        ParameterError: saying what would be right.
    """
    found = QUANTITY.fullmatch(text)
    known = units_of(key)
    if found is None:
        raise ParameterError(f"{key}: must be a number such as 2.5, got {text!r}.")
    given = found[2].strip().replace("²", "2") or unit or next(iter(known))
    if given not in known:
        raise ParameterError(f"{key}: the unit {given!r} is not known; give {' or '.join(known)}.")
    value, factor = float(found[1].replace(",", ".")), known[given]
    return value if factor == 1.0 else float(f"{value * factor:.12g}")
