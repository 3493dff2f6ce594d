"""What the form of an axis says, and the description that it amounts to."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from app.axes import in_si, units_of
from sim.errors import ParameterError

MOST_STAGES = 4


@dataclass(frozen=True)
class Field:
    """One number of a table of the description, and what it is called."""

    table: str
    key: str
    words: str
    hint: str = ""
    is_needed: bool = False

    @property
    def name(self) -> str:
        return f"{self.table}.{self.key}"

    @property
    def units(self) -> list[str]:
        return [unit for unit in units_of(self.key) if unit]


FIELDS = (
    Field("motor", "inertia_kg_m2", "Inertia of the motor", "with all that turns on its shaft; empty if nobody knows"),
    Field("motor", "coulomb_friction_n_m", "Dry friction of the motor"),
    Field("motor", "viscous_friction_n_m_s_per_rad", "Viscous friction of the motor"),
    Field("load", "inertia_kg_m2", "Inertia of the load", "arm and payload; 0 where all is counted at the motor", True),
    Field("load", "coulomb_friction_n_m", "Dry friction of the joint"),
    Field("load", "viscous_friction_n_m_s_per_rad", "Viscous friction of the joint"),
    Field("transmission", "stiffness_n_m_per_rad", "Stiffness of the whole gear", "at the output, the motor locked"),
    Field("motion", "load_speed_rad_s", "Largest speed of the output", "in its usual motion"),
)
STAGE = (
    Field("stages", "driver_teeth", "Teeth of the driver"),
    Field("stages", "driven_teeth", "Teeth of the driven gear"),
    Field("stages", "ratio", "Ratio", "instead of teeth"),
    Field("stages", "inertia_kg_m2", "Inertia", "of the driven shaft"),
    Field("stages", "mesh_efficiency", "Efficiency", "0 to 1"),
    Field("stages", "stiffness_n_m_per_rad", "Stiffness", "at the driven gear"),
    Field("stages", "backlash_rad", "Backlash as new", "at most"),
)
TEETH = ("driver_teeth", "driven_teeth")


def copied(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what another axis of the same kind has: not the name, and not what was found in this one."""
    return {key: value for key, value in document.items() if key not in ("name", "mechanisms")}


def in_words(wrong: str, given: Mapping[str, str]) -> str:
    """Say what is wrong with a description by the words of the form.

    >>> in_words("load.inertia_kg_m2: missing; it has no default", {})
    'Inertia of the load: is needed'
    >>> in_words("stages[0].ratio: must be > 0", {"stages.2.name": "output"})
    'Ratio of output: must be > 0'
    """
    names = [given[f"stages.{k}.name"].strip() for k in range(MOST_STAGES) if given.get(f"stages.{k}.name", "").strip()]
    for place, name in enumerate(names):
        wrong = wrong.replace(f"stages[{place}]", name)
        for field in STAGE:
            wrong = wrong.replace(f"{name}.{field.key}", f"{field.words} of {name}")
    for field in FIELDS:
        wrong = wrong.replace(field.name, field.words)
    return wrong.replace("missing; it has no default", "is needed")


def filled(document: Mapping[str, Any]) -> dict[str, str]:
    """Return what stands in the fields for a description: SI units, as short as they are exact."""
    values = {"name": str(document.get("name", ""))}
    for field in FIELDS:
        values[field.name] = _text(document.get(field.table, {}).get(field.key))
    for number, stage in enumerate(document.get("stages", ())):
        values[f"stages.{number}.name"] = str(stage["name"])
        teeth = stage.get("driver_teeth") is not None
        for field in STAGE:
            shown = None if teeth and field.key == "ratio" else stage.get(field.key)
            values[f"stages.{number}.{field.key}"] = _text(shown)
    return values


def _text(value: float | None) -> str:
    if value is None:
        return ""
    short = f"{value:.12g}"
    return short if float(short) == value else repr(value)


def described(given: Mapping[str, str], before: Mapping[str, Any]) -> dict[str, Any]:
    """Return the description that the fields make of the one before, of which all else is kept.

    Raises:
        ParameterError: where a field has no number, or a unit that is not its own.
    """
    document: dict[str, Any] = {key: value for key, value in before.items() if key != "stages"}
    document["name"] = given.get("name", "").strip()
    for field in FIELDS:
        table = {**document.get(field.table, {})}
        table.pop(field.key, None)
        if text := given.get(field.name, "").strip():
            table[field.key] = in_si(field.name, text, given.get(f"{field.name}.unit", ""))
        document[field.table] = table
    known = {stage["name"]: stage for stage in before.get("stages", ())}
    stages = [
        _stage(given, number, known)
        for number in range(max(MOST_STAGES, len(known)))
        if given.get(f"stages.{number}.name", "").strip()
    ]
    optional = {"transmission", "motion"}
    return {key: value for key, value in document.items() if value or key not in optional} | {"stages": stages}


def _stage(given: Mapping[str, str], number: int, known: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    name = given[f"stages.{number}.name"].strip()
    own = {field.key for field in STAGE}
    stage = {key: value for key, value in known.get(name, {}).items() if key not in own} | {"name": name}
    for field in STAGE:
        if text := given.get(f"stages.{number}.{field.key}", "").strip():
            value = in_si(f"{name}.{field.key}", text, given.get(f"{field.name}.unit", ""))
            if field.key in TEETH and not value.is_integer():
                raise ParameterError(f"{field.words} of {name}: must be a whole number, got {text}.")
            stage[field.key] = int(value) if field.key in TEETH else value
    return stage
