"""`normal` is earned: a sound gear is seldom refused whatever the number of gearboxes, and a fault is."""

import numpy as np
import pytest
from casebase.baseline import UNLIKE, Baseline, baseline, kinds
from casebase.learning import learn

from casebase.case_table import CaseTable
from casebase.diagnosis import Reasoner
from casebase.signals.features import catalogue, extract
from casebase.signals.recording import Recording
from tests.casebase.made import measured_table
from tests.casebase.signals.synthetic import RATE_HZ, Joint, sound

NAMES = tuple(catalogue())
SAYS = kinds(NAMES) >= 0


def table(values: np.ndarray, gearboxes: np.ndarray, labels: list[str] | None = None) -> CaseTable:
    """Return measured cases, of sound gears unless labels are given."""
    return measured_table(NAMES, values, labels or ["normal"] * len(values), gearboxes.tolist())


def of(values: np.ndarray, gearboxes: np.ndarray) -> Baseline:
    found = baseline(table(values, gearboxes), np.ones(len(values), bool))
    assert found is not None
    return found


@pytest.mark.parametrize("boxes", [2, 3, 5, 10])
@pytest.mark.parametrize("between", [0.0, 3.0])
def test_a_sound_gear_is_seldom_refused(boxes: int, between: float) -> None:
    """Scatter drawn anew per feature, between gearboxes and within.

    In half of the trials all features share what gearboxes differ by: two or three gearboxes then say less than is
    assumed, and up to four times as many are refused. Beside that, what 400 draws of such a share scatter by.
    """
    rng = np.random.default_rng(boxes)
    refused, trials = [], 400
    for trial in range(trials):
        scale = np.exp(0.5 * rng.normal(size=len(NAMES)))
        level = rng.normal(size=(boxes + 1, 1 if trial % 2 else len(NAMES))) * between * scale
        values = np.repeat(level, 2, axis=0) + rng.normal(size=(2 * boxes + 2, len(NAMES))) * scale
        known, asked = values[:-2], values[-1]
        refused.append(of(known, np.repeat(np.arange(boxes), 2)).p_value(asked) < UNLIKE)
    share = UNLIKE if boxes > 3 else 4 * UNLIKE
    assert np.mean(refused) <= share + 3 * np.sqrt(share * (1 - share) / trials)


def test_one_feature_that_departs_far_is_enough() -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(size=(20, len(NAMES)))
    known = of(values, np.arange(20) // 2)
    odd = rng.normal(size=len(NAMES))
    assert known.p_value(odd) > UNLIKE
    for index in np.flatnonzero(SAYS)[::7]:
        far = odd.copy()
        far[index] += 12.0
        assert known.p_value(far) < UNLIKE
        assert np.nanargmax(np.abs(known.departures(far))) == index


def test_level_colour_and_what_is_missing_have_no_say() -> None:
    rng = np.random.default_rng(5)
    known = of(rng.normal(size=(12, len(NAMES))), np.arange(12) // 2)
    asked = rng.normal(size=len(NAMES))
    other = asked.copy()
    other[~SAYS] = 1e6
    assert known.p_value(other) == known.p_value(asked)
    assert known.p_value(np.full(len(NAMES), np.nan)) == 1.0
    for name in ("rms", "band_level_16_23_hz", "crest_factor_whole_record", "impulse_rate_12_200_hz", "cycles_left"):
        assert not SAYS[NAMES.index(name)]


def test_one_gearbox_alone_says_nothing() -> None:
    values = np.random.default_rng(6).normal(size=(6, len(NAMES)))
    one = table(values, np.zeros(6, int))
    assert baseline(one, np.ones(6, bool)) is None


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
    labels = ["normal", "notch", "play"]
    made = [(box, label, 10 * box + i) for box in range(3) for label in labels for i in range(2)]
    vectors = [extract(Recording(sound(Joint(label, seed=seed)), RATE_HZ)).features.values for _, label, seed in made]
    cases = table(np.array(vectors), np.array([box for box, _, _ in made]), [label for _, label, _ in made])
    reasoner = Reasoner(cases, learn(cases))
    for seed in range(90, 96):
        sound_gear = reasoner.diagnose(extract(Recording(sound(Joint(seed=seed)), RATE_HZ)))
        assert (sound_gear.verdict, sound_gear.label) in {("diagnosed", "normal"), ("ambiguous", "normal")}
        flawed = reasoner.diagnose(extract(Recording(bearing(seed).astype(np.float32), RATE_HZ)))
        assert (flawed.verdict, flawed.label) == ("not_in_library", None)
        assert flawed.evidence[0].quantity.startswith("envelope_line")
