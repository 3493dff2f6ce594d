"""A fit ends where nothing is left to gain; what is as new is set free only where the data know that it is more."""

from __future__ import annotations

import numpy as np
import pytest

from casebase.signals.telemetry import Telemetry
from sim.axis import Axis, read_axis
from sim.discrepancy.condition import examine
from sim.discrepancy.fit import Noise, Problem
from sim.discrepancy.investigation import investigate
from sim.discrepancy.size import beyond, magnitude
from sim.discrepancy.terms import Term
from tests.discrepancy.telemetry_of import RATE_HZ, one_body

AXIS = {
    "motor": {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
    "load": {"inertia_kg_m2": 0.0},
}


def axis() -> Axis:
    return read_axis(AXIS)


def problem(telemetry: Telemetry) -> Problem:
    return Problem(axis(), examine(axis(), telemetry).measurement, Noise.flat(0.05, 1.0))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_finished_fit_ends_in_the_same_place_from_wherever_it_starts(seed: int) -> None:
    one = problem(one_body(0.3, 1.0, 0.02, seed))
    near = one.fit(to_end=True)
    bent = {"motor.inertia_kg_m2": 0.2, "motor.coulomb_friction_n_m": 1.9, "offset_n_m": 0.2}
    far = one.fit((), bent, to_end=True)
    assert far.cost == pytest.approx(near.cost, abs=1.0)
    assert far.values["motor.inertia_kg_m2"] == pytest.approx(near.values["motor.inertia_kg_m2"], rel=1e-3)


def test_numbers_that_a_fit_is_given_beyond_their_limits_start_at_the_limit() -> None:
    one = problem(one_body(0.3, 1.0, 0.02, 3))
    limit = next(p for p in one.base() if p.name == "motor.inertia_kg_m2").high
    assert one.fit((), {"motor.inertia_kg_m2": 10.0 * limit}, iterations=0).values["motor.inertia_kg_m2"] == limit


def test_an_effect_that_the_data_do_not_show_is_not_beyond_anything() -> None:
    one = problem(one_body(0.3, 1.0, 0.02, 4))
    parameter = next(p for p in one.base() if p.name == "offset_n_m")
    silent = Term("nothing", None, (parameter,), (), lambda v: {"size": 5.0}, size=1.0)
    fit = one.fit(to_end=True)
    assert magnitude(silent, fit.values) == 5.0
    unknown = Term(
        "unseen", None, (type(parameter)("unseen", 5.0, 1.0),), (), lambda v: {"size": v["unseen"]}, size=1.0
    )
    assert beyond(unknown, one.fit((unknown,), to_end=True)) < 0.01


def test_an_offset_is_named_where_it_is_more_than_as_new_and_fitted_where_it_is_not() -> None:
    said = investigate(axis(), one_body(0.3, 1.0, 0.02, 5, extra=0.5))
    assert [f.mechanism for f in said.findings] == ["torque_offset"]
    assert said.findings[0].parameters[0].value == pytest.approx(0.5, rel=0.1)
    assert investigate(axis(), one_body(0.3, 1.0, 0.02, 5, extra=0.03)).findings == ()


def test_a_channel_that_is_late_is_named_with_its_delay() -> None:
    told = one_body(0.3, 1.0, 0.02, 6, noise_n_m=0.2)
    late = int(0.004 * RATE_HZ)
    torque = np.concatenate([np.full(late, told["motor_torque_nm"][0]), told["motor_torque_nm"][:-late]])
    channels = {"motor_torque_nm": torque, "motor_position_rad": told["motor_position_rad"]}
    said = investigate(axis(), Telemetry(told.time_s, channels))
    assert [f.mechanism for f in said.findings] == ["time_delay"]
    assert said.findings[0].parameters[0].value == pytest.approx(0.004, rel=0.15)
