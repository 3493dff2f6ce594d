"""Names that a record cannot tell apart are not said alone, however well each of them fits."""

from dataclasses import replace

import numpy as np
import pytest

from signals.telemetry import Telemetry
from sim.assembly import drive_train_of
from sim.description.axis_document import read_axis
from sim.errors import AxisError
from sim.investigation.assessment.remarks import shown_remark
from sim.investigation.assessment.verdict import is_beyond_new
from sim.investigation.data.data_fault import InvestigationError
from sim.investigation.data.excitation import Excitation
from sim.investigation.hypotheses.identifiability import ALONE, passed_slowly, shown
from sim.investigation.investigate import investigate
from sim.investigation.pooling.joint_investigation import investigate_together
from sim.investigation.pooling.pooled_estimates import NamedRecording
from sim.investigation.results import Estimate
from sim.mechanisms.mechanism import Need

INERTIA = 0.3
BARE = read_axis({"motor": {"inertia_kg_m2": INERTIA}, "load": {"inertia_kg_m2": 0.0}})


def moved(angle_speed_acceleration: tuple[np.ndarray, ...], rate_hz: float, seed: int = 1) -> Telemetry:
    """Dry friction of 1 N m and viscous friction along a motion, with noise and an encoder of 16 bits."""
    angle, speed, acceleration = angle_speed_acceleration
    rng = np.random.default_rng(seed)
    torque = INERTIA * acceleration + np.tanh(speed / 0.3) + 0.02 * speed + 0.05 * rng.standard_normal(angle.size)
    step = 2.0 * np.pi / 2**16
    time = np.arange(angle.size) / rate_hz
    return Telemetry(time, {"motor_torque_nm": torque, "motor_position_rad": np.round(angle / step) * step})


def one_way(rate_hz: float = 200.0, seed: int = 1) -> Telemetry:
    t = np.arange(int(20.0 * rate_hz)) / rate_hz
    motion = 30.0 * t - 40.0 * np.cos(0.5 * t), 30.0 + 20.0 * np.sin(0.5 * t), 10.0 * np.cos(0.5 * t)
    return moved(motion, rate_hz, seed)


def to_and_fro(rate_hz: float) -> Telemetry:
    t = np.arange(int(60.0 * rate_hz)) / rate_hz
    return moved((40.0 * np.sin(t), 40.0 * np.cos(t), -40.0 * np.sin(t)), rate_hz)


def test_one_way_dry_friction_is_one_of_three_names() -> None:
    result = investigate(BARE, one_way())
    said = {f.mechanism: f for f in result.findings}
    dry = said["coulomb_friction"]
    assert dry.probability == ALONE
    assert set(dry.indistinguishable_from) == {"friction_asymmetry", "torque_offset"}
    assert dry.lacks == (Need.BOTH_DIRECTIONS.value,)
    assert said.keys() <= {"coulomb_friction", "viscous_friction"}
    assert said["viscous_friction"].probability > 0.9  # its speeds are several
    assert any("motion in both directions" in remark for remark in result.remarks)
    assert result.remarks[0].startswith("200 rows per second for ")


def test_two_records_that_lack_the_same_are_no_surer() -> None:
    both = investigate_together(BARE, [NamedRecording(f"{k}.csv", one_way(seed=k)) for k in (1, 2)]).combined
    assert {f.mechanism: f.probability for f in both.findings}["coulomb_friction"] == ALONE


@pytest.mark.parametrize("rate_hz", [10.0, 40.0])
def test_friction_is_named_and_measured_from_ten_rows_a_second(rate_hz: float) -> None:
    found = {f.mechanism: f for f in investigate(BARE, to_and_fro(rate_hz)).findings}
    assert found.keys() == {"coulomb_friction", "viscous_friction"}
    assert all(f.probability > 0.9 for f in found.values())
    assert found["coulomb_friction"].parameters[0].value == pytest.approx(1.0, rel=0.08)
    assert found["viscous_friction"].parameters[0].value == pytest.approx(0.02, rel=0.08)


@pytest.mark.parametrize(
    ("low", "high", "beyond"), [(0.1, 0.3, True), (-0.1, 0.3, False), (-0.3, -0.1, True)], ids=["above", "0", "below"]
)
def test_an_interval_that_holds_the_size_as_new_is_no_finding_to_be_sure_of(
    low: float, high: float, beyond: bool
) -> None:
    size = Estimate("torque_n_m", 0.5 * (low + high), "N m", low, high)
    slope = Estimate("coefficient_n_m_s_per_rad", 0.0, "N m s/rad", -1.0, 1.0)
    assert is_beyond_new(BARE, "friction_asymmetry", "motor", [size, slope]) == beyond
    worn = read_axis(
        {
            "motor": {"inertia_kg_m2": 1.0},
            "stages": [{"name": "output", "ratio": 8, "backlash_rad": 0.2}],
            "load": {"inertia_kg_m2": 1.0},
        }
    )
    gap = Estimate("gap_rad", 0.5 * (low + high), "rad", low, high)
    assert not is_beyond_new(worn, "backlash", "output", [gap])
    assert is_beyond_new(worn, "backlash", "output", [replace(gap, low=0.21)])


def test_a_ripple_of_any_order_is_found_by_the_angle() -> None:
    """Order 72 at one turn per second, shaken by the ripple itself: no line of fixed frequency."""
    rate_hz = 1000.0
    t = np.arange(12_000) / rate_hz
    speed = 6.0 + 1.5 * np.sin(0.7 * t)
    angle = 6.0 * t - 1.5 / 0.7 * np.cos(0.7 * t)
    rng = np.random.default_rng(5)
    torque = INERTIA * 1.05 * np.cos(0.7 * t) + 1.0 + 0.3 * np.sin(72.0 * angle + 0.4) + 0.02 * speed
    told = Telemetry(t, {"motor_torque_nm": torque + 0.05 * rng.standard_normal(t.size), "motor_position_rad": angle})
    ripple = next(f for f in investigate(BARE, told).findings if f.mechanism == "torque_ripple")
    numbers = {e.name: e.value for e in ripple.parameters}
    assert ripple.probability > 0.9
    assert numbers["order"] == 72.0
    assert numbers["torque_n_m"] == pytest.approx(0.3, rel=0.15)


def test_an_inertia_that_nobody_knows_is_found_and_no_simulation_goes_without() -> None:
    unknown = read_axis({"motor": {}, "load": {"inertia_kg_m2": 0.0}})
    with pytest.raises(AxisError, match=r"motor\.inertia_kg_m2: not described"):
        drive_train_of(unknown)
    result = investigate(unknown, to_and_fro(200.0))
    (inertia,) = [each for each in result.document()["parameters"] if each["name"] == "motor.inertia_kg_m2"]
    assert inertia["nominal"] is None
    assert inertia["estimate"] == pytest.approx(INERTIA, rel=0.05)
    assert inertia["low"] < INERTIA < inertia["high"]
    assert {f.mechanism for f in result.findings} == {"coulomb_friction", "viscous_friction"}
    assert result.extended.motor.inertia_kg_m2 == pytest.approx(INERTIA, rel=0.05)


def test_a_rotor_that_nobody_knows_may_weigh_nothing_beside_what_it_carries() -> None:
    """All inertia is in the known torque, as in most simulated robots; turned torque is refused all the same."""
    unknown = read_axis({"motor": {}, "load": {"inertia_kg_m2": 0.0}})
    told = to_and_fro(200.0)
    carried = -INERTIA * 40.0 * np.sin(told.time_s)
    result = investigate(unknown, replace(told, channels={**told.channels, "known_torque_nm": carried}))
    assert {f.mechanism for f in result.findings} == {"coulomb_friction", "viscous_friction"}
    turned = replace(told, channels={**told.channels, "motor_torque_nm": -told["motor_torque_nm"]})
    with pytest.raises(InvestigationError, match="the sign of torque or of position is turned"):
        investigate(unknown, turned)


WRIST = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.004},
        "stages": [{"name": "output", "driver_teeth": 11, "driven_teeth": 330, "stiffness_n_m_per_rad": 3e4}],
        "load": {"inertia_kg_m2": 4.0},
    }
)


def steady(rate_hz: float, turns_per_s: float, at_load: bool = False) -> Excitation:
    """A minute at one speed of the motor."""
    speed = np.full(int(60 * rate_hz), 2.0 * np.pi * turns_per_s)
    return Excitation(rate_hz, 60.0, 2.0 * np.pi * 60.0 * turns_per_s, speed, at_load)


@pytest.mark.parametrize(("turns_per_s", "is_shown"), [(4.5, True), (4.6, False)])
def test_teeth_are_shown_while_they_pass_slower_than_half_the_rate(turns_per_s: float, is_shown: bool) -> None:
    """Eleven teeth per turn of the motor at 100 rows per second: 4.545 turns per second are the limit."""
    e = steady(100.0, turns_per_s)
    assert ("mesh_error" in shown(WRIST, e).found) == ("tooth_damage" in shown(WRIST, e).found) == is_shown
    assert (passed_slowly(WRIST, e, "output") > 0) == is_shown
    assert (Need.TWO_ROWS_PER_TOOTH in shown(WRIST, e).hidden) != is_shown
    assert "Teeth of output pass" not in shown_remark(WRIST, e) or not is_shown
