"""Novelty: what the library knows is seldom refused, whatever the number of gearboxes, and what it does not know is."""

import numpy as np
import pytest

from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.novelty import NOISE, RATIOS, Likeness, kinds, likenesses
from casebase.reasoning.tuning import TUNING
from casebase.search.case_table import CaseTable
from signals.features import catalogue, extract
from signals.recording import Recording
from tests.casebase.made import heard_table, measured_table
from tests.signals.synthetic import RATE_HZ, Joint, sound

NAMES = tuple(catalogue())
SAYS = kinds(NAMES) >= 0


def table(values: np.ndarray, gearboxes: np.ndarray, labels: list[str] | None = None) -> CaseTable:
    """Return measured cases, of sound gears unless labels are given."""
    return measured_table(NAMES, values, labels or ["normal"] * len(values), gearboxes.tolist())


def of(values: np.ndarray, gearboxes: np.ndarray) -> Likeness:
    return likenesses(table(values, gearboxes), np.ones(len(values), bool))[frozenset({"normal"})]


@pytest.mark.parametrize("boxes", [2, 3, 5, 10])
@pytest.mark.parametrize("freedom", [6, 100])
def test_what_the_library_knows_is_seldom_refused(boxes: int, freedom: int) -> None:
    """Scatter of Student's t, drawn anew per feature, within gearboxes and in half of the trials between them too.

    In half of those all features share what gearboxes differ by. Two gearboxes show little of what these differ by.
    """
    rng = np.random.default_rng(boxes)
    refused, trials = [], 600
    for trial in range(trials):
        scale = 4 * np.exp(0.5 * rng.normal(size=len(NAMES)))
        shared = rng.standard_t(freedom, size=(boxes + 1, 1 if trial % 2 else len(NAMES)))
        values = np.repeat(shared * (3.0 if trial % 4 > 1 else 0.0) * scale, 2, axis=0)
        values += rng.standard_t(freedom, size=values.shape) * scale
        refused.append(of(values[:-2], np.repeat(np.arange(boxes), 2)).p_value(values[-1]) < TUNING.level)
    assert np.mean(refused) <= (0.11 if boxes == 2 else 0.08)


def test_one_feature_that_departs_far_is_enough() -> None:
    rng = np.random.default_rng(4)
    ratios = np.array([name.startswith(RATIOS) for name in NAMES])
    drawn = rng.normal(size=(21, len(NAMES)))
    values = np.where(ratios, np.exp(drawn), drawn)
    known, odd = of(values[:20], np.arange(20) // 2), values[20]
    assert known.p_value(odd) > TUNING.level
    for index in np.flatnonzero(SAYS & (np.array(NAMES) != NOISE)):
        far = odd.copy()
        away = 12 * known.scale[index]
        far[index] = far[index] * np.exp(away) if ratios[index] else far[index] + away
        assert known.p_value(far) < TUNING.level
        assert np.nanargmax(np.abs(known.departures(far))) == index


def test_level_and_what_is_missing_have_no_say() -> None:
    rng = np.random.default_rng(5)
    known = of(rng.normal(size=(12, len(NAMES))), np.arange(12) // 2)
    asked = rng.normal(size=len(NAMES))
    other = asked.copy()
    other[~SAYS] = 1e6
    assert known.p_value(other) == known.p_value(asked)
    assert known.p_value(np.full(len(NAMES), np.nan)) == 1.0
    for name in ("rms", "peak", "crest_factor_whole_record", "impulse_rate_12_200_hz", "cycles_left"):
        assert not SAYS[NAMES.index(name)]


def test_one_gearbox_alone_says_nothing() -> None:
    values = np.random.default_rng(6).normal(size=(6, len(NAMES)))
    assert not likenesses(table(values, np.zeros(6, int)), np.ones(6, bool))


@pytest.mark.parametrize("boxes", [2, 4, 8])
def test_a_fault_that_grew_by_a_third_is_not_novel(boxes: int) -> None:
    """Its cases depart by ten standard deviations; six times as much in one feature alone is another fault."""
    rng = np.random.default_rng(boxes)
    fault = np.where(np.arange(len(NAMES)) % 5 == 0, 10.0, 0.0)
    of_box = np.repeat(rng.normal(size=(boxes, len(NAMES))), 2, axis=0)
    normal, worn = (of_box + rng.normal(size=of_box.shape) + shift for shift in (0.0, fault))
    labels = ["normal"] * len(normal) + ["wear"] * len(worn)
    cases = table(np.concatenate([normal, worn]), np.tile(np.repeat(np.arange(boxes), 2), 2), labels)
    known = likenesses(cases, np.ones(len(cases), bool))[frozenset({"wear"})]
    asked = rng.normal(size=(200, len(NAMES))) * np.sqrt(2)
    refused = [np.mean([known.p_value(each + size * fault) < TUNING.level for each in asked]) for size in (1.0, 4 / 3)]
    assert max(refused) <= 2 * TUNING.level
    other = np.where(np.arange(len(NAMES)) == 25, 60.0, fault)
    assert np.mean([known.p_value(each + other) < TUNING.level for each in asked]) >= 0.9


def bearing(seed: int) -> np.ndarray:
    """Return the sound of a joint whose bearing clicks at a steady rate while it moves, faint against the noise."""
    joint = Joint(seed=seed)
    samples = sound(joint).astype(np.float64)
    time = np.arange(samples.size) / RATE_HZ
    since = (time - joint.start_s) % joint.stroke_s
    speed = np.clip(np.minimum(since, joint.stroke_s - since) / joint.braking_s, 0.0, 1.0)
    clicks = np.diff(np.floor(np.cumsum(speed) / RATE_HZ * 37.0), prepend=0.0)
    ring = np.exp(-np.arange(80) / 16) * np.sin(2 * np.pi * 2300 * np.arange(80) / RATE_HZ)
    return samples + 1.5 * samples.std() * np.convolve(clicks, ring)[: samples.size]


def test_a_fault_that_no_case_has_is_never_normal() -> None:
    """With the cases of three gearboxes, each normal, notch and play."""
    reasoner = Reasoner(heard_table(lambda label, seed: extract(Recording(sound(Joint(label, seed)), RATE_HZ)), 3))
    for seed in range(90, 96):
        sound_gear = reasoner.diagnose(extract(Recording(sound(Joint(seed=seed)), RATE_HZ)))
        assert (sound_gear.verdict, sound_gear.label) in {("diagnosed", "normal"), ("ambiguous", "normal")}
        flawed = reasoner.diagnose(extract(Recording(bearing(seed).astype(np.float32), RATE_HZ)))
        assert (flawed.verdict, flawed.label) == ("not_in_library", None)
        assert flawed.evidence[0].quantity.startswith("envelope_line")
