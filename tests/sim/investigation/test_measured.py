"""Measured data with known answers: a real ball screw axis, and the hidden effects of an independent simulation."""

import json

import pytest

from signals.reading.decode import read_recording
from signals.telemetry import read_telemetry
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate
from sim.investigation.results import Investigation
from tests.shared_data import shared

SCREW = {  # Janot, Gautier, Brunot: Data Set and Reference Models of EMPS, 2019
    "coulomb_friction": ("torque_n_m", 20.3935),
    "viscous_friction": ("coefficient_n_m_s_per_rad", 203.5034),
}


def emps(description: str) -> Investigation:
    folder = shared("data", "emps")
    return investigate(read_axis(folder / description), read_telemetry(folder / "telemetry.csv"))


def relative_error(result: Investigation) -> tuple[float, float]:
    force = result.gain[0]
    return force.rms_before / force.rms_measured, force.rms_after / force.rms_measured


def test_friction_of_a_real_screw_is_named_from_inertia_alone() -> None:
    result = emps("axis_inertia_only.toml")
    assert {"coulomb_friction", "viscous_friction"} <= {f.mechanism for f in result.findings}
    before, after = relative_error(result)
    assert 0.65 < before < 0.73
    assert after <= 0.0306  # published: 4.083 % of one friction, 3.112 % of one for each direction
    found = {e.name: e.value for f in result.findings for e in f.parameters if f.mechanism in SCREW}
    for name, published in SCREW.values():
        assert found[name] == pytest.approx(published, rel=0.08)  # by a law that jumps at standstill
    assert result.extended.motor.coulomb_friction_n_m == found["torque_n_m"]  # one document, one number


def test_the_direction_of_a_real_screws_friction_is_named() -> None:
    result = emps("axis_symmetric_friction.toml")
    asymmetry = next(f for f in result.findings if f.mechanism == "friction_asymmetry")
    assert asymmetry.probability > 0.5
    assert asymmetry.indistinguishable_from == ()  # an offset, of the authors' class of causes, is told apart
    assert relative_error(result)[1] <= 0.031


@pytest.mark.slow
@pytest.mark.parametrize("name", [f"d{k:02d}" for k in range(1, 11)])
def test_hidden_effects_of_an_independent_simulation(name: str) -> None:
    folder = shared("challenge", "dev", name)
    answers = {a["id"]: a for a in json.loads(shared("challenge", "dev", "answers.json").read_text())}
    hidden = [pair for pair in answers[name]["answer"] if pair[0] != "unnamed"]
    unnamed = len(hidden) < len(answers[name]["answer"])
    result = investigate(
        read_axis(folder / "axis.toml"), read_telemetry(folder / "telemetry.csv"), read_recording(folder / "sound.wav")
    )
    said = [f for f in result.findings if f.probability >= 0.5]
    assert result.verdict == ("unnamed" if unnamed else "named" if hidden else "nothing_missing")
    assert len(said) == len(hidden)
    numbers = {e.name: e.value for f in said for e in f.parameters}
    if unnamed and result.unexplained is not None:
        numbers.update(result.unexplained.numbers)
    for mechanism, place in hidden:
        match = [f for f in said if mechanism in (f.mechanism, *f.indistinguishable_from)]
        assert match, mechanism
        assert place is None or match[0].location == place
    for size, value in answers[name]["size"].items():
        found = numbers[{"viscous_at_motor_n_m_s_per_rad": "coefficient_n_m_s_per_rad"}.get(size, size)]
        allowed = 0.035 if size == "angle_rad" else 0.15 * abs(value)
        assert abs(found - value) <= allowed, size
