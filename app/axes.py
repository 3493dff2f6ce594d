"""What people give and get of an axis: its description's JSON schema, templates of usual gear units, units of numbers.

Ratio, efficiency and backlash (0.5 to 6 arc minutes) of the templates are those that catalogues of such units usually
give; inertias are placeholders of the size of a medium robot joint.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter
from sqlalchemy.orm import Session

from casebase.axes import is_axis, near_names, unknown_axis
from casebase.errors import InvalidRequestError, NotFoundError
from casebase.gearboxes import gearbox_names, is_gearbox
from sim.description.axis import SCHEMA, Axis
from sim.errors import ParameterError

DESCRIPTION = "An axis description: `axis.toml`, or the same as JSON; SI units, named in the keys."
MOTOR = {"inertia_kg_m2": 0.0005}
LOAD = {"inertia_kg_m2": 5.0}
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


def axis_schema() -> dict[str, Any]:
    """Return the schema of what `read_axis` takes, whole, with no reference to elsewhere."""
    schema = TypeAdapter(Axis).json_schema()
    definitions = schema.pop("$defs")
    for made in definitions.values():
        made["additionalProperties"] = False
    entry = definitions["MechanismEntry"]
    del entry["properties"]["parameters"]  # they stand in the table itself
    entry |= {"required": ["name"], "additionalProperties": {"type": "number"}}
    del schema["properties"]["motion_keys"]  # what the reader notes
    properties = {"schema": {"type": "string", "const": SCHEMA, "default": SCHEMA}, **schema["properties"]}
    schema |= {"description": DESCRIPTION, "properties": properties, "required": ["motor", "load"]}
    whole: dict[str, Any] = _inlined(schema | {"additionalProperties": False}, definitions)
    return whole


def _inlined(part: Any, definitions: dict[str, Any]) -> Any:
    if isinstance(part, list):
        return [_inlined(one, definitions) for one in part]
    if not isinstance(part, dict):
        return part
    if "$ref" in part:
        return _inlined(definitions[part["$ref"].rpartition("/")[2]], definitions)
    infinite = isinstance(part.get("default"), float) and not math.isfinite(part["default"])
    return {
        key: _inlined(value, definitions)
        for key, value in part.items()
        if not (key == "default" and infinite) and not (key == "title" and isinstance(value, str))
    }


@dataclass(frozen=True)
class Template:
    """A usual gear unit: words, and its stages as in a description."""

    words: str
    stages: tuple[Mapping[str, Any], ...]

    def document(self, name: str) -> dict[str, Any]:
        """Return the description of an axis that has it."""
        stages = [dict(stage) for stage in self.stages]
        return {"name": name, "motor": dict(MOTOR), "load": dict(LOAD)} | ({"stages": stages} if stages else {})


TEMPLATES = {
    "spur": Template(
        "Spur or helical gears, two stages",
        (
            {"name": "first", "driver_teeth": 17, "driven_teeth": 85, "inertia_kg_m2": 0.001, "mesh_efficiency": 0.98},
            {"name": "output", "driver_teeth": 15, "driven_teeth": 90, "backlash_rad": 1.2e-3},
        ),
    ),
    "planetary": Template("Planetary gear, one stage", ({"name": "output", "ratio": 10.0, "backlash_rad": 0.9e-3},)),
    "cycloidal": Template(
        "Cycloidal gear with a spur stage before it (RV)",
        (
            {"name": "spur", "ratio": 3.0, "inertia_kg_m2": 0.001},
            {"name": "cycloid", "ratio": 40.0, "mesh_efficiency": 0.85, "backlash_rad": 0.3e-3},
        ),
    ),
    "strain_wave": Template(
        "Strain wave gear",
        ({"name": "flexspline", "ratio": 100.0, "mesh_efficiency": 0.75, "backlash_rad": 0.15e-3},),
    ),
    "worm": Template(
        "Worm gear",
        ({"name": "wheel", "ratio": 40.0, "mesh_efficiency": 0.7, "backlash_rad": 1.7e-3},),
    ),
    "belt": Template(
        "Toothed belt", ({"name": "pulley", "driver_teeth": 20, "driven_teeth": 60, "mesh_efficiency": 0.97},)
    ),
    "direct": Template("No gear: the motor turns the load", ()),
}


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


def check_known(session: Session, name: str) -> None:
    """Refuse the name of an axis that nothing knows.

    Raises:
        NotFoundError: naming those that are described.
    """
    if not is_axis(session, name):
        raise NotFoundError(unknown_axis(session, name))


def check_place(session: Session, fields: Mapping[str, object]) -> None:
    """Refuse an axis that nothing knows, and a gearbox that looks like another, unless the form says that it is new."""
    axis, gearbox = str(fields.get("axis") or "") or None, str(fields.get("gearbox") or "")
    if axis and not fields.get("new_axis") and not is_axis(session, axis):
        words = unknown_axis(session, axis)
        raise InvalidRequestError(f"{words}. Choose one of the list, or tick that it is a new axis.")
    if gearbox and not fields.get("new_gearbox") and not is_gearbox(session, axis, gearbox):
        others = near_names(gearbox, gearbox_names(session, axis, most=5000))
        if others:
            where = f" at axis {axis!r}" if axis else ""
            words = f"No gearbox {gearbox!r} is known{where}; near it is {' or '.join(map(repr, others))}."
            raise InvalidRequestError(f"{words} Choose one of the list, or tick that it is a new gearbox.")
