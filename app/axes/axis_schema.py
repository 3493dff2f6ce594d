"""The JSON schema of an axis description, made from the dataclasses that read it."""

import math
from typing import Any

from pydantic import TypeAdapter

from sim.description.axis import SCHEMA, Axis

DESCRIPTION = "An axis description: `axis.toml`, or the same as JSON; SI units, named in the keys."


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
