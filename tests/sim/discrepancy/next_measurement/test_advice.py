"""What a next measurement would tell: of two causes that a recording cannot tell apart, simulated in it."""

from __future__ import annotations

import html
import json
from dataclasses import replace

import numpy as np
import pytest

from casebase.signals.telemetry import Telemetry
from sim.description.axis import Axis, MechanismEntry
from sim.description.axis_document import read_axis
from sim.discrepancy.data.preprocessing import prepare
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.whitening import Noise
from sim.discrepancy.hypotheses.catalogue import terms_of
from sim.discrepancy.investigation import investigate
from sim.discrepancy.next_measurement.advice import NOTHING, in_words, of_a_joint
from sim.discrepancy.next_measurement.discrimination import SEPARATES, told_by
from sim.discrepancy.next_measurement.plans import PLANS, REPEAT, Plan, Present, even_speeds, there_and_back
from sim.discrepancy.pooling.joint_investigation import investigate_together
from sim.discrepancy.pooling.pooled_estimates import Taken
from sim.discrepancy.report.html import html_report
from sim.discrepancy.report.joint_html import html_report_together
from sim.discrepancy.results import Difference, Investigation, MeasurementUtility
from sim.discrepancy.search.comparison import Model
from sim.torsional.model import Array
from tests.sim.discrepancy.telemetry_of import RATE_HZ, geared, one_body, swing

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
    assert "five even speeds" in html_report(open_question).split("Next measurement</h2>")[1]


def test_the_same_bytes_give_the_same_document(open_question: Investigation) -> None:
    assert investigate(BODY, measured(one_way())).document() == open_question.document()


def test_two_recordings_that_leave_it_open_have_the_simulated_advice_and_one_that_settles_it_settles_both(
    open_question: Investigation,
) -> None:
    first, again = Taken("first", measured(one_way())), Taken("again", measured(one_way(), seed=2))
    both = investigate_together(BODY, [first, again])
    assert both.combined.findings[0].indistinguishable_from
    best = both.combined.next_measurements[0]
    assert best.text in {f"{open_question.next_measurements[0].text} (as in {name})" for name in ("first", "again")}
    assert both.combined.next_measurement.startswith(best.text)
    assert html.escape(best.text) in html_report_together(both)
    back = Taken("back", measured(there_and_back_of(one_way())))
    settled = investigate_together(BODY, [first, back]).combined
    assert [f.mechanism for f in settled.findings] == ["coulomb_friction"]
    assert "torque_offset" not in settled.findings[0].indistinguishable_from
    assert not any("offset" in name for told in settled.next_measurements for name in told.between)


def there_and_back_of(angle: Array) -> Array:
    """The same at first, then the other way round, with a ramp between."""
    speed = np.gradient(angle) * np.clip((angle.size / 2 - np.arange(angle.size)) / 250.0, -1.0, 1.0)
    return np.cumsum(speed)


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
    told = told_by(problem, fit, runout, {NOTHING: Model.of(fit)}, "eccentricity at output")
    assert "Add an encoder at the load" in in_words(told)
    assert best(told, "Add an encoder") > SEPARATES > best(told, "Repeat the same motion")


def test_what_no_measurement_of_motor_and_load_tells_apart_has_no_simulated_advice() -> None:
    """Runout of the last gear and an error of the load encoder: for them a dial gauge stays what is advised."""
    problem, fit = fitted(guided=True)
    runout = with_term(problem, fit, "eccentricity@output", 3e-4, 0.0)
    error = with_term(problem, fit, "encoder_error@load", -3e-4, 0.0)
    told = told_by(problem, fit, runout, {"encoder error at load": error}, "eccentricity at output")
    assert max(one.separation for one in told) < SEPARATES
    assert in_words(told) == ""


def test_a_motion_that_the_motor_cannot_make_is_left_out() -> None:
    problem, fit = fitted(guided=True)
    weak = replace(GEARED, motor=replace(GEARED.motor, torque_limit_n_m=0.5))
    problem.axis = weak
    play = with_term(problem, fit, "eccentricity@output", 3e-4)
    assert told_by(problem, fit, play, {NOTHING: Model.of(fit)}, "eccentricity at output") == ()


def test_an_offset_that_the_description_knows_tells_no_causes_apart() -> None:
    """What is simulated is read as it is: the described offset must not be missed in it."""
    problem, fit = fitted(guided=True)
    runout = with_term(problem, fit, "eccentricity@output", 3e-4)
    entry = MechanismEntry("torque_offset", "motor", {"torque_n_m": 2.0})
    plain, offset = (
        told_by(p, fit, runout, {NOTHING: Model.of(fit)}, "eccentricity at output")
        for p in (problem, problem.of(replace(problem.axis, mechanisms=(entry,))))
    )
    for words in ("Repeat the same motion", "five even speeds"):
        assert best(offset, words) == pytest.approx(best(plain, words), rel=0.01)


def test_what_this_torque_may_be_wrong_by_as_a_whole_says_nothing_of_the_next_recording() -> None:
    """A body whose torque was freed of noise by the drive's law, and a measurement of another length."""
    seen = measured(one_way()).channels
    m = prepare(RATE_HZ, seen["motor_torque_nm"], seen["motor_position_rad"], None)
    problem = Problem(BODY, m, Noise.flat(0.05, 0.5))
    fit = problem.fit()
    unsure = problem.with_noise(problem.noise.with_inflated_prior(np.linspace(0.0, 0.1, m.samples)[:, None]))
    (friction,) = (t for t in terms_of(BODY, m, problem.chain((), fit.values)) if t.mechanism == "coulomb_friction")
    model = Model((friction,), {**fit.values, friction.parameters[0].name: 1.0})
    plain, freed = (told_by(p, fit, model, {NOTHING: Model.of(fit)}, "coulomb_friction") for p in (problem, unsure))
    assert plain
    assert [one.separation for one in freed] == [one.separation for one in plain]


@pytest.mark.parametrize("plan", [REPEAT, *PLANS])
def test_every_plan_moves_within_what_was_measured_and_is_a_sentence_to_be(plan: Plan) -> None:
    t, angle, _, _ = swing()
    axis: Axis = replace(GEARED, motor=replace(GEARED.motor, speed_limit_rad_s=120.0))
    present = Present(axis, prepare(RATE_HZ, np.zeros(t.size), angle, None))
    motion = plan.motion(present)
    if motion is None:
        return
    assert np.isfinite(motion).all()
    assert motion.size <= present.rows
    assert float(np.abs(np.diff(motion)).max()) * RATE_HZ < 2.05 * present.top
    assert "{" not in plan.says(present, motion)


def test_of_a_joint_is_said_what_to_do_and_what_would_be_seen() -> None:
    """For robots it was "an axis without it still needs 1.30 N m more motor torque than one with it"."""
    seen = Difference("motor_torque_nm", 1.3, 0.0, 0.2, 1)
    told = MeasurementUtility("Repeat it slowly, for 20 s", ("low-speed friction", NOTHING), 90.0, 9.0, 1.0, 1.0, seen)
    assert of_a_joint([told], "joint") == (
        "Repeat it slowly, for 20 s, and log it. That tells whether there is low-speed friction. "
        "If so, the joint needs 1.30 N m more torque below 0.200 rad/s of the joint."
    )
    less = replace(told, difference=replace(seen, more=-1))
    assert "needs 1.30 N m less torque" in of_a_joint([less], "joint")
    other = replace(told, between=("weight", "offset"))
    assert "That tells weight from offset. With weight the motor needs 1.30 N m more" in of_a_joint([other], "motor")
    assert of_a_joint([replace(told, separation=0.0)], "joint") == ""
