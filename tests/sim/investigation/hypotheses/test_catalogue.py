"""Sizes that matter, by what the gears carry."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sim.description.axis_document import read_axis
from sim.investigation.hypotheses.catalogue import gravity, shown_despite_doubts, torque_carried


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
