"""Several recordings of one axis: their evidence adds up, their numbers are pooled, faults of one stay with it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import one_body, swing
from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.description.axis_document import read_axis
from sim.investigation.acoustic.evidence import SILENT
from sim.investigation.data.validation import InvestigationError
from sim.investigation.investigate import investigate
from sim.investigation.pooling.joint_investigation import Together, changed, investigate_together
from sim.investigation.pooling.pooled_estimates import NamedRecording, pooled_estimate
from sim.investigation.pooling.recording_evidence import (
    PRIOR,
    Known,
    LogOdds,
    Name,
    against,
    existence,
    logit,
    pooled,
    probability,
    silent,
    weighed,
)
from sim.investigation.results import Estimate, Finding
from tests.sim.investigation.test_investigation import axis

TEMPERED = 0.3


def naming(p: float) -> LogOdds:
    """A recording that names it with this probability."""
    return LogOdds(logit(p) - PRIOR)


def said(*sayings: LogOdds, own: tuple[float, ...] = (0.8,)) -> float:
    return probability(existence(sayings), against(sayings).values(), own)


# --- probabilities ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("p", [0.02, 0.3, 0.8, 0.95])
def test_one_recording_says_what_it_says_alone(p: float) -> None:
    assert said(naming(p), own=(p,)) == pytest.approx(p)


def test_two_that_agree_are_surer_than_either() -> None:
    assert said(naming(0.8), naming(0.7), own=(0.8, 0.7)) == pytest.approx(0.975)
    odds = 0.3 / 0.7 * 0.3 / 0.7 / math.exp(PRIOR)  # Bayes: the prior counts once
    assert said(naming(0.3), naming(0.3), own=(0.3, 0.3)) == pytest.approx(odds / (1.0 + odds))


def test_a_silent_recording_counts_as_far_as_it_could_have_seen_it() -> None:
    blind, excludes = LogOdds(silent(0.0, TEMPERED)), LogOdds(silent(-30.0, TEMPERED))
    assert said(naming(0.8), blind) == pytest.approx(0.8)
    assert said(naming(0.8), excludes) < 0.1


def test_what_some_show_and_more_deny_is_denied_and_no_recording_is_worth_more_than_another() -> None:
    shows, denies = LogOdds(30.0), LogOdds(silent(-1e6, TEMPERED))
    assert said(shows, shows, *[denies] * 3, own=(0.95, 0.95)) < 0.02
    assert said(shows, denies, own=(0.95,)) < 0.5
    assert said(*[shows] * 7, denies, own=(0.95,) * 7) > 0.9


def test_no_number_of_agreeing_recordings_makes_a_name_certain() -> None:
    certain = [said(*[naming(0.99)] * n, own=(0.95,) * n) for n in (1, 2, 4)]
    assert certain == [pytest.approx(0.95), pytest.approx(0.975), pytest.approx(0.9875)]


def test_what_no_recording_tells_apart_two_do_not_either() -> None:
    rival = Name("hysteresis", "output")
    even = LogOdds(30.0, {rival: 0.0})
    assert said(even, even) == pytest.approx(0.5, abs=1e-3)
    assert said(LogOdds(30.0, {rival: 2.0}), LogOdds(30.0, {rival: -2.0})) == pytest.approx(0.5, abs=1e-3)
    assert said(even, LogOdds(30.0, {rival: 2.0})) == pytest.approx(1.0 / (1.0 + math.exp(-2.0)), abs=1e-3)


# --- numbers ----------------------------------------------------------------------------------------------------------


def test_inverse_variances_add_up() -> None:
    one = pooled([Known(1.0, 0.1), Known(1.2, 0.2)])
    assert one.value == pytest.approx((100.0 * 1.0 + 25.0 * 1.2) / 125.0)
    assert one.sd == pytest.approx(125.0**-0.5)


def test_disagreement_widens_the_interval_by_birges_ratio() -> None:
    one = pooled([Known(0.0, 1.0), Known(6.0, 1.0)])
    assert one.sd == pytest.approx(math.sqrt(0.5) * math.sqrt(18.0))


def test_what_was_known_before_counts_once() -> None:
    """Recordings that say nothing have all the deviation of the data sheet, and so have they together."""
    assert pooled([Known(1.0, 0.05, 0.05)] * 5).sd == pytest.approx(0.05)


def test_angles_are_pooled_on_the_circle() -> None:
    one = pooled([Known(6.2, 0.1), Known(0.1, 0.1)], 2 * math.pi)
    assert one.value == pytest.approx(0.5 * (6.2 + 0.1 + 2 * math.pi) - 2 * math.pi)
    assert one.sd < 0.1


def test_a_side_is_that_of_most_recordings() -> None:
    assert pooled([Known(1.0, 0.0), Known(-1.0, 0.0), Known(-1.0, 0.0)]) == Known(-1.0, 0.0)


def test_what_the_form_of_a_law_leaves_open_does_not_average_out() -> None:
    same = [Estimate("torque_n_m", 1.0, "N m", 0.92, 1.08)] * 4
    assert pooled_estimate(same).high == pytest.approx(1.04)
    assert pooled_estimate(same, share=0.08).high == pytest.approx(1.08)


def test_a_change_is_told_only_where_intervals_lie_apart() -> None:
    def size(value: float) -> tuple[Estimate, ...]:
        return (Estimate("gap_rad", value, "rad", value - 0.1, value + 0.1),)

    assert changed("play", {"first": size(1.0), "last": size(1.15)}) == []
    assert changed("play", {"first": size(1.0), "last": size(1.5)}) == [
        "play: gap_rad grew from 1 to 1.5 rad between first and last."
    ]


# --- whole investigations ---------------------------------------------------------------------------------------------


def rise(size: float = 0.6) -> Array:
    """Friction that rises at low speed [N m]."""
    _, _, speed, _ = swing()
    return np.asarray(size * np.exp(-((speed / 6.0) ** 2)) * np.tanh(speed / 0.01))


@pytest.fixture(scope="module")
def friction() -> Together:
    taken = [
        NamedRecording(name, one_body(0.3, 1.0, 0.02, seed)) for name, seed in (("monday.csv", 5), ("friday.csv", 6))
    ]
    return investigate_together(axis(coulomb=0.0, viscous=0.0, inertia=0.29), taken)


def test_two_recordings_are_surer_and_closer_than_each(friction: Together) -> None:
    together = friction.combined
    assert {f.mechanism for f in together.findings} == {"coulomb_friction", "viscous_friction"}
    inertia = together.parameters[0]
    assert inertia.low < 0.3 < inertia.high
    for part in friction.parts:
        assert together.findings[0].probability > part.result.findings[0].probability
        alone = part.result.parameters[0]
        assert inertia.high - inertia.low < alone.high - alone.low


def test_the_document_is_the_contracts_and_has_every_recording(friction: Together) -> None:
    document = json.loads(json.dumps(friction.document(), allow_nan=False))
    assert {"verdict", "findings", "unexplained", "parameters", "gain", "next_measurement", "provenance"} <= set(
        document
    )
    assert [one["name"] for one in document["recordings"]] == ["monday.csv", "friday.csv"]
    assert [one["recording"] for one in document["gain"]] == ["monday.csv", "friday.csv"]
    assert document["findings"][0]["shown_by"] == ["monday.csv", "friday.csv"]
    assert any("2 of 2 recordings show it: monday.csv, friday.csv" in remark for remark in document["remarks"])


def test_the_extended_axis_leaves_nothing_to_find_in_any(friction: Together) -> None:
    extended = read_axis(friction.document()["extended_axis"])  # type: ignore[arg-type]
    assert extended.motor.coulomb_friction_n_m == pytest.approx(1.0, rel=0.05)
    for part in friction.parts:
        assert investigate(extended, part.recording.telemetry).verdict == "nothing_missing"


def test_a_recording_that_would_have_seen_it_speaks_against_it_and_a_noisy_one_does_not() -> None:
    worn, good = one_body(0.3, 1.0, 0.02, 6, extra=rise()), one_body(0.3, 1.0, 0.02, 7)
    noisy = one_body(0.3, 1.0, 0.02, 8, noise_n_m=20.0)
    alone = investigate(axis(), worn).findings[0].probability
    seen = investigate_together(axis(), [NamedRecording("worn", worn), NamedRecording("good", good)]).combined
    unseen = investigate_together(axis(), [NamedRecording("worn", worn), NamedRecording("noisy", noisy)]).combined
    assert seen.findings[0].probability < alone
    assert any("against it: good" in remark for remark in seen.remarks)
    assert unseen.findings[0].probability == pytest.approx(alone, abs=0.05)
    assert unseen.findings[0].parameters[0].value == pytest.approx(0.6, rel=0.15)


def test_a_fault_of_one_recording_stays_with_it() -> None:
    """An offset of the torque sensor in one of two is said with its recording and is no part of the axis."""
    biased, good = one_body(0.3, 1.0, 0.02, 5, extra=0.5), one_body(0.3, 1.0, 0.02, 6)
    result = investigate_together(axis(), [NamedRecording("biased", biased), NamedRecording("good", good)])
    (finding,) = result.combined.findings
    assert finding.mechanism == "torque_offset"
    assert finding.explanation.startswith("In biased: ")
    assert result.shown == (("biased",),)
    assert result.combined.extended.mechanisms == ()


def test_what_is_heard_in_one_recording_is_doubted_by_those_with_sound_only() -> None:
    quiet = investigate(axis(), one_body(0.3, 1.0, 0.02, 5))
    with_sound = replace(quiet, provenance={**quiet.provenance, "sound_sha256": "0"})
    order = Estimate("order", 3.5, "1", 3.4, 3.6)
    finding = Finding("bearing_defect", "motor", 0.9, (order,), (), "Lines at 3.5 per turn.")
    heard = replace(with_sound, findings=(finding,))
    name = Name("bearing_defect", "motor")
    assert weighed([heard])[name].probability == pytest.approx(0.9)
    assert weighed([heard, quiet])[name].probability == pytest.approx(0.9)
    assert logit(weighed([heard, with_sound])[name].probability) == pytest.approx(logit(0.9) + math.log(SILENT))
    assert weighed([heard, heard])[name].probability > 0.95


def steady(speed_rad_s: float, seed: int, ripple_n_m: float = 0.0) -> Telemetry:
    """Torque of dry friction of 1 N m and a ripple of 5 per turn at one speed."""
    t = np.arange(0.0, 20.0, 0.005)
    noise = 0.02 * np.random.default_rng(seed).standard_normal(t.size)
    torque = math.copysign(1.0, speed_rad_s) + ripple_n_m * np.sin(5.0 * speed_rad_s * t) + noise
    return Telemetry(t, {"motor_torque_nm": torque, "motor_position_rad": speed_rad_s * t})


def test_what_one_speed_leaves_open_several_tell() -> None:
    """Dry and viscous friction, and an offset, are the same torque in each, and of one size in none but the first."""
    bare = axis(coulomb=0.0, viscous=0.0)
    runs = [steady(speed, seed) for seed, speed in enumerate((3.0, 9.0, -3.0, -9.0))]
    alone = investigate(bare, runs[0])
    assert [(f.mechanism, f.probability) for f in alone.findings] == [("coulomb_friction", 0.5)]
    (found,) = investigate_together(bare, [NamedRecording(str(k), run) for k, run in enumerate(runs)]).combined.findings
    assert found.mechanism == "coulomb_friction"
    assert found.probability > 0.9
    assert found.indistinguishable_from == ()


def test_a_ripple_that_other_speeds_do_not_show_is_no_ripple() -> None:
    """At one speed in one direction it may as well be a fixed frequency, and is said so."""
    runs = [steady(4.0, 1, 0.2), *(steady(speed, k) for k, speed in enumerate((3.0, 9.0, -3.0), start=2))]
    (alone,) = [f for f in investigate(axis(), runs[0]).findings if f.mechanism == "torque_ripple"]
    assert alone.probability <= 0.5
    assert "electrical_hum" in alone.indistinguishable_from
    together = investigate_together(axis(), [NamedRecording(str(k), run) for k, run in enumerate(runs)]).combined
    assert all(f.probability < 0.5 for f in together.findings if f.mechanism == "torque_ripple")


def test_a_bad_recording_among_good_ones_is_named() -> None:
    good, still = one_body(0.3, 1.0, 0.02, 5), one_body(0.3, 1.0, 0.02, 6)
    still.channels["motor_position_rad"][:] = 0.5
    with pytest.raises(InvestigationError, match=r"^still.csv: .*stands still"):
        investigate_together(axis(), [NamedRecording("good.csv", good), NamedRecording("still.csv", still)])
    with pytest.raises(InvestigationError, match=r"^b: holds the same values as a"):
        investigate_together(axis(), [NamedRecording("a", good), NamedRecording("b", good)])
