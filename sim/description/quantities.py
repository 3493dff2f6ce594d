"""Numbers of a description checked by the unit that their name ends with."""

import math
from dataclasses import fields

from sim.errors import ParameterError, number, shown

_UNITS = {
    "_kg_m2": "kg m2",
    "_n_m_s_per_rad": "N m s/rad",
    "_n_m_per_rad": "N m/rad",
    "_n_m": "N m",
    "_rad_s": "rad/s",
    "_per_s": "1/s",
    "_rad": "rad",
    "_s": "s",
}

_MOST = {
    "kg m2": 1e9,
    "N m s/rad": 1e12,
    "N m/rad": 1e15,
    "N m": 1e9,
    "rad/s": 1e6,
    "1/s": 1e6,
    "rad": 1.0,
    "s": 1e5,
    "1": 1e6,
}
"""Far above any axis that is built; beyond them lies a slip of the pen, and then an overflow."""


def check_quantities(table: object, positive: tuple[str, ...] = ()) -> None:
    """Validate every number of a description by the unit in its name; store it as float."""
    for field in fields(table):  # type: ignore[arg-type]
        value = getattr(table, field.name)
        if field.name == "name" or (value is None and field.default is None):
            continue
        if field.name.endswith("_teeth"):
            if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 100_000:
                raise ParameterError(f"{field.name}: must be a whole number from 1 to 100000, got {shown(value)}")
        elif not (field.name.endswith("_limit_n_m") or field.name.endswith("_limit_rad_s")) or value != math.inf:
            object.__setattr__(table, field.name, _number(field.name, value, field.name in positive))


def _number(name: str, value: object, positive: bool) -> float:
    unit = next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix)), "1")
    most = 1.0 if name == "mesh_efficiency" else _MOST[unit]
    if positive or name == "mesh_efficiency" or name.endswith(("_limit_n_m", "_limit_rad_s")):
        return number(name, value, unit, above=0, at_most=most)
    return number(name, value, unit, at_least=0, at_most=most)
