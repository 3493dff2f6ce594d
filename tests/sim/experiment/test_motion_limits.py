"""What a motion cannot show, by the closed forms of a turn and of Newton at the output."""

import math

import pytest

from signals.motion_profile import MotionProfile
from sim.description.axis import Load
from sim.description.axis_document import read_axis
from sim.experiment.motion_limits import braking_torques, not_covered, turn_shares

AXIS = read_axis(
    {
        "motor": {"inertia_kg_m2": 1e-3},
        "load": {"inertia_kg_m2": 10, "coulomb_friction_n_m": 30},
        "stages": [{"name": "first", "ratio": 4, "inertia_kg_m2": 0.01}, {"name": "output", "ratio": 8}],
    }
)
SLOW, QUICK = (MotionProfile("trapezoid", 0.5, 1.0, time) for time in (0.4, 0.25))


def test_gears_of_less_than_a_turn_are_named_by_their_share() -> None:
    assert turn_shares(AXIS, 0.5) == pytest.approx({"first": 0.5 * 8 / math.tau, "output": 0.5 / math.tau})
    assert turn_shares(AXIS, 1.0) == pytest.approx({"output": 1 / math.tau})
    assert turn_shares(AXIS, 6.28) == {}


def test_braking_turns_the_torque_where_inertia_gives_more() -> None:
    load = Load(10.0, 30.0, 2.0)
    assert braking_torques(load, SLOW) == pytest.approx((25.0, 30.0), rel=1e-6)
    assert braking_torques(load, QUICK) == pytest.approx((40.0, 30.0), rel=1e-6)
    sine = MotionProfile("sine", 2.0, 2.0)  # decelerates most at its end, by 2 v^2 / stroke
    assert braking_torques(load, sine) == pytest.approx((40.0, 30.0), rel=0.01)


def test_what_tests_the_rest_is_proposed() -> None:
    torque = [each for each in not_covered(AXIS, SLOW) if "torque" in each]
    assert len(torque) == 1
    assert "3 rad/s2" in torque[0]
    assert not any("torque" in each for each in not_covered(AXIS, QUICK))
    assert not any("torque" in each for each in not_covered(AXIS, SLOW, payload_kg_m2=13.0))
    assert any("6.28 rad" in each for each in not_covered(AXIS, QUICK) if "output" in each)
    assert not_covered(AXIS, MotionProfile("trapezoid", 6.3, 1.0, 0.25)) == ()
