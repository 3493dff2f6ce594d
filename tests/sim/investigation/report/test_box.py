"""The box: beside a size that was found stands what is allowed as new, where that is known."""

from typing import Any

import pytest

from sim.description.axis_document import read_axis
from sim.investigation.report.box import box_of, is_urgent


def found(mechanism: str, parameter: str, location: str = "output") -> dict[str, Any]:
    """A document of one finding."""
    size = {"name": parameter, "value": 0.0009, "unit": "rad", "low": 0.00085, "high": 0.00095}
    said = {"mechanism": mechanism, "location": location, "probability": 0.95, "parameters": [size]}
    said |= {"indistinguishable_from": [], "explanation": "It is there.", "action": "Look."}
    return {"verdict": "named", "findings": [said], "unexplained": None, "next_measurement": ""}


@pytest.mark.parametrize(
    ("mechanism", "parameter", "allowed"),
    [
        ("backlash", "gap_rad", "1.03\N{NO-BREAK SPACE}arc min"),
        ("mesh_error", "amplitude_rad", "0.0344\N{NO-BREAK SPACE}arc min"),
        ("tooth_damage", "depth_rad", ""),
    ],
)
def test_what_a_new_axis_has_at_most_stands_beside_what_was_found(mechanism: str, parameter: str, allowed: str) -> None:
    stage = {"name": "output", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": 1e5}
    stage |= {"backlash_rad": 3e-4, "transmission_error_rad": 1e-5}
    bare = {"name": "bench", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 40.0}}
    axis = read_axis({**bare, "stages": [stage]})
    (entry,) = box_of(found(mechanism, parameter), axis)
    words = entry.sizes[0].words
    assert ("as new at most" in words) == bool(allowed)
    assert allowed in words
    assert entry.sizes[0].interval in words
    assert words in dict(entry.facts)["What"], "on paper too"
    (of_robot,) = box_of(found(mechanism, parameter), None)
    assert "as new" not in of_robot.sizes[0].words, "no description, no limit"


def test_how_sure_is_a_figure_only_where_that_is_calibrated() -> None:
    document = found("backlash", "gap_rad")
    assert box_of(document, None)[0].how_sure == "very likely (95\N{NO-BREAK SPACE}%)"
    document["findings"][0]["calibrated"] = False
    assert box_of(document, None)[0].how_sure == "very likely"


@pytest.mark.parametrize(("low", "high", "way"), [(-45.0, -30.0, "negative"), (3.0, 9.0, "positive"), (-1.0, 2.0, "")])
def test_friction_that_differs_says_in_which_direction(low: float, high: float, way: str) -> None:
    document = found("friction_asymmetry", "coefficient_n_m_s_per_rad", "motor")
    document["findings"][0]["parameters"][0] |= {"low": low, "high": high}
    (entry,) = box_of(document, None)
    assert ("direction" in entry.what) == bool(way)
    assert way in entry.what


@pytest.mark.parametrize(
    ("mechanism", "probability", "urgent"),
    [("tooth_damage", 0.95, True), ("tooth_damage", 0.4, False), ("torque_ripple", 0.95, False)],
)
def test_urgent_is_damage_that_grows_and_that_was_found(mechanism: str, probability: float, urgent: bool) -> None:
    assert is_urgent({"findings": [{"mechanism": mechanism, "probability": probability}]}) == urgent
