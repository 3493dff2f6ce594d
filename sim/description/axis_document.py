"""Axis descriptions as documents: read from TOML, JSON or a mapping with every error named, written back as TOML."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from signals.errors import TextError
from signals.reading.documents import parse_document, parse_foreign
from signals.reading.plain_file import plain_bytes
from sim.description.axis import (
    MOST_TABLES,
    SCHEMA,
    Axis,
    Load,
    LoadEncoder,
    MechanismEntry,
    Motion,
    Motor,
    Servo,
    Stage,
    Transmission,
)
from sim.errors import AxisError, ParameterError, near_match, shown

Table = TypeVar("Table")


def read_axis(source: Path | Mapping[str, object]) -> Axis:
    """Read an axis from a file, TOML or the same as JSON, or from a mapping.

    Raises
    ------
    AxisError
        naming the key, what is wrong with it and what would be right; unknown keys are refused.

    >>> read_axis({"motor": {"inertia_kg_m2": 0.6}, "load": {"inertia_kg_m2": -20}})
    Traceback (most recent call last):
    sim.errors.AxisError: load.inertia_kg_m2: must be >= 0 and <= 1e+09 kg m2, got -20
    """
    document = _parse(source) if isinstance(source, Path) else source
    known = {"schema", *(field.name for field in fields(Axis))} - {"motion_keys"}
    _refuse_unknown("", document, known)
    if document.get("schema", SCHEMA) != SCHEMA:
        raise AxisError(f"schema: must be {SCHEMA!r}, got {document['schema']!r}")
    stages = _array(document, "stages")
    if _mapping(document.get("motor"), "motor").get("inertia_kg_m2") == 0:
        raise AxisError("motor.inertia_kg_m2: must be > 0 kg m2, got 0; leave it out where nobody knows it")
    return Axis(
        name=_text(document.get("name", "axis"), "name"),
        motor=_read(Motor, document.get("motor"), "motor"),
        load=_read(Load, document.get("load"), "load", required=("inertia_kg_m2",)),
        stages=tuple(_read_stage(table, i, len(stages)) for i, table in enumerate(stages)),
        transmission=_read(Transmission, document.get("transmission", {}), "transmission"),
        load_encoder=_read(LoadEncoder, document.get("load_encoder", {}), "load_encoder"),
        motion=_read(Motion, document.get("motion", {}), "motion"),
        servo=_read(Servo, document.get("servo", {}), "servo"),
        mechanisms=tuple(_read_entry(table, i) for i, table in enumerate(_array(document, "mechanisms"))),
        motion_keys=tuple(sorted(_mapping(document.get("motion", {}), "motion"))),
    )


def write_axis(axis: Axis) -> str:
    """Return the axis as TOML text; `read_axis` of it gives an equal axis."""
    import tomli_w

    return tomli_w.dumps(axis.to_mapping())


def parse_axis(text: bytes | str) -> dict[str, object]:
    """Return the document in a text that came from elsewhere, TOML or the same as JSON, parsed in the limited process.

    Raises
    ------
    AxisError
        saying where the text breaks, nests too deeply, takes too long, or has what no database could hold (NUL, half
        a character).

    >>> parse_axis('{"motor": {"inertia_kg_m2": 0.6}}') == parse_axis("motor.inertia_kg_m2 = 0.6")
    True
    """
    try:
        return parse_foreign(text)
    except TextError as error:
        raise AxisError(str(error)) from None


def _parse(path: Path) -> Mapping[str, object]:
    try:
        return parse_document(plain_bytes(path))
    except OSError as error:
        raise AxisError(f"{path.name}: {'no such file' if isinstance(error, FileNotFoundError) else error}") from None
    except TextError as error:
        raise AxisError(f"{path.name}: {error}") from None


def _refuse_unknown(path: str, table: Mapping[str, object], known: set[str]) -> None:
    for key in table:
        if key not in known:
            raise AxisError(f"{path}{key}: unknown key{near_match(str(key), known)}")


def _array(document: Mapping[str, object], key: str) -> list[object]:
    value = document.get(key, [])
    if not isinstance(value, list | tuple):
        raise AxisError(f"{key}: must be an array of tables ([[{key}]]), got {type(value).__name__}")
    if len(value) > MOST_TABLES:
        raise AxisError(f"{key}: {len(value)} tables; an axis has {MOST_TABLES} at most")
    return list(value)


def _text(value: object, path: str) -> str:
    if not isinstance(value, str) or not value.strip() or len(value) > 200:
        raise AxisError(f"{path}: must be a text of 1 to 200 characters, got {shown(value)}")
    return value


LEAST = {
    "motor": "; write [motor], and below it inertia_kg_m2 where that is known",
    "load": "; write [load] and below it inertia_kg_m2 = 0.0 where all that moves is counted at the motor",
}
"""What the tables have at least that every axis needs."""


def _mapping(value: object, path: str) -> Mapping[str, Any]:
    if value is None:
        raise AxisError(f"{path}: missing table [{path}]{LEAST.get(path, '')}")
    if not isinstance(value, Mapping):
        raise AxisError(f"{path}: must be a table, got {type(value).__name__}")
    return value


def _read(kind: type[Table], value: object, path: str, required: tuple[str, ...] = ()) -> Table:
    """Make a description's dataclass of a table; errors carry the path of the key."""
    table = _mapping(value, path)
    _refuse_unknown(f"{path}.", table, {field.name for field in fields(kind)})  # type: ignore[arg-type]
    for key in required:
        if key not in table:
            raise AxisError(f"{path}.{key}: missing; it has no default")
    try:
        return kind(**table)
    except ParameterError as error:
        raise AxisError(f"{path}.{error}") from None


def _read_stage(value: object, i: int, stages: int) -> Stage:
    path = f"stages[{i}]"
    table = dict(_mapping(value, path))
    table.setdefault("name", "output" if i == stages - 1 else f"stage{i + 1}")
    _text(table["name"], f"{path}.name")
    return _read(Stage, table, path, required=("inertia_kg_m2",) if i < stages - 1 else ())


def _read_entry(value: object, i: int) -> MechanismEntry:
    path = f"mechanisms[{i}]"
    table = dict(_mapping(value, path))
    name = _text(table.pop("name", None), f"{path}.name")
    location = table.pop("location", None)
    try:
        return MechanismEntry(name, None if location is None else _text(location, f"{path}.location"), table)
    except ParameterError as error:
        raise AxisError(f"{path}.{error}") from None
