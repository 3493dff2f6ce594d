"""Sizes that matter, by what the gears carry."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sim.description.axis_document import read_axis
from sim.investigation.hypotheses.catalogue import gravity, shown_despite_doubts, torque_carried
from sim.investigation.hypotheses.friction import friction_key, stribeck
from sim.investigation.model.nominal import MOTOR_RELEASE
from sim.mechanisms import CoulombFriction


def test_gears_carry_nothing_of_what_turns_the_motor_itself() -> None:
    """A motor as heavy as a hundred loads: no play is too small to matter because it takes much torque to turn."""
    time_s = np.linspace(0.0, 2.0, 2001)
    acceleration = 300.0 * np.sin(9.0 * time_s)
    axis = read_axis(
        {
            "schema": "gearcase-axis/1",
            "name": "heavy motor",
            "motor": {"inertia_kg_m2": 0.6},
            "load": {"inertia_kg_m2": 40.0},
            "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 150, "stiffness_n_m_per_rad": 1e5}],
        }
    )
    torque = (0.6 + 40.0 / 100.0**2) * acceleration
    m = cast(Any, SimpleNamespace(torque=torque, slow_acceleration=acceleration, torque_rms=float(np.std(torque))))
    assert torque_carried(axis, m) == pytest.approx(float(np.sqrt(np.mean((0.004 * acceleration) ** 2))))
    still = cast(Any, SimpleNamespace(torque=torque, slow_acceleration=-acceleration, torque_rms=m.torque_rms))
    assert torque_carried(axis, still) == m.torque_rms


def test_a_weight_matters_beyond_what_masses_may_be_off_by() -> None:
    """Two ways in which a known torque may be wrong by 0.3 and 0.4 N m; and none."""
    weight = gravity(10.0, 0)
    wrong = np.tile([0.3, 0.4], (100, 1))
    told = shown_despite_doubts(weight, cast(Any, SimpleNamespace(doubts=wrong)), 2.0)
    assert told.size == pytest.approx(max(weight.size, 1.0))
    assert shown_despite_doubts(weight, cast(Any, SimpleNamespace(doubts=np.zeros((0, 0)))), 2.0) == weight


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
