"""Friction that falls with the speed: of what size a law of it is."""

import math

import pytest

from sim.investigation.hypotheses.friction import friction_key, stribeck
from sim.investigation.model.nominal import MOTOR_RELEASE
from sim.mechanisms import CoulombFriction

TOP_RAD_S = 2.0


def size(rise_n_m: float, speed_rad_s: float, turned_share: float, dry_n_m: float = 15.0) -> float:
    term = stribeck(10.0, TOP_RAD_S)
    assert term.magnitude is not None
    torque, speed, exponent = (p.name for p in term.parameters)
    return term.magnitude({
        torque: rise_n_m, speed: speed_rad_s, exponent: 1.0, MOTOR_RELEASE: math.log(1e3 * turned_share),
        friction_key(CoulombFriction, "motor"): dry_n_m,
    })  # fmt: skip


def test_where_friction_turns_at_once_it_falls_by_its_law() -> None:
    assert size(3.0, 0.2, 1e-3) == pytest.approx(3.0, rel=0.1)


def test_where_friction_turns_over_a_wide_range_a_law_of_a_small_speed_only_bends_it() -> None:
    """As at the first joint of a real arm, whose friction rises with its speed from the first to the last: beside dry
    friction of 20 N m that turns over 0.35 rad/s the data asked for 104 N m below 0.07 rad/s."""
    assert size(104.0, 0.07, 0.2, 20.0) == 0.0
    assert size(104.0, 0.07, 1e-3, 20.0) > 50.0
