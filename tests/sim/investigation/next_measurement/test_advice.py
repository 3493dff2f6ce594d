"""What a next measurement would tell: of two causes that a recording cannot tell apart, simulated in it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import RATE_HZ, geared, one_body
from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.description.axis_document import read_axis
from sim.investigation.data.preprocessing import prepare
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import Noise
from sim.investigation.hypotheses.catalogue import terms_of
from sim.investigation.investigate import investigate
from sim.investigation.next_measurement.advice import NOTHING, SEPARATES, in_words, separation_of_rivals
from sim.investigation.next_measurement.plans import Present, even_speeds, there_and_back
from sim.investigation.results import Investigation, MeasurementUtility
from sim.investigation.search.comparison import Model

BODY = read_axis({"name": "bench", "motor": {"inertia_kg_m2": 0.3}, "load": {"inertia_kg_m2": 0.0}})
FRICTION_N_M = 1.0


def measured(angle: Array, seed: int = 1) -> Telemetry:
    """A body with dry friction, which its description lacks, along an angle [rad] of 1000 rows a second."""
    speed = np.gradient(angle) * RATE_HZ
    torque = 0.3 * np.gradient(speed) * RATE_HZ + FRICTION_N_M * np.tanh(speed / 0.01)
    torque += 0.05 * np.random.default_rng(seed).standard_normal(angle.size)
    step = 2 * np.pi / 2**20
    channels = {"motor_torque_nm": torque, "motor_position_rad": np.round(angle / step) * step}
    return Telemetry(np.arange(angle.size) / RATE_HZ, channels)


def one_way() -> Array:
    """Up to speed, and on with it."""
    ramp = np.clip(np.arange(15_000) / 500.0, 0.0, 1.0)
    return np.cumsum(40.0 * ramp) / RATE_HZ


@pytest.fixture(scope="module")
def open_question() -> Investigation:
    return investigate(BODY, measured(one_way()))


def test_one_direction_at_one_speed_leaves_a_class_and_the_advice_is_to_turn_back(open_question: Investigation) -> None:
    finding = open_question.findings[0]
    assert "coulomb_friction" in {finding.mechanism, *finding.indistinguishable_from}
    assert len({finding.mechanism, *finding.indistinguishable_from}) > 1
    best = open_question.next_measurements[0]
    assert "the other way round" in best.text
    assert best.separation > SEPARATES > 10.0 * best.repeat
    assert open_question.next_measurement.startswith(best.text)


def test_what_was_advised_names_the_right_cause_alone(open_question: Investigation) -> None:
    advised = {"the other way round": there_and_back, "five even speeds": even_speeds}
    assert open_question.weighed is not None
    present = Present(BODY, open_question.weighed.problem.measurement)
    motion = next(m for words, m in advised.items() if words in open_question.next_measurements[0].text)
    angle = motion(present)
    assert angle is not None
    findings = investigate(BODY, measured(angle, seed=2)).findings
    assert [f.mechanism for f in findings] == ["coulomb_friction"]
    assert findings[0].indistinguishable_from == ()
    assert findings[0].parameters[0].value == pytest.approx(FRICTION_N_M, rel=0.05)


def test_the_document_lists_every_measurement_that_was_simulated_with_finite_numbers(
    open_question: Investigation,
) -> None:
    told = json.loads(json.dumps(open_question.document(), allow_nan=False))["next_measurements"]
    assert len(told) == len(open_question.next_measurements) > 3
    assert all(set(one) == {"text", "between", "separation", "repeat", "effort"} for one in told)
    assert any("five even speeds" in one["text"] for one in told)


def test_nothing_is_simulated_where_nothing_is_open() -> None:
    sure = investigate(BODY, one_body(0.3, 1.0, 0.0, 5))
    assert sure.findings[0].probability > 0.9
    assert sure.next_measurements == ()
    assert "three even speeds" in sure.next_measurement


GEARED = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.01, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
        "stages": [{"name": "output", "ratio": 9.0, "stiffness_n_m_per_rad": 7e3, "damping_n_m_s_per_rad": 3.0}],
        "load": {"inertia_kg_m2": 0.7},
        "load_encoder": {"error_rad": 1e-5},
    }
)


def fitted(guided: bool) -> tuple[Problem, Fit]:
    """A good axis, with or without its load encoder, under noise of 0.05 N m at the motor and 0.5 N m at the load."""
    told = geared(0.01, 9.0, 0.7, 7e3, seed=3)
    load = told["load_position_rad"] if guided else None
    m = prepare(RATE_HZ, told["motor_torque_nm"], told["motor_position_rad"], load)
    problem = Problem(GEARED, m, Noise.flat(0.05, 0.5))
    return problem, problem.fit()


def with_term(problem: Problem, fit: Fit, key: str, *numbers: float) -> Model:
    """The model with one term of `key` more, and its first numbers."""
    terms = terms_of(GEARED, problem.measurement, problem.chain((), fit.values))
    term = next(t for t in terms if str(t.key) == key)
    own = {p.name: p.start for p in term.parameters}
    own |= dict(zip(own, numbers, strict=False))
    return Model((term,), {**fit.values, **own})


def best(told: tuple[MeasurementUtility, ...], words: str) -> float:
    """What the measurement of these words tells, squares."""
    return next(one.separation for one in told if words in one.text)


def test_without_a_load_encoder_one_that_is_added_tells_runout_from_nothing() -> None:
    problem, fit = fitted(guided=False)
    runout = with_term(problem, fit, "eccentricity@output", 3e-4)
    told = separation_of_rivals(problem, fit, runout, {NOTHING: Model.of(fit)}, "eccentricity at output")
    assert "Add an encoder at the load" in in_words(told)
    assert best(told, "Add an encoder") > SEPARATES > best(told, "Repeat the same motion")


def test_what_no_measurement_of_motor_and_load_tells_apart_has_no_simulated_advice() -> None:
    """Runout of the last gear and an error of the load encoder: for them a dial gauge stays what is advised."""
    problem, fit = fitted(guided=True)
    runout = with_term(problem, fit, "eccentricity@output", 3e-4, 0.0)
    error = with_term(problem, fit, "encoder_error@load", -3e-4, 0.0)
    told = separation_of_rivals(problem, fit, runout, {"encoder error at load": error}, "eccentricity at output")
    assert max(one.separation for one in told) < SEPARATES
    assert in_words(told) == ""


def test_a_motion_that_the_motor_cannot_make_is_left_out() -> None:
    problem, fit = fitted(guided=True)
    weak = replace(GEARED, motor=replace(GEARED.motor, torque_limit_n_m=0.5))
    problem.axis = weak
    play = with_term(problem, fit, "eccentricity@output", 3e-4)
    assert separation_of_rivals(problem, fit, play, {NOTHING: Model.of(fit)}, "eccentricity at output") == ()
