# ruff: noqa: E501
"""What to do now about a finding, and the one measurement that would settle it; for every mechanism and every fault."""

from __future__ import annotations

import math
from collections.abc import Mapping

from sim.description.axis import Axis
from sim.investigation.report.formatting import angle
from sim.mechanisms.catalogue import kind_or_any

BROKEN_FORM = 6.0  # of a dent, from which on it has steep edges
SURE = 0.9
SHOWN_RAD = 0.006  # to which an angle is said


def of_the_measurement(mechanism: str) -> bool:
    """Whether it is one of sensors, cables and recorders: nothing is wrong with the machine."""
    return kind_or_any(mechanism).kind == "measurement"


def action(axis: Axis, mechanism: str, location: str | None, numbers: Mapping[str, float], probability: float) -> str:
    """What to do now; of a name that is not sure, to measure first."""
    text = _filled(kind_or_any(mechanism).action, axis, location, numbers)
    first = "" if probability >= SURE else measurement(axis, mechanism, location, numbers)
    return f"Measure first: {first} Then: {text}" if first else text


def measurement(axis: Axis, mechanism: str, location: str | None, numbers: Mapping[str, float]) -> str:
    """The measurement that tells a mechanism from what looks like it."""
    return _filled(kind_or_any(mechanism).check, axis, location, numbers)


def tooth(axis: Axis, location: str | None, angle_rad: float) -> str:
    """Which tooth of a driven gear is in mesh at an angle, where its teeth are known.

    >>> from sim.description.axis_document import read_axis
    >>> gear = {"name": "output", "driver_teeth": 12, "driven_teeth": 150, "inertia_kg_m2": 1}
    >>> axis = read_axis({"motor": {"inertia_kg_m2": 1}, "load": {"inertia_kg_m2": 1}, "stages": [gear]})
    >>> tooth(axis, "output", 2.7)
    'tooth 65 of 150'
    """
    teeth = next((stage.driven_teeth for stage in axis.stages if stage.name == location), None)
    if not teeth:
        return ""
    place = int((angle_rad % (2.0 * math.pi)) / (2.0 * math.pi) * teeth) + 1
    return f"tooth {place} of {teeth}"


def place_of(axis: Axis, location: str | None, numbers: Mapping[str, float]) -> str:
    """Where something is: degrees, tooth and how often it comes back, or order or frequency; empty where not known."""
    out = _angle(numbers)
    if "order" in numbers:
        return f"at {numbers['order']:.3g} times per turn of the motor"
    if "frequency_hz" in numbers:
        return f"at {numbers['frequency_hz']:.4g} Hz"
    if not out or "angle_rad" not in numbers:
        return out
    if location in axis.locations and (turns := axis.ratio_from(location or "")) > 1.0 + 1e-9:
        out += f" of this gear, which comes back every {360.0 / turns:.3g}° of the load"
    counted = tooth(axis, location, numbers["angle_rad"])
    return f"{out} ({counted})" if counted else out


def _angle(numbers: Mapping[str, float]) -> str:
    if "angle_from_middle_rad" in numbers:
        return f"{angle(numbers['angle_from_middle_rad'], SHOWN_RAD)} from the middle of the travel"
    return angle(numbers["angle_rad"], SHOWN_RAD) if "angle_rad" in numbers else ""


def _filled(text: str, axis: Axis, location: str | None, numbers: Mapping[str, float]) -> str:
    place = place_of(axis, location, numbers)
    if "tooth" in place:
        place = f"{place.removesuffix(')')}, counted from the one in mesh at 0° as angles grow)"
    given = {
        "where": location or "",
        "place": f"where it is in mesh at {place}" if place else "all around, as its angle is not known",
        "at": _angle(numbers) or "a whole turn",
        "urgency": _urgency(numbers),
        "frequency_hz": numbers.get("frequency_hz", math.nan),
    }
    return " ".join(text.format(**given).split())


def _urgency(numbers: Mapping[str, float]) -> str:
    if numbers.get("form", 0.0) >= BROKEN_FORM:
        return "Before the next shift: the edges are steep, so a piece may have broken out and lie in the gear."
    if "form" in numbers:
        return "Within a week, and without raising speed or payload until then: a worn tooth breaks without further notice."
    return (
        "Within a week, and without raising speed or payload until then: how deep it is, this recording does not tell."
    )
