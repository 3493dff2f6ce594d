"""What friction, play and weights of a drive have to obey."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robot_bank.drive import Drive, bristles, motor_angle, motor_torque

DRIVE = Drive(rotor=0.5, dry=3.0, viscous=4.0, rated=100.0, gear=80.0, way=1e-3)
TIME = np.arange(0, 10, 1e-3)
ANGLE = np.sin(2 * np.pi * TIME / 5)
CARRIED = 20 * np.sin(ANGLE + 0.3)


def _cycle_work(drive: Drive) -> float:
    """Return the motor's work [J] over the middle one of two equal cycles."""
    torque, angle, _ = motor_torque(drive, TIME, ANGLE, CARRIED)
    cycle = (TIME >= 2.5 - 1e-9) & (TIME <= 7.5 + 1e-9)
    return float(np.trapezoid(torque[cycle], angle[cycle]))


def test_dry_friction_builds_up_as_an_exponential_of_the_way_and_stays_at_rest() -> None:
    there = np.linspace(0, 5e-3, 501)
    course = np.concatenate([there, np.full(50, there[-1]), there[::-1]])
    side = bristles(course, 1e-3, 0.0)
    np.testing.assert_allclose(side[:501], 1 - np.exp(-there / 1e-3), atol=1e-12)
    np.testing.assert_array_equal(side[501:551], side[500])
    assert side[-1] == pytest.approx(-1 + 2 * np.exp(-5), abs=1e-4)


def test_a_conservative_drive_takes_no_work_over_a_cycle() -> None:
    bare = replace(DRIVE, dry=0.0, viscous=0.0, imbalance=15.0, imbalance_phase=1.0, gap=2e-3)
    bare = replace(bare, ripple=2.0, ripple_order=0.1)
    assert _cycle_work(bare) == pytest.approx(0.0, abs=1e-3)


def test_the_work_of_a_cycle_is_what_friction_takes() -> None:
    speed = 2 * np.pi / 5
    expected = 4 * DRIVE.dry + DRIVE.viscous * np.pi * speed
    assert _cycle_work(DRIVE) == pytest.approx(expected, rel=0.01)


def test_the_motor_crosses_the_whole_play_as_the_torque_turns() -> None:
    played = replace(DRIVE, gap=3e-3)
    angles = motor_angle(played, np.zeros(2), np.array([-50.0, 50.0]))
    assert angles[1] - angles[0] == pytest.approx(3e-3)


def test_asymmetry_is_the_half_difference_of_both_directions() -> None:
    plain = motor_torque(DRIVE, TIME, ANGLE, CARRIED)[0]
    skewed = motor_torque(replace(DRIVE, asymmetry=0.2), TIME, ANGLE, CARRIED)[0]
    # fastest forward after one cycle, backward half a cycle before
    for at in (5.0, 2.5):
        more = np.interp(at, TIME, skewed - plain)
        assert more == pytest.approx(0.2 * (DRIVE.dry + DRIVE.viscous * 2 * np.pi / 5), rel=0.01)
