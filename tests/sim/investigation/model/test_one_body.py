"""Rigid gears with one encoder: one body at the motor that feels what moves behind the gears by their ratio."""

from dataclasses import replace

import numpy as np
import pytest

from signals.telemetry import Telemetry
from sim.description.axis import MechanismEntry
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate
from sim.investigation.model.one_body import BY_THE_RATIO, as_described, at_the_motor, is_one_body

AXIS = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.01, "coulomb_friction_n_m": 0.1},
        "stages": [
            {"name": "first", "ratio": 4, "inertia_kg_m2": 0.32},
            {"name": "output", "ratio": 5, "inertia_kg_m2": 4.0},
        ],
        "load": {"inertia_kg_m2": 9.0, "coulomb_friction_n_m": 2.0, "viscous_friction_n_m_s_per_rad": 40.0},
    }
)
LOG = Telemetry(np.arange(3.0), {"motor_position_rad": np.zeros(3), "motor_torque_nm": np.zeros(3)})
OFFSET = MechanismEntry("torque_offset", "motor", {"torque_n_m": 0.2})


def test_power_is_the_same_at_the_motor() -> None:
    """At a speed w: losses 0.1 w + 2 w / 20 + 40 (w / 20)^2, and the energy of gears that turn at w / 4, w / 20."""
    one = at_the_motor(AXIS)
    assert (one.stages, one.ratio) == ((), 1.0)
    assert one.motor.coulomb_friction_n_m == pytest.approx(0.1 + 2.0 / 20.0)
    assert one.motor.viscous_friction_n_m_s_per_rad == pytest.approx(40.0 / 20.0**2)
    assert one.load.inertia_kg_m2 == pytest.approx(0.32 / 4.0**2 + 4.0 / 20.0**2)
    assert at_the_motor(AXIS, 9.0).load.inertia_kg_m2 == pytest.approx(one.load.inertia_kg_m2 + 9.0 / 20.0**2)


def test_what_was_found_at_the_motor_comes_once_to_the_described_gears() -> None:
    found = replace(at_the_motor(AXIS), mechanisms=(OFFSET,))
    extended = as_described(AXIS, found)
    assert extended.stages == AXIS.stages
    assert extended.mechanisms == (OFFSET,)
    assert at_the_motor(extended).motor == found.motor


def test_what_may_act_at_a_gear_is_not_one_body() -> None:
    assert is_one_body(AXIS, LOG)
    elastic = replace(AXIS, stages=(AXIS.stages[0], replace(AXIS.stages[1], stiffness_n_m_per_rad=1e4)))
    loose = replace(AXIS, stages=(AXIS.stages[0], replace(AXIS.stages[1], backlash_rad=1e-3)))
    seen = replace(LOG, channels={**LOG.channels, "load_position_rad": np.zeros(3)})
    assert not is_one_body(elastic, LOG)
    assert not is_one_body(loose, LOG)
    assert not is_one_body(AXIS, seen)
    assert not is_one_body(replace(AXIS, mechanisms=(OFFSET,)), LOG)


def test_a_weight_behind_a_gear_goes_with_the_angle_of_what_it_hangs_at() -> None:
    """tau = J a + D sign(w) + V w + M sin(theta / 20 + phase) / 20 at the motor, which turns five times a second."""
    rng = np.random.default_rng(3)
    t = np.arange(20 * 200) / 200.0
    slow, fast = 2.0 * np.pi * 0.11, 2.0 * np.pi * 0.31
    angle = 20.0 * (0.9 * np.sin(slow * t) + 0.2 * np.sin(fast * t))
    speed = 20.0 * (0.9 * slow * np.cos(slow * t) + 0.2 * fast * np.cos(fast * t))
    acceleration = -20.0 * (0.9 * slow**2 * np.sin(slow * t) + 0.2 * fast**2 * np.sin(fast * t))
    torque = 0.0425 * acceleration + 0.2 * np.tanh(speed / 0.1) + 0.1 * speed
    torque += 30.0 / 20.0 * np.sin(angle / 20.0 + 0.5) + 0.02 * rng.standard_normal(t.size)
    log = Telemetry(t, {"motor_position_rad": angle + 1e-4 * rng.standard_normal(t.size), "motor_torque_nm": torque})
    (finding,) = investigate(at_the_motor(AXIS), log, gear=20.0).findings
    assert (finding.mechanism, finding.location) == ("gravity_imbalance", "load")
    sizes = {e.name: e.value for e in finding.parameters}
    assert sizes["torque_n_m"] == pytest.approx(30.0, rel=0.1)
    assert sizes["phase_rad"] == pytest.approx(0.5, abs=0.1)


def test_gears_of_a_ratio_alone_are_rigid() -> None:
    """No spring is invented whose torque would be late: friction is found with its size, and nothing else."""
    rng = np.random.default_rng(5)
    t = np.arange(10 * 500) / 500.0
    angle = 30.0 * np.sin(1.3 * t) + 10.0 * np.sin(3.1 * t)
    speed, acceleration = np.gradient(angle, t), np.gradient(np.gradient(angle, t), t)
    bare = read_axis(
        {
            "motor": {"inertia_kg_m2": 0.01},
            "stages": [{"name": "output", "ratio": 20.0}],
            "load": {"inertia_kg_m2": 4.0},
        }
    )
    torque = 0.02 * acceleration + 0.2 * np.tanh(speed / 0.1) + 0.01 * speed + 0.02 * rng.standard_normal(t.size)
    log = Telemetry(t, {"motor_position_rad": angle + 1e-4 * rng.standard_normal(t.size), "motor_torque_nm": torque})
    result = investigate(bare, log)
    at_joint = {"load_position_rad": log["motor_position_rad"] / 20.0, "motor_torque_nm": torque}
    by_ratio = investigate(bare, replace(log, channels=at_joint))
    assert {f.mechanism: f.parameters[0].value for f in by_ratio.findings} == pytest.approx(
        {f.mechanism: f.parameters[0].value for f in result.findings}
    )
    assert by_ratio.remarks == (BY_THE_RATIO, *result.remarks)
    sizes = {f.mechanism: f.parameters[0].value for f in result.findings}
    assert sizes == {
        "coulomb_friction": pytest.approx(0.2, rel=0.1), "viscous_friction": pytest.approx(0.01, rel=0.1)
    }  # fmt: skip
    assert result.extended.stages == bare.stages
    assert result.extended.load.inertia_kg_m2 == 4.0
