"""One body whose equation is closed: what is missing is named, what is there is calibrated, silence otherwise."""

import json
import math

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import one_body, swing
from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate
from sim.investigation.results import Investigation


def axis(coulomb: float = 1.0, viscous: float = 0.02, inertia: float = 0.3) -> Axis:
    motor = {"inertia_kg_m2": inertia, "coulomb_friction_n_m": coulomb, "viscous_friction_n_m_s_per_rad": viscous}
    return read_axis({"name": "bench", "motor": motor, "load": {"inertia_kg_m2": 0.0}})


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_is_found_where_nothing_is_missing(seed: int) -> None:
    result = investigate(axis(), one_body(0.3, 1.0, 0.02, seed))
    assert (result.verdict, result.findings, result.unexplained) == ("nothing_missing", (), None)


def test_wrong_numbers_are_parameters_and_no_findings() -> None:
    result = investigate(axis(inertia=0.27, coulomb=1.15), one_body(0.3, 1.0, 0.02, 4))
    assert result.verdict == "nothing_missing"
    found = {e.name: e.value for e in result.parameters}
    assert found["motor.inertia_kg_m2"] == pytest.approx(0.3, rel=0.01)
    assert found["motor.coulomb_friction_n_m"] == pytest.approx(1.0, rel=0.03)


def test_missing_friction_is_named_with_its_size() -> None:
    result = investigate(axis(coulomb=0.0, viscous=0.0), one_body(0.3, 1.0, 0.02, 5))
    found = {f.mechanism: f for f in result.findings}
    assert set(found) == {"coulomb_friction", "viscous_friction"}
    assert found["coulomb_friction"].parameters[0].value == pytest.approx(1.0, rel=0.05)
    assert found["viscous_friction"].parameters[0].value == pytest.approx(0.02, rel=0.05)
    assert result.gain[0].rms_after < 0.2 * result.gain[0].rms_before


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_friction_that_rises_at_low_speed_is_named(exponent: float) -> None:
    _, _, speed, _ = swing()
    rise = 0.6 * np.exp(-((np.abs(speed) / 6.0) ** exponent)) * np.tanh(speed / 0.01)
    result = investigate(axis(), one_body(0.3, 1.0, 0.02, 6, extra=rise))
    assert [f.mechanism for f in result.findings] == ["stribeck_friction"]
    torque, limit, fall = result.findings[0].parameters
    assert torque.value == pytest.approx(0.6, rel=0.15)
    assert limit.value == pytest.approx(6.0, rel=0.15)
    assert fall.low <= exponent <= fall.high
    assert 1.0 <= fall.low <= fall.high <= 2.0


def test_what_has_a_fixed_frequency_and_no_name_is_unnamed() -> None:
    t, _, _, _ = swing()
    result = investigate(axis(), one_body(0.3, 1.0, 0.02, 8, extra=0.25 * np.sin(2 * math.pi * 17.3 * t)))
    assert result.verdict == "unnamed"
    assert result.unexplained is not None
    assert result.unexplained.numbers["frequency_hz"] == pytest.approx(17.3, abs=0.2)


def hidden(what: str) -> Telemetry:
    """A body with something that its description lacks."""
    t, _, speed, _ = swing()
    extra = {
        "electrical_hum": 0.3 * np.sin(2 * math.pi * 50.0 * t + 0.7),
        "friction_asymmetry": 0.006 * np.abs(speed),
        "stribeck_friction": 0.6 * np.exp(-((speed / 6.0) ** 2)) * np.tanh(speed / 0.01),
        "time_delay": 0.0 * t,
    }[what]
    telemetry = one_body(0.3, 1.0, 0.02, 5, extra=extra)
    if what != "time_delay":
        return telemetry
    channels = dict(telemetry.channels)
    channels["motor_torque_nm"] = np.interp(t - 3e-3, t, channels["motor_torque_nm"])
    return Telemetry(t, channels)


def again(axis: Axis, telemetry: Telemetry) -> tuple[Investigation, Investigation]:
    """What is found, and what is found once that is described."""
    first = investigate(axis, telemetry)
    return first, investigate(read_axis(json.loads(json.dumps(first.document()["extended_axis"]))), telemetry)


@pytest.mark.parametrize("what", ["electrical_hum", "friction_asymmetry", "stribeck_friction", "time_delay"])
def test_what_is_described_is_not_found_again(what: str) -> None:
    first, second = again(axis(), hidden(what))
    assert [f.mechanism for f in first.findings] == [what]
    assert (second.verdict, second.findings) == ("nothing_missing", ())
    assert second.gain[0].rms_before == pytest.approx(first.gain[0].rms_after, rel=0.05)


def test_nothing_is_said_of_a_model_that_does_not_reach_the_measurement() -> None:
    """A torque that mostly has nothing to do with the motion: whatever the fit, nothing may be called complete."""
    t, _, _, _ = swing()
    pushes = np.convolve(np.random.default_rng(1).standard_normal(t.size), np.ones(50) / math.sqrt(50.0), "same")
    result = investigate(axis(), one_body(0.3, 1.0, 0.02, 9, extra=40.0 * pushes))
    assert result.verdict == "unnamed"
    assert any("does not fit" in remark for remark in result.remarks)


def test_the_same_bytes_give_the_same_document_of_finite_numbers() -> None:
    telemetry = one_body(0.3, 1.0, 0.02, 5)
    one, two = (investigate(axis(coulomb=0.0), telemetry).document() for _ in range(2))
    text = json.dumps(one, allow_nan=False)
    assert text == json.dumps(two, allow_nan=False)
    needed = (
        "verdict",
        "findings",
        "unexplained",
        "parameters",
        "gain",
        "next_measurement",
        "extended_axis",
        "provenance",
    )
    assert all(name in one for name in needed)


@pytest.mark.parametrize("size_n_m", [0.5, 0.05])
def test_friction_that_no_law_describes_is_unnamed_with_its_speed(size_n_m: float) -> None:
    """Down to the deviation of the noise: one curve for both directions has half of the numbers of two."""
    _, _, speed, _ = swing()
    band = size_n_m * np.exp(-(((np.abs(speed) - 36.0) / 6.0) ** 2)) * np.sign(speed)
    result = investigate(axis(), one_body(0.3, 1.0, 0.02, 9, extra=band))
    assert result.verdict == "unnamed"
    assert result.unexplained is not None
    assert result.unexplained.kind == "speed"
    assert result.unexplained.numbers["speed_rad_s"] == pytest.approx(36.0, abs=12.0)


@pytest.mark.parametrize("size_n_m", [0.4, 0.02])
def test_friction_over_the_angle_is_unnamed_with_its_order(size_n_m: float) -> None:
    _, angle, speed, _ = swing()
    result = investigate(axis(), one_body(0.3, 1.0, 0.02, 10, extra=size_n_m * np.sign(speed) * np.cos(2 * angle)))
    assert result.verdict == "unnamed"
    assert result.unexplained is not None
    assert result.unexplained.numbers == {"order": 2.0}
