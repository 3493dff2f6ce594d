"""Whether a described number that is wrong explains what a mechanism would."""

from __future__ import annotations

import numpy as np
import pytest

from sim.description.axis_document import read_axis
from sim.discrepancy.data.preprocessing import prepare
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.whitening import Noise
from sim.discrepancy.hypotheses.catalogue import terms_of
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.search.criterion import least_gain
from sim.discrepancy.search.nominal_error import SURE, doubted
from tests.sim.discrepancy.telemetry_of import RATE_HZ, one_body
from tests.sim.discrepancy.telemetry_of import swing as motion

LOUD_N_M = 2.0


def of_drift(described_n_m: float, rate_per_s: float) -> tuple[Term, Problem, Fit, Fit]:
    """A body with dry friction of 1 N m that drifts, under loud noise; fits without and with drift."""
    time, _, speed, _ = motion()
    friction = np.tanh(speed / 0.01) + 0.02 * speed
    told = one_body(0.01, 1.0, 0.02, 1, LOUD_N_M, rate_per_s * (time - time.mean()) * friction).channels
    rubs = {"coulomb_friction_n_m": described_n_m, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"motor": {"inertia_kg_m2": 0.01, **rubs}, "load": {"inertia_kg_m2": 1e-9}})
    m = prepare(RATE_HZ, told["motor_torque_nm"], told["motor_position_rad"], None)
    problem = Problem(axis, m, Noise.flat(LOUD_N_M, 1.0))
    less = problem.fit(to_end=True)
    (term,) = (t for t in terms_of(axis, m, problem.chain((), less.values)) if t.mechanism == "friction_drift")
    return term, problem, less, problem.fit((term,), less.values, to_end=True)


def test_what_only_gives_a_wrong_number_back_is_that_number() -> None:
    """Friction described a fifth too small, where it is believed within 3 %: as if it had grown during the record."""
    term, problem, less, more = of_drift(0.8, 0.0)
    gain = less.cost - more.cost
    assert gain > least_gain(term)
    rival = doubted(term, gain, problem, less, more)
    assert rival
    coulomb = "motor.coulomb_friction_n_m"
    assert coulomb in rival[0].doubts
    assert abs(rival[1].values[coulomb] - 1.0) < abs(less.values[coulomb] - 1.0)


@pytest.mark.parametrize("described_n_m", [1.0, 0.8])
def test_no_number_explains_what_changes_over_time(described_n_m: float) -> None:
    term, problem, less, more = of_drift(described_n_m, 0.03)
    gain = less.cost - more.cost
    assert least_gain(term) < gain < SURE * least_gain(term)
    assert doubted(term, gain, problem, less, more) is None
