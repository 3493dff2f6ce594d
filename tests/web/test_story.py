"""The panels of an investigation show an effect where it was put, and that the better model takes it away."""

from typing import Any

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import one_body, swing
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate
from sim.investigation.report.summary import story
from sim.investigation.results import Investigation

MOTOR = {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}


def investigated(extra: np.ndarray[Any, np.dtype[np.float64]] | float, seed: int) -> Investigation:
    axis = read_axis({"name": "one body", "motor": MOTOR, "load": {"inertia_kg_m2": 0.0}})
    return investigate(axis, one_body(0.3, 1.0, 0.02, seed, extra=extra))


def panel(told: dict[str, Any], part: str, title: str) -> tuple[dict[str, Any], dict[str, Any]]:
    found = next(one for one in told[part] if one["title"] == title)
    return found, {line["name"]: np.array(line["y"], dtype=np.float64) for line in found["lines"]}


@pytest.fixture(scope="module")
def rising() -> dict[str, Any]:
    """Friction that rises at low speed, which the description lacks."""
    _, _, speed, _ = swing()
    return story(investigated(0.6 * np.exp(-((speed / 6.0) ** 2)) * np.tanh(speed / 0.01), 6))


def test_friction_lives_at_its_speed_and_is_taken_away(rising: dict[str, Any]) -> None:
    found, lines = panel(rising, "residual", "Motor torque by speed and direction")
    speed = np.abs(np.array(found["x"]))
    before, after = lines["description, calibrated"], lines["with what was found"]
    assert speed[np.nanargmax(before)] < 6.0
    floor = found["noise"][1]
    assert np.nanmax(before) > 2 * floor
    assert np.nanmax(after) < 1.5 * floor


def test_measured_less_simulated_is_what_is_left(rising: dict[str, Any]) -> None:
    """Overlay and residual are two panels of the same numbers, where the axis moves."""
    _, overlay = panel(rising, "overlay", "Motor torque: measured and simulated")
    _, left = panel(rising, "overlay", "Motor torque: residual")
    for name, values in left.items():
        difference = overlay["measured"] - overlay[name]
        moving = np.isfinite(values)
        assert moving.sum() > 0.5 * values.size
        scale = np.abs(overlay["measured"]).max()
        assert np.abs(difference - values)[moving].max() < 2e-3 * scale


def test_a_right_model_leaves_its_noise_floor() -> None:
    found, lines = panel(story(investigated(0.0, 9)), "overlay", "Motor torque: residual")
    left = lines["description, calibrated"]
    assert found["noise"][1] / 2 == pytest.approx(np.nanstd(left), rel=0.25)


def test_a_line_stands_at_its_frequency_above_the_floor() -> None:
    """A torque of 0.3 N m at 37 Hz that nothing names: 10 log10(0.3² / 2 / 0.75 Hz) in the spectrum of what is left."""
    time, *_ = swing()
    told = story(investigated(0.3 * np.sin(2 * np.pi * 37.0 * time), 8))
    found, lines = panel(told, "overlay", "Motor torque, spectrum: residual")
    left = lines["description, calibrated"]
    at = int(np.nanargmax(left))
    assert found["x"][at] == pytest.approx(37.0, abs=0.5)
    assert left[at] == pytest.approx(10 * np.log10(0.3**2 / 2 / 0.75), abs=2.0)
    assert left[at] > lines["noise floor"][at] + 10


def test_spectra_left_and_right_are_of_the_same_rows() -> None:
    """A torque at 120 Hz, far above all that moves the axis, is as loud in what was measured as in what is left.

    It is there while the axis is slow alone, where many rows do not count: of all rows it would be 1.2 dB louder on the
    left.
    """
    time, _, speed, _ = swing()
    told = story(investigated(2.0 * np.sin(2 * np.pi * 120.0 * time) * (np.abs(speed) < 12.0), 5))
    found, overlay = panel(told, "overlay", "Motor torque, spectrum: measured and simulated")
    _, left = panel(told, "overlay", "Motor torque, spectrum: residual")
    near = np.abs(np.array(found["x"]) - 120.0) < 2.0
    assert np.abs(overlay["measured"] - left["description, calibrated"])[near].max() < 0.5
