"""Starts within their limits, steps along them, lines of one phase."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.signal import lfilter, lsim
from scipy.stats import chi2

from casebase.signals.telemetry import Telemetry
from sim.description.axis_document import read_axis
from sim.discrepancy.assessment.verdict import drop_unidentifiable, inadequacy, left, looks_like
from sim.discrepancy.data.preprocessing import Measurement, prepare
from sim.discrepancy.data.validation import examine
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.refit import calibrate, look_closely
from sim.discrepancy.estimation.whitening import Noise
from sim.discrepancy.hypotheses.catalogue import terms_of
from sim.discrepancy.hypotheses.hypothesis import Key, Term
from sim.discrepancy.hypotheses.structure import SHARP, SOFTEST
from sim.discrepancy.hypotheses.traits import FIXED
from sim.discrepancy.investigation import investigate
from sim.discrepancy.model.effects import swing
from sim.discrepancy.model.nominal import base_parameters, loss_parameters, nuisance_of
from sim.discrepancy.model.parameters import Parameter
from sim.discrepancy.search import proposals as candidates
from sim.discrepancy.search.criterion import (
    evidence,
    holds,
    is_model_error,
    matters,
    needs_no_trial,
    penalty,
    shifts_prior,
    wanted,
)
from sim.discrepancy.search.effect_size import magnitude
from sim.discrepancy.search.proposals import Rival, faint, try_terms
from sim.discrepancy.search.residual_proposals import line_of
from sim.discrepancy.search.score_test import least_squares_within
from sim.discrepancy.search.search import Selection, likely, unmasked
from sim.discrepancy.unexplained import Unexplained
from sim.mechanisms.traits import LEAST_GAIN
from sim.torsional.model import Array, Chain, Shaft
from tests.sim.discrepancy.telemetry_of import RATE_HZ, geared, one_body
from tests.sim.discrepancy.telemetry_of import swing as motion


def test_of_two_columns_that_are_alike_none_is_negative_where_it_may_not_be() -> None:
    rng = np.random.default_rng(1)
    first = rng.standard_normal(500)
    columns = np.stack([first, first + 1e-3 * rng.standard_normal(500)], axis=1)
    goal = 0.7 * first + 0.1 * rng.standard_normal(500)
    share = least_squares_within(columns.T @ columns, columns.T @ goal, np.zeros(2))
    exact = lsq_linear(columns, goal, (0.0, np.inf)).x
    assert share.min() >= 0.0
    assert share.sum() == pytest.approx(exact.sum(), rel=1e-3)


def test_without_limits_the_share_solves_the_normal_equations() -> None:
    columns = np.random.default_rng(2).standard_normal((200, 3))
    matrix, pull = columns.T @ columns, columns.T @ columns @ np.array([1.0, -2.0, 3.0])
    assert least_squares_within(matrix, pull, np.full(3, -np.inf)) == pytest.approx([1.0, -2.0, 3.0], rel=1e-5)


def test_a_line_is_one_sine_of_constant_phase_and_no_burst_of_its_frequency() -> None:
    time = np.arange(30_000) / 1000.0
    noise = np.random.default_rng(3).standard_normal(time.size)
    sine = 0.1 * np.sin(2 * np.pi * 6.31 * time)
    assert line_of(noise, 1000.0) is None
    assert line_of(noise + sine, 1000.0) == pytest.approx(6.31, abs=0.01)
    broken = 0.1 * np.sin(2 * np.pi * 6.31 * time + np.random.default_rng(4).uniform(0, 2 * np.pi, 30).repeat(1000))
    assert line_of(noise + 3.0 * broken, 1000.0) is None


def test_a_part_on_a_spring_adds_its_mass_below_its_frequency_and_nothing_far_above() -> None:
    """At standstill of the spring the swinging part moves with the load; far above its resonance it stands still."""
    rate_hz, time = 1000.0, np.arange(40_000) / 1000.0
    for frequency_hz, followed in ((0.2, 0.0), (60.0, -1.0)):
        w = 2.0 * np.pi * frequency_hz
        still = np.zeros(time.size)
        speed = np.cos(w * time) / w
        m = Measurement(rate_hz, time, *[still] * 8, speed, still, speed, still, still)
        asked = swing(m, 2.0, 0.25, 6.0, 0.02)[20_000:]
        acceleration = -np.sin(w * time)[20_000:]
        assert asked @ acceleration / (acceleration @ acceleration) == pytest.approx(0.5 * followed, abs=0.01)


def test_a_part_on_a_spring_has_settled_where_a_record_begins_in_the_middle_of_a_stroke() -> None:
    """Else a step of the acceleration would shake it that never was."""
    rate_hz, time = 1000.0, np.arange(10_000) / 1000.0
    still = np.zeros(time.size)
    m = Measurement(rate_hz, time, *[still] * 8, 3.0 * time, still, time, still, still)
    assert np.abs(swing(m, 2.0, 0.25, 6.0, 0.02)).max() < 1e-9


def test_the_noise_of_the_load_encoder_is_no_part_that_swings() -> None:
    """A part on a spring takes mass from what follows the encoder, and the noise is quieter by it."""
    axis = read_axis(
        {
            "motor": {"inertia_kg_m2": 0.01, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
            "stages": [{"name": "gear", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": 4e4}],
            "load": {"inertia_kg_m2": 2.0},
        }
    )
    problems = []
    for seed in (1, 7):
        told = geared(0.01, 8.0, 2.0, 4e4, seed).channels
        m = prepare(RATE_HZ, told["motor_torque_nm"], told["motor_position_rad"], told["load_position_rad"])
        problems.append(Problem(axis, m, Noise.flat(0.05, 0.05)))
    first, base = calibrate(problems[0])
    second = problems[1].with_noise(first.noise)
    second.observer.learn_noise(second.chain((), base.values), nuisance_of(base.values))
    (term,) = (t for t in terms_of(axis, m, first.chain((), base.values)) if t.mechanism == "structural_resonance")
    share, frequency, damping = (p.name for p in term.parameters)

    def loudness(terms: tuple[Term, ...], values: dict[str, float]) -> float:
        """The motion is the same, and what differs is noise."""
        one, other = (p.residual(terms, values)[base.torque_rows :] for p in (first, second))
        return float(np.sum((one - other) ** 2))

    plain = loudness((), dict(base.values))
    for frequency_hz, quieter in ((6.0, True), (12.0, True), (40.0, False)):
        values = {**base.values, share: 0.05, frequency: frequency_hz, damping: 0.03}
        left = loudness((term,), values) / plain
        assert first.load_noise
        assert term.response
        factor = first.load_noise.factor((term,), values)
        alone = left / factor**2
        assert (alone < 0.95, factor > 1.0) == (quieter, quieter)
        assert not quieter or 1.0 - left < 0.7 * (1.0 - alone)


AXIS = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.003, "coulomb_friction_n_m": 0.3},
        "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": 1e4}],
        "load": {"inertia_kg_m2": 2.0},
    }
)
MOVED = prepare(RATE_HZ, motion()[3] * 0.03, motion()[1], motion()[1] / 8.0)
ALL = terms_of(AXIS, MOVED, Chain((Shaft(0.003, 0.3, 0.0),)))
TERMS = {t.mechanism: t for t in ALL}


@pytest.mark.parametrize(("teeth", "alike"), [(True, ()), (False, ("mesh_error",))])
def test_a_loop_looks_like_errors_of_teeth_whose_number_is_unknown(teeth: bool, alike: tuple[str, ...]) -> None:
    stage = AXIS.stages[0]
    axis = AXIS if teeth else replace(AXIS, stages=(replace(stage, driver_teeth=None, driven_teeth=None, ratio=8.0),))
    loop = next(t for t in terms_of(axis, MOVED, Chain((Shaft(0.003, 0.3, 0.0),))) if t.mechanism == "hysteresis")
    assert looks_like(Problem(axis, MOVED, Noise.flat(1.0, 1.0)), loop) == alike


def test_play_below_what_matters_stands_for_itself_and_a_bend_does_not() -> None:
    assert wanted(TERMS["backlash"], -5.0)
    assert not wanted(TERMS["stiffness_hardening"], -5.0)


@pytest.mark.parametrize(("prior_penalty", "counts"), [(1.0, True), (31.0, True), (150.0, False)])
def test_a_bend_must_bring_more_than_the_description_is_bent_by(prior_penalty: float, counts: bool) -> None:
    """By chance it is bent by one square per number."""
    residual = np.random.default_rng(5).standard_normal(20_000)
    misfit = float(residual @ residual)
    fit = Fit(
        (), (Parameter("one", 1.0, 0.1),), {"one": 1.0}, residual, np.zeros((20_000, 1)), misfit + prior_penalty, 20_000
    )
    assert matters(TERMS["stiffness_hardening"], 100.0, fit) is counts
    assert matters(TERMS["viscous_friction"], 100.0, fit)


@pytest.mark.parametrize(("before", "after", "bent"), [(10.0, 70.0, True), (10.0, 60.0, False), (40.0, 10.0, False)])
def test_a_cause_that_was_missing_bends_the_description_no_further(before: float, after: float, bent: bool) -> None:
    """What it was bent by stood for the cause; 400 squares are worth the 57 that they may cost by chance.

    Friction that was left out comes with numbers that are known roughly at most.
    """

    def fit(prior_penalty: float) -> Fit:
        none = np.zeros(100)
        return Fit((), (), {}, none, np.zeros((100, 0)), prior_penalty, 100)

    assert shifts_prior(TERMS["stiffness_hardening"], fit(before), fit(after), 400.0) is bent
    assert not shifts_prior(TERMS["viscous_friction"], fit(before), fit(after), 400.0)


def test_an_offset_is_no_error_of_the_form_of_what_is_larger() -> None:
    """It is known beforehand, and what it gains over that is not of the residual."""
    entered = {Key("tooth_damage", "output"): 10_000.0}
    assert is_model_error(TERMS["hysteresis"], 40.0, entered)
    assert not is_model_error(TERMS["torque_offset"], 40.0, entered)


def test_hum_leaves_nothing_of_its_form() -> None:
    """However loud it is, what is small beside it is something else."""
    assert not is_model_error(TERMS["eccentricity"], 24.0, {Key("electrical_hum", "motor"): 3000.0})
    assert is_model_error(TERMS["eccentricity"], 24.0, {Key("torque_ripple", "motor"): 3000.0})


def test_an_offset_beside_an_asymmetry_is_what_the_other_holds_at_rest_unless_it_is_large() -> None:
    """While anything moves they are the same torque."""
    entered = {Key("friction_asymmetry", "motor"): 5500.0}
    assert is_model_error(TERMS["torque_offset"], 85.0, entered)
    assert not is_model_error(TERMS["torque_offset"], 900.0, entered)


def test_losses_bring_along_on_which_side_of_the_mesh_they_are_once_for_all_meshes() -> None:
    """A description without losses says nothing of it, and a fit would bend springs and inertias instead."""
    losses = [t for t in ALL if t.mechanism == "load_dependent_loss"]
    assert losses
    problem = Problem(AXIS, MOVED, Noise.flat(1.0, 1.0))
    names = [p.name for p in problem.parameters((*losses, *losses))]
    splits = {p.name for p in loss_parameters()}
    assert not splits & {p.name for p in problem.parameters(())}
    assert [names.count(name) for name in splits] == [1] * len(splits)


@pytest.mark.parametrize("mechanism", sorted(name for name in TERMS if TERMS[name].traits.least_gain < LEAST_GAIN))
def test_noise_alone_promises_what_is_asked_for_less_than_once_in_five_hundred_axes(mechanism: str) -> None:
    """The squares that k numbers take away from white noise are chi-squared with k degrees of freedom."""
    numbers = 1 if mechanism.endswith(("coulomb_friction", "viscous_friction")) else len(TERMS[mechanism].parameters)
    assert chi2.sf(TERMS[mechanism].traits.least_gain, numbers) < 0.002


def test_what_acts_over_strokes_pays_for_the_rows_that_say_something_of_their_own() -> None:
    """A law of friction is held against noise some hundred times in half a minute, teeth thousands of times."""
    rows = 30_000
    assert evidence(TERMS["friction_asymmetry"], 16.0, rows) > 0.0
    assert evidence(TERMS["eccentricity"], 16.0, rows) < 0.0


def test_what_is_as_new_hides_no_rival() -> None:
    """However many squares a part takes that swings no more than a good one does."""
    asymmetry, offset = TERMS["friction_asymmetry"], TERMS["torque_offset"]
    swings = Rival(TERMS["structural_resonance"], 160.0, {}, beyond=-4.0)
    tried = [swings, Rival(asymmetry, 19.0, {}, beyond=2.8), Rival(offset, 18.0, {}, beyond=7.0)]
    assert [r.term for r in likely(tried)] == [asymmetry, offset]
    assert [r.term for r in likely([*tried, Rival(TERMS["backlash"], 500.0, {}, beyond=9.0)])] == [TERMS["backlash"]]


def test_an_asymmetry_whose_fit_ended_in_a_worse_valley_may_be_meant_by_an_offset() -> None:
    """They are the same torque while anything moves, and fits of both lay 20 squares apart by their starts alone."""
    offset, asymmetry, weight = (TERMS[n] for n in ("torque_offset", "friction_asymmetry", "gravity_imbalance"))
    tried = [Rival(offset, 41.0, {}, beyond=9.0), Rival(weight, 6.0, {}, beyond=5.0), Rival(asymmetry, 4.0, {}, 5.0)]
    assert [r.term for r in likely(tried)] == [offset, asymmetry]
    assert [r.term for r in likely([*tried[:2], replace(tried[2], beyond=-1.0)])] == [offset]
    assert [r.term for r in likely([replace(tried[1], gain=60.0), tried[2]])] == [weight]


def test_what_is_as_new_takes_no_place_among_what_noise_may_hide(monkeypatch: pytest.MonkeyPatch) -> None:
    """However much the linear picture promises of it: four were looked at, and dry friction came fifth."""
    new = [next(t for t in ALL if t.mechanism == n) for n in ("eccentricity", "encoder_error", "mesh_error")]
    new += [t for t in ALL if t.mechanism == "eccentricity"][1:2]
    weight = TERMS["gravity_imbalance"]
    problem = Problem(AXIS, MOVED, Noise.flat(0.1, 1.0))
    fit = problem.fit()

    def promised(*_: object) -> list[tuple[float, Term, dict[str, float]]]:
        small = [(50.0, t, {**fit.values, **{p.name: 0.1 * t.size for p in t.parameters}}) for t in new]
        return [*small, (10.0, weight, {**fit.values, **{p.name: weight.size for p in weight.parameters}})]

    monkeypatch.setattr(candidates, "screen", promised)
    assert [r.term.key for r in faint(problem, fit)] == [weight.key]


def test_what_ends_in_a_worse_valley_is_not_what_noise_hides(monkeypatch: pytest.MonkeyPatch) -> None:
    """Held against a fit that began in that valley as well it seemed to take away thousands of squares."""
    weight = TERMS["gravity_imbalance"]
    problem = Problem(AXIS, MOVED, Noise.flat(0.1, 1.0))
    fit = problem.fit()
    far = {p.name: 50.0 * weight.size for p in weight.parameters}
    monkeypatch.setattr(candidates, "screen", lambda *_: [(10.0, weight, {**fit.values, **far})])
    lost = problem.fit((weight,), far, iterations=0)
    assert lost.cost > fit.cost
    monkeypatch.setattr(Problem, "best", lambda *_: lost)
    assert faint(problem, fit) == []


@pytest.mark.parametrize(("offset", "tried"), [(8.0, False), (12.0, True)])
def test_an_asymmetry_of_which_little_is_promised_is_tried_beside_an_offset(
    offset: float, tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = Problem(AXIS, MOVED, Noise.flat(1e3, 1e3))
    fit = problem.fit()
    promises = ((offset, TERMS["torque_offset"]), (10.0, TERMS["friction_asymmetry"]))
    monkeypatch.setattr(
        candidates, "screen", lambda *_: [(gain, t, {**fit.values, **t.probes[0][0]}) for gain, t in promises]
    )
    names = {r.term.mechanism for r in try_terms(problem, fit, [t.mechanism for _, t in promises])}
    assert names == ({t.mechanism for _, t in promises} if tried else set())


def leaving(residual: Array) -> Fit:
    """A fit of one number that says nothing of what is left, shape (n,)."""
    column = np.zeros((residual.size, 1))
    one = Parameter("one", 1.0, 0.1)
    return Fit((), (one,), {"one": 1.0}, residual, column, float(residual @ residual), residual.size)


def test_what_never_rests_must_hold_in_more_than_a_few_blocks() -> None:
    """A tooth may be passed twice in a record; a line of fixed frequency is always there."""
    rng = np.random.default_rng(6)
    quiet = rng.standard_normal(15_000)
    where = np.zeros(15_000)
    where[[*range(3000, 4000), *range(9000, 10_000)]] = 0.5 * np.sin(np.arange(2000))
    everywhere = 0.2 * np.sin(np.arange(15_000))
    few, all_of_them, more = leaving(quiet + where), leaving(quiet + everywhere), leaving(quiet)
    line = replace(TERMS["backlash"], mechanism=FIXED)
    assert holds(TERMS["backlash"], few, more)
    assert not holds(line, few, more)
    assert holds(line, all_of_them, more)


def test_what_is_left_out_as_the_largest_is_left_out_of_both() -> None:
    """A tooth that is passed in four blocks of fifteen, once much harder, holds; what is there once only does not."""
    rng = np.random.default_rng(5)
    quiet = rng.standard_normal(15_000)

    def fitted(squares: dict[int, float]) -> Fit:
        there = quiet.copy()
        for block, square in squares.items():
            part = slice(1000 * block, 1000 * (block + 1))
            there[part] *= np.sqrt(1.0 + square / float(quiet[part] @ quiet[part]))
        return Fit((), (), {}, there, np.zeros((15_000, 0)), float(there @ there), 15_000)

    dent, more = TERMS["backlash"], fitted({})
    assert holds(dent, fitted({2: 240.0, 5: 35.0, 8: 35.0, 11: 35.0}), more)
    assert not holds(dent, fitted({2: 240.0}), more)


def test_friction_that_drifts_is_seen_at_both_ends() -> None:
    """In the middle of a record it is what the description says, and blocks there may lose a little."""
    rng = np.random.default_rng(8)
    quiet, slow = rng.standard_normal(15_000), np.sin(0.2 * np.arange(15_000))
    drift = np.linspace(-1.0, 1.0, 15_000) ** 5 * slow
    middle = np.zeros(15_000)
    middle[4000:11_000] = 0.25 * slow[4000:11_000]
    less, more = leaving(quiet + drift), leaving(quiet + middle)
    assert holds(TERMS["friction_drift"], less, more)
    assert not holds(replace(TERMS["friction_drift"], mechanism=FIXED), less, more)


def test_rows_that_are_predicted_worse_speak_against_a_term_that_lets_the_description_go_back() -> None:
    """A delay that stood for something without a name took 140 squares of strain away and brought 64 to the rows."""
    rng = np.random.default_rng(9)
    quiet = rng.standard_normal(15_000)

    def fitted(scale: float, prior_penalty: float) -> Fit:
        left = scale * quiet
        return Fit((), (), {}, left, np.zeros((15_000, 0)), float(left @ left) + prior_penalty, 15_000)

    bent = fitted(1.0, 200.0)
    assert holds(TERMS["time_delay"], bent, fitted(1.0, 50.0))
    assert holds(TERMS["time_delay"], bent, fitted(0.998, 50.0))
    assert not holds(TERMS["time_delay"], bent, fitted(1.002, 50.0))
    asymmetry = next(t for t in ALL if t.mechanism == "friction_asymmetry")
    assert holds(asymmetry, bent, fitted(1.002, 50.0))  # the offset of every model explains the rows as well


@pytest.mark.parametrize(("noise", "prior_penalty"), [(1.3, 50.0), (2.5, 50.0), (1.0, 200.0), (4.5, 50.0)])
def test_a_model_that_leaves_far_more_than_noise_or_bends_far_lacks_something(
    noise: float, prior_penalty: float
) -> None:
    """Without a cause 1.3 times the noise is left at most; where something is, it is said where most of it lies."""
    rows = 10_000
    residual = np.full(rows, math.sqrt(noise))
    fit = Fit((), (), {}, residual, np.zeros((rows, 0)), float(residual @ residual) + prior_penalty, rows)
    places = [
        Unexplained("time", "motor_torque_nm", 0.0, 0.0, {}),
        Unexplained("speed", "motor_torque_nm", 0.0, 0.0, {}),
    ]
    assert left(places, fit) == (places[:1] if noise > 2.0 else [])
    assert inadequacy(fit) == pytest.approx(max(0.0, noise - 4.0) * rows + max(0.0, prior_penalty - 120.0))


def test_numbers_that_the_description_has_anyway_cost_nothing_where_they_are_set_free() -> None:
    rows = 20_000
    own = replace(TERMS["mesh_error"], replaces=())
    free = replace(own, replaces=tuple(p.name for p in own.parameters[:2]))
    assert penalty(own, rows) - penalty(free, rows) == pytest.approx(math.log(rows))


def test_numbers_of_a_usual_size_cost_what_they_deviate_from_it_and_nothing_more() -> None:
    rows, law = 20_000, TERMS["stribeck_friction"]
    alone = replace(law, parameters=law.parameters[:1])
    assert penalty(law, rows) == penalty(alone, rows)
    unknown = replace(law, parameters=tuple(replace(p, spread=math.inf) for p in law.parameters))
    assert penalty(unknown, rows) > penalty(law, rows)


def test_friction_that_was_left_out_is_no_more_than_a_third_of_its_gain_short_on_rows_not_seen() -> None:
    """A description without any leaves it out, so that little is asked of it there, of eight squares as of more."""
    quiet = np.random.default_rng(6).standard_normal(15_000)
    where = np.zeros(15_000)
    where[[*range(3000, 4000), *range(9000, 10_000)]] = 1.0
    less, more = (leaving(quiet + share * where) for share in (0.045, 0.0))
    gain = less.cost - more.cost
    assert 5.0 < gain < 10.0
    rubs = replace(TERMS["backlash"], mechanism="coulomb_friction")
    assert holds(rubs, less, more)
    assert not holds(TERMS["backlash"], less, more)
    assert not holds(rubs, more, less)


@pytest.mark.parametrize("weight_n_m", [0.0, 0.02])
def test_a_small_cause_under_slow_noise_is_found_once_noise_is_taken_from_its_own_fit(weight_n_m: float) -> None:
    """Weight of two fifths of the noise, which is as slow as the motion."""
    time, angle, speed, acceleration = motion(24.0)
    rng = np.random.default_rng(1)
    pole = math.exp(-2.0 * math.pi * 2.0 / RATE_HZ)
    slow = lfilter([math.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(time.size + 3000))[3000:]
    noise = 0.05 * slow + 0.03 * rng.standard_normal(time.size)
    torque = 0.01 * acceleration + np.tanh(speed / 0.01) + 0.02 * speed + weight_n_m * np.sin(angle + 0.3) + noise
    rubs = {"coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"motor": {"inertia_kg_m2": 0.01, **rubs}, "load": {"inertia_kg_m2": 1e-9}})
    channels = {"motor_torque_nm": torque, "motor_position_rad": angle + 1e-6 * rng.standard_normal(time.size)}
    measured = examine(axis, Telemetry(time, channels)).measurement
    problem, fit = look_closely(*calibrate(Problem(axis, measured, Noise.flat(0.1, 1.0))))
    _, entry = unmasked(problem, fit, {})
    if not weight_n_m:
        assert not entry.new
        return
    (best,) = entry.new
    assert [t.key for t in entry.fit.terms] == [best.term.key] == [Key("gravity_imbalance", "load")]
    assert entry.brought[best.term.key] > best.gain  # noise taken without it had held some of it
    assert best.term.report(entry.fit.values)["torque_n_m"] == pytest.approx(weight_n_m, rel=0.3)


def test_runout_at_the_load_is_held_against_what_is_as_new_together_with_the_error_of_its_encoder() -> None:
    """Half of one error each: neither is more than new, their sum is."""
    runout = next(t for t in ALL if t.key == Key("eccentricity", "output"))
    sine, cosine = (p.name for p in runout.parameters)
    half = 0.8 * runout.size
    shared = {sine: half, cosine: 0.0, "load_encoder.error_sine_rad": -half, "load_encoder.error_cosine_rad": 0.0}
    assert magnitude(runout, shared) == pytest.approx(2.0 * half)
    assert magnitude(runout, {**shared, "load_encoder.error_sine_rad": half}) == 0.0
    assert runout.report(shared)["amplitude_rad"] == pytest.approx(half)


def test_a_loop_or_a_loss_of_erring_teeth_is_the_damping_of_what_they_shake() -> None:
    """And a loop alone, or one that brings as much as the errors, is one."""
    entered = {Key("mesh_error", "output"): 1000.0}
    assert is_model_error(TERMS["hysteresis"], 250.0, entered)
    assert is_model_error(TERMS["load_dependent_loss"], 60.0, entered)
    assert not is_model_error(TERMS["hysteresis"], 450.0, entered)
    assert not is_model_error(TERMS["hysteresis"], 250.0, {})
    mesh = replace(TERMS["eccentricity"], mechanism="mesh_error")
    assert not is_model_error(mesh, 250.0, {Key("hysteresis", "output"): 1000.0})  # and not the other way round


@pytest.mark.parametrize(("teeth", "share"), [("backlash", 0.03), ("tooth_damage", 0.3)])
def test_what_teeth_do_that_explains_most_is_not_asked_on_rows_not_seen(teeth: str, share: float) -> None:
    """Where they hit, the linear refit without a block may be thousands of squares off."""
    fit = Fit((), (), {}, np.ones(1000), np.zeros((1000, 0)), 1000.0, 1000)
    term = replace(TERMS["backlash"], mechanism=teeth)
    assert needs_no_trial(term, share * fit.misfit, fit)
    assert not needs_no_trial(term, 0.01 * fit.misfit, fit)
    assert not needs_no_trial(TERMS["hysteresis"], 10.0 * fit.misfit, fit)


def test_of_runout_at_the_load_and_the_error_of_its_encoder_one_is_found() -> None:
    """Both in one model share what only their sum is known of; runout elsewhere stands for itself."""
    problem = Problem(AXIS, MOVED, Noise.flat(0.1, 1.0))
    fit = Fit((), (), {}, np.zeros(1), np.zeros((1, 0)), 0.0, 1)
    at_load, at_motor = (next(t for t in ALL if t.key == Key("eccentricity", place)) for place in ("output", "motor"))
    found = (at_load, TERMS["encoder_error"], at_motor)
    gains = {at_load.key: 60.0, TERMS["encoder_error"].key: 90.0, at_motor.key: 40.0}
    told = drop_unidentifiable(Selection(problem, fit, fit, gains, {}, (), found, {}))
    assert told.found == (TERMS["encoder_error"], at_motor)


def test_what_is_as_damped_as_it_may_be_is_no_part_that_swings() -> None:
    share, frequency, damping = (p.name for p in TERMS["structural_resonance"].parameters)
    half = {share: 0.5, frequency: 20.0}
    assert magnitude(TERMS["structural_resonance"], {**half, damping: SHARP}) == pytest.approx(0.5 / (2.0 * SHARP))
    sharper = magnitude(TERMS["structural_resonance"], {**half, damping: 0.5 * SHARP})
    assert sharper == pytest.approx(4.0 * 0.5 / (2.0 * SHARP))
    assert magnitude(TERMS["structural_resonance"], {**half, damping: SOFTEST}) == 0.0


KNOWN, UNKNOWN = {"driver_teeth": 12, "driven_teeth": 60}, {"ratio": 5.0}


@pytest.mark.parametrize(("teeth", "theirs"), [(UNKNOWN, {8.0, 10.0, 12.0, 18.0, 24.0}), (KNOWN, {12.0, 24.0})])
def test_ripple_at_the_orders_of_the_first_pinion_must_be_more_than_its_teeth_as_new(
    teeth: dict[str, float], theirs: set[float]
) -> None:
    stage = {"name": "output", **teeth, "stiffness_n_m_per_rad": 2e5, "transmission_error_rad": 3e-5}
    axis = read_axis({"motor": {"inertia_kg_m2": 0.01}, "stages": [stage], "load": {"inertia_kg_m2": 0.3}})
    _, angle, _, acceleration = motion()
    m = prepare(RATE_HZ, 0.02 * acceleration, angle, None)
    ripples = [term for term in terms_of(axis, m, Chain((Shaft(0.01),))) if term.mechanism == "torque_ripple"]
    new = 3e-5 * 2e5 / 5.0
    held = {
        float(r.parameters[0].name.split("@")[0].removeprefix("torque_ripple")): r.size >= 3.0 * new for r in ripples
    }
    assert {order for order, is_held in held.items() if is_held} == theirs


def test_ripple_at_the_orders_of_a_pinion_of_unknown_stiffness_must_be_more_than_stiff_teeth_make() -> None:
    pair = {**KNOWN, "transmission_error_rad": 3e-5}
    stages = [{"name": "transfer", "inertia_kg_m2": 0.02, **pair}, {"name": "output", **pair}]
    rest = {"motor": {"inertia_kg_m2": 0.01}, "load": {"inertia_kg_m2": 3.0}}
    open_axis = read_axis({**rest, "stages": stages, "transmission": {"stiffness_n_m_per_rad": 1e5}})
    each = open_axis.stiffness()
    given = [{**s, "stiffness_n_m_per_rad": k} for s, k in zip(stages, each, strict=True)]
    m = prepare(RATE_HZ, 0.02 * motion()[3], motion()[1], None)
    sizes = [
        next(
            t.size
            for t in terms_of(axis, m, Chain((Shaft(0.01),)))
            if t.parameters[0].name.startswith("torque_ripple12")
        )
        for axis in (read_axis({**rest, "stages": given}), open_axis)
    ]
    assert sizes[1] == pytest.approx(1.8 * sizes[0])


def test_a_stiffness_that_the_others_leave_of_the_whole_is_known_less_than_one_that_is_given() -> None:
    stages = [{"name": "transfer", "inertia_kg_m2": 0.02, **KNOWN}, {"name": "output", **KNOWN}]
    rest = {"motor": {"inertia_kg_m2": 0.01}, "load": {"inertia_kg_m2": 3.0}}
    stages[0]["stiffness_n_m_per_rad"] = 1e5
    axis = read_axis({**rest, "stages": stages, "transmission": {"stiffness_n_m_per_rad": 1e6}})
    known = {p.name: p for p in base_parameters(axis, load_encoder=False, level_n_m=1.0)}
    for stage, share in (("transfer", 0.03), ("output", 0.4)):
        stiffness = known[f"stages.{stage}.stiffness_n_m_per_rad"]
        assert stiffness.spread == pytest.approx(share * stiffness.expected)


def test_what_good_gears_err_twice_per_tooth_comes_in_and_is_not_spoken_of() -> None:
    """The description's own model has it once per tooth. A load on a spring whose other end moves as the teeth do."""
    ratio, inertia, stiffness, damping, new_rad = 3.0, 2.0, 1e4, 20.0, 3e-5
    teeth = {"driver_teeth": 10, "driven_teeth": 30, "transmission_error_rad": new_rad}
    stage = {"name": "output", **teeth, "stiffness_n_m_per_rad": stiffness, "damping_n_m_s_per_rad": damping}
    rubs = {"coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"motor": {"inertia_kg_m2": 0.01, **rubs}, "stages": [stage], "load": {"inertia_kg_m2": inertia}})
    time, angle, *_ = motion()
    drawn = angle / ratio - 0.6 * new_rad * np.sin(60.0 * angle / ratio + 0.4)
    load = lsim(([damping, stiffness], [inertia, damping, stiffness]), drawn, time)[1]
    plain = one_body(0.01, 1.0, 0.02, seed=1)
    twist = drawn - load
    bears = (stiffness * twist + damping * np.gradient(twist) * RATE_HZ) / ratio
    seen = load + 2e-6 * np.random.default_rng(2).standard_normal(time.size)
    torque = plain.channels["motor_torque_nm"] + bears
    said = investigate(
        axis, replace(plain, channels={**plain.channels, "motor_torque_nm": torque, "load_position_rad": seen})
    )
    assert said.verdict == "nothing_missing"
    assert said.selection is not None
    (twice,) = [t for t in said.selection.fit.terms if t.location == "output"]
    assert not twice.named
    sine, cosine = (said.selection.fit.values[p.name] for p in twice.parameters)
    assert math.hypot(sine, cosine) == pytest.approx(0.6 * new_rad, rel=0.2)
