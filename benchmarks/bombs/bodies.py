"""A body that is right of every route that takes one, and what may stand in its place that is odd."""

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

BIG = "9" * 400
AXIS: dict[str, Any] = {
    "schema": "gearcase-axis/1",
    "name": "axis 4",
    "motor": {"inertia_kg_m2": 0.006, "coulomb_friction_n_m": 0.4, "torque_limit_n_m": 30.0},
    "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 600, "stiffness_n_m_per_rad": 1.5e5}],
    "load": {"inertia_kg_m2": 40.0},
    "motion": {"period_s": 4.2, "load_speed_rad_s": 2.7},
    "mechanisms": [{"name": "backlash", "location": "output", "gap_rad": 1e-3}],
}
METADATA = {"axis": "axis 4", "gearbox": "g 1", "robot": "r", "speed_rad_s": 2.5, "motion_period_s": 2.0, "channel": 0}
QUERY = {"k": 3, "representation": "paper", "weights": {"crest_factor": 2.0}, "label": ["normal"], "axis": "axis 4"}
QUERY |= {"gearbox": ["g 1"], "origin": "measured", "min_similarity": 0.1}
METADATA |= {"reversal_times_s": [0.5, 1.5], "recorded_at": "2026-11-20T14:03:00+01:00", "verified_by": "opened"}
BODIES: dict[tuple[str, str], dict[str, Any]] = {
    ("POST", "/keys"): {"name": "bench 3", "role": "viewer"},
    ("POST", "/axes"): AXIS,
    ("POST", "/simulations"): {
        "axis": AXIS,
        "counts": {"normal": 1},
        "seed": 3,
        "duration_s": 5.0,
        "payload_kg_m2": [20.0, 40.0],
        "per_label": 1,
    },
    ("POST", "/cases"): {
        "diagnosis_id": "{diagnosis}",
        "label": "notch",
        "verified_by": "opened",
        "verification": "opened",
    },
    ("POST", "/alarms/receivers"): {
        "name": "maintenance",
        "kind": "email",
        "address": "gear@example.com",
        "quiet_from": "22:00",
        "quiet_to": "06:00",
    },
    ("POST", "/alarms/rules"): {
        "name": "any fault",
        "kind": "state",
        "axis": "axis 4",
        "least_probability": 0.9,
        "receivers": ["{diagnosis}"],
    },
    ("PATCH", "/cases/{case_id}"): {"label": "normal", "note": "seen", "location": "output", "severity": 1e-3},
    ("PATCH", "/diagnoses/{diagnosis_id}"): {"verdict": "corrected", "label": "notch", "note": "n"},
}
"""A body that is right, of every route that takes JSON."""
PARTS: dict[tuple[str, str], tuple[str, dict[str, Any]]] = {
    ("POST", "/diagnoses"): ("metadata", METADATA),
    ("POST", "/retrievals"): ("query", QUERY),
    ("POST", "/cases"): ("metadata", {**METADATA, "label": "normal"}),
    ("POST", "/investigations"): ("axis", AXIS),
}
"""The same of every form with a part that is JSON, and the name of the part."""
ODD = (
    *("\ud800", "a\udfffb", "\0", "a\x85b", "a\u2028b", "..", "../keys", "a/b", ".", "", " "),
    *("Ось 4", "轴", "a?b#c%", "é" * 200),
    *("x" * 5000, int(BIG), -int(BIG), float("inf"), float("nan"), -1, 0, True, None, [], {}, [int(BIG)]),
    *({"\ud800": 1}, {"a": "\udc00"}, {"\0": {}}),
)  # fmt: skip


def places(document: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield where every value of a document is, itself included."""
    yield path
    if isinstance(document, dict | list):
        for key, value in document.items() if isinstance(document, dict) else enumerate(document):
            yield from places(value, (*path, key))


def with_value(document: Any, path: tuple[str | int, ...], value: object) -> Any:
    changed = deepcopy(document)
    if not path:
        return value
    inner = changed
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return changed


def table(other: str) -> str:
    """A telemetry table with a column besides."""
    rows = (f"{number / 100},{number % 7},{20 + number % 2}" for number in range(200))
    return "\n".join((f"time_s,motor_torque_nm,{other}", *rows))
