"""The second source itself: it obeys mechanics, is the same for the same seed, and hands over what it claims."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from scipy import signal

from benchmarks.hidden_effects.second.kernel import Axis, contact_torque, run
from benchmarks.hidden_effects.second.motion import STEP_S, STEPS_PER_SAMPLE, TELEMETRY_RATE_HZ
from benchmarks.hidden_effects.second.plan import PLAN
from benchmarks.hidden_effects.second.scenario import Scenario, generate
from benchmarks.hidden_effects.second.scene import STEPS_PER_SERVO, Scene, draw_scene, simulate

HIDDEN = {"backlash": "output", "coulomb_friction": None}


@pytest.fixture(scope="module")
def scene() -> Scene:
    return draw_scene((1, 2), "multisine")


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return generate(5, _number(**HIDDEN))


def _number(**hidden: str | None) -> int:
    """Return where the plan hides exactly this."""
    return next(number for number, entry in enumerate(PLAN) if entry.hidden == hidden)


def _frictionless(axis: Axis) -> Axis:
    """Return the axis without friction, tooth errors and loss, with true stiction where friction is added."""
    return axis._replace(
        transfer=axis.transfer._replace(error=0.0),
        output=axis.output._replace(error=0.0),
        motor_coulomb=0.0,
        motor_viscous=0.0,
        load_coulomb=0.0,
        load_viscous=0.0,
        output_efficiency=1.0,
        stick_speed=0.0,
    )


def _run(axis: Axis, position: np.ndarray, load_torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    speed = np.gradient(position, STEP_S)
    acceleration = np.gradient(speed, STEP_S)
    return run(axis, position, speed, acceleration, load_torque, STEP_S, STEPS_PER_SAMPLE, STEPS_PER_SERVO, 0.0)


def test_motor_torque_balances_inertia_friction_and_loss(scene: Scene) -> None:
    axis, ratio = scene.axis, scene.sheet.ratio
    done = simulate(scene, axis)
    speed, direction = done.motor_speed, np.sign(done.motor_speed)
    acceleration, load_acceleration = (np.gradient(v, 1 / TELEMETRY_RATE_HZ) for v in (speed, done.load_speed))
    inertia = axis.motor_inertia + axis.transfer_inertia / axis.transfer.ratio**2
    at_motor = inertia * acceleration + axis.motor_coulomb * direction + axis.motor_viscous * speed
    load = axis.load_inertia * load_acceleration + axis.load_coulomb * direction + axis.load_viscous * done.load_speed
    driving = load * direction > 0
    through_mesh = np.where(driving, load / axis.output_efficiency, load * axis.output_efficiency)
    slow = signal.butter(2, 30, fs=TELEMETRY_RATE_HZ, output="sos")
    unbalanced = signal.sosfiltfilt(slow, done.recording.motor_torque - at_motor - through_mesh / ratio)
    moving = np.abs(speed) > 20
    assert np.std(unbalanced[moving]) < 0.01 * np.std(done.recording.motor_torque[moving])


def test_teeth_carry_nothing_within_the_play_and_never_pull(scene: Scene) -> None:
    mesh = scene.axis.output._replace(backlash=1e-3)
    for twist in np.linspace(-4.999e-4, 4.999e-4, 21):
        assert contact_torque(mesh, twist, 1.0, 0.0, 0.0, 0.0, 0.0) == 0.0
    assert contact_torque(mesh, 6e-4, 0.0, 0.0, 0.0, 0.0, 0.0) == pytest.approx(1e-4 * mesh.stiffness)
    assert contact_torque(mesh, -6e-4, 0.0, 0.0, 0.0, 0.0, 0.0) == pytest.approx(-1e-4 * mesh.stiffness)
    assert contact_torque(mesh, 6e-4, -1e3, 0.0, 0.0, 0.0, 0.0) == 0.0
    assert contact_torque(mesh, 6e-4, 0.0, 2e-4, 0.0, 0.0, 0.0) == 0.0


def test_stiction_holds_the_load_against_less_than_its_limit(scene: Scene) -> None:
    axis = _frictionless(scene.axis)._replace(load_coulomb=scene.axis.load_coulomb)
    rest = np.zeros(int(0.5 / STEP_S))
    held, _ = _run(axis, rest, np.full(len(rest), 0.99 * axis.load_coulomb))
    slipping, _ = _run(axis, rest, np.full(len(rest), 1.5 * axis.load_coulomb))
    assert not held[:, 2].any()
    assert slipping[-1, 2] > 0.0


def test_same_seed_same_data_and_another_seed_other_data(scenario: Scenario) -> None:
    again = generate(5, _number(**HIDDEN))
    assert scenario.answer == again.answer
    assert scenario.believed == again.believed
    np.testing.assert_array_equal(scenario.sound, again.sound)
    for column in fields(scenario.recording):
        np.testing.assert_array_equal(getattr(scenario.recording, column.name), getattr(again.recording, column.name))
    assert draw_scene((1, 2), "multisine").axis != draw_scene((2, 2), "multisine").axis


def test_answer_says_what_is_hidden(scenario: Scenario) -> None:
    answer = scenario.answer
    assert answer["answer"] == [["backlash", "output"], ["coulomb_friction", None]]
    assert set(answer["size"]) == {"gap_rad", "torque_n_m"}
    assert answer["strength"] == answer["strengths"][answer["strength_channel"]] > 1.0
    nothing = generate(5, _number()).answer
    assert (nothing["answer"], nothing["size"], nothing["strength"]) == ([], {}, 0.0)
    assert set(nothing) == set(answer)
