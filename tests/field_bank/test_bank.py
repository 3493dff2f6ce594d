"""The bank's truths hold: what it says of its sounds is so. Nothing here asks the product."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import soundfile as sf
from scipy import signal

from tests.field_bank.bank import PER_KIND, balanced, half_seed, with_standstills, write
from tests.field_bank.disturbances import KINDS, cut
from tests.field_bank.foreign import FAMILIES, foreign
from tests.field_bank.gearboxes import (
    LABELS,
    SMALLEST_RAD,
    UNSEEN,
    Motion,
    Recording,
    draw_motion,
    make_units,
    motion_angle,
    record,
)
from tests.field_bank.product import Answer
from tests.field_bank.score import Asked, counts, reliability
from tests.field_bank.sounds import Floats, band, envelope, formant_voice, reverberated, rms


@cache
def made(label: str, seed: int = 3, unit: int = 0) -> Recording:
    return record(make_units(np.random.default_rng(11))[unit], label, np.random.default_rng(seed))


def low(x: Floats, rate: int) -> Floats:
    return np.abs(band(x, rate, 0, 200, 4))


# machines


@pytest.mark.parametrize("seed", range(6))
def test_a_notch_strikes_once_per_cycle_at_one_angle_in_one_direction(seed: int) -> None:
    r = made("notch", seed)
    assert np.allclose(np.diff(r.events_s), r.period_s, atol=2e-3)


@pytest.mark.parametrize("seed", range(6))
def test_play_strikes_in_both_directions_and_near_the_ends_of_strokes_only(seed: int) -> None:
    r = made("play", seed)
    assert len(r.events_s) >= 3 * (20 / r.period_s - 1)
    ends = np.array(r.sound.standstills).ravel()
    # braking begins a ramp before the standstill, and no ramp is longer than 0.6 s
    assert max(float(np.min(np.abs(ends - t))) for t in r.events_s if ends[0] < t < ends[-1]) < 0.62


def test_normal_has_no_strike_and_no_size() -> None:
    r = made("normal")
    assert r.events_s == ()
    assert r.size_rad == 0


@pytest.mark.parametrize("label", ["notch", "play", UNSEEN])
def test_faults_have_a_size_from_barely_to_plainly_audible(label: str) -> None:
    sizes = [made(label, seed).size_rad for seed in range(6)]
    assert all(SMALLEST_RAD <= s <= 10 * SMALLEST_RAD for s in sizes)
    assert len(set(sizes)) == len(sizes)


def test_a_large_notch_stands_out_of_the_low_band_where_it_is_said_to_strike() -> None:
    seed = max(range(12), key=lambda s: made("notch", s).size_rad)
    r = made("notch", seed)
    y = low(r.sound.samples, r.sound.rate)
    for at in r.events_s:
        i = int(at * r.sound.rate)
        assert np.max(y[i : i + 800]) > 5 * rms(y)


def test_the_crest_factor_below_200_hz_grows_from_normal_to_faults() -> None:
    def crest(label: str) -> float:
        sounds = [made(label, s).sound for s in range(5)]
        return float(np.median([np.max(low(x.samples, x.rate)[400:]) / rms(low(x.samples, x.rate)) for x in sounds]))

    assert crest("normal") < 6.5
    assert crest("play") > 7
    assert crest("notch") > 7


@pytest.mark.parametrize("label", [*LABELS, UNSEEN])
@pytest.mark.parametrize("rate", [8000, 44100])
def test_recordings_are_finite_and_as_loud_as_recordings_are(label: str, rate: int) -> None:
    x = record(make_units(np.random.default_rng(1))[2], label, np.random.default_rng(5), rate=rate).sound.samples
    assert x.shape == (20 * rate,)
    assert np.all(np.isfinite(x))
    assert 0.002 < rms(x) < 0.2
    assert np.max(np.abs(x)) < 1


def test_the_same_seed_makes_the_same_recording_and_another_does_not() -> None:
    units = make_units(np.random.default_rng(11))
    again = record(units[0], "notch", np.random.default_rng(3)).sound.samples
    assert np.array_equal(again, made("notch").sound.samples)
    assert not np.array_equal(again, made("notch", 4).sound.samples)


def test_a_motion_returns_to_where_it_began_and_turns_by_its_stroke() -> None:
    for seed in range(20):
        m = draw_motion(np.random.default_rng(seed))
        angle = motion_angle(m, np.linspace(0, m.period_s, 2000))
        assert np.isclose(angle[0], angle[-1], atol=1e-2)
        assert np.isclose(np.ptp(angle), m.stroke_rad, rtol=0.01)
        assert 3 <= m.period_s <= 8
        assert m.stroke_rad <= 5.51


def test_a_trapezoid_and_an_s_curve_reach_the_speed_and_stand_in_the_dwell() -> None:
    for smooth in (False, True):
        m = Motion(5.0, 0.4, 0.3, 2.0, smooth, 0.0)
        speed = m.speed(np.array([1.0, 2.3, 3.5, 4.8]))
        assert np.allclose(speed, [2.0, 0.0, -2.0, 0.0])


def test_an_unknown_label_is_refused() -> None:
    with pytest.raises(ValueError, match="no such label: broken"):
        record(make_units(np.random.default_rng(1))[0], "broken", np.random.default_rng(1))


def test_standstills_heard_are_those_that_are_known() -> None:
    r = made("normal", 2)
    heard = with_standstills(r.sound)
    assert np.isclose(heard.period_s, r.period_s, rtol=0.03)


# disturbances


def test_there_are_enough_kinds_and_each_half_has_some_of_its_own() -> None:
    disturbing = [k for k in KINDS.values() if not k.harmless]
    assert len([k for k in disturbing if not k.final_only]) >= 20
    assert len([k for k in disturbing if k.final_only]) >= 5
    assert len([k for k in KINDS.values() if k.harmless]) >= 12


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_a_kind_is_pure_finite_repeatable_and_within_full_scale(name: str, strength: float) -> None:
    sound = made("play").sound
    before = sound.samples.copy()
    changed = KINDS[name].change(sound, np.random.default_rng(8), strength)
    again = KINDS[name].change(sound, np.random.default_rng(8), strength)
    assert np.array_equal(sound.samples, before)
    assert np.array_equal(changed.samples, again.samples)
    assert np.all(np.isfinite(changed.samples))
    assert np.max(np.abs(changed.samples)) <= 1
    assert rms(changed.samples) > 1e-4


@pytest.mark.parametrize("name", [n for n, k in KINDS.items() if k.harmless and not n.startswith("resampled")])
def test_a_harmless_edge_leaves_the_samples_of_the_machine_intact(name: str) -> None:
    sound = made("notch").sound
    changed = KINDS[name].change(sound, np.random.default_rng(8), 0.7)
    x = changed.samples if changed.samples.ndim == 1 else changed.samples[:, -1]
    # two cycles from the middle of the recording are found again, but for a gain and a constant
    middle = cut(sound, 6.0, 6.0 + 1.5 * sound.period_s).samples
    middle = middle - middle.mean()
    starts = {"trimmed_start": -round((0.05 + 0.45 * 0.7) * sound.period_s * sound.rate)}
    moved = x.size - sound.samples.size if name.startswith("lead") else starts.get(name, 0)
    begin = int(6.0 * sound.rate) + moved
    found = x[begin - 2 : begin + middle.size + 2]
    similar = max(float(np.corrcoef(middle, found[k : k + middle.size])[0, 1]) for k in range(5))
    assert similar > 0.999999


@pytest.mark.parametrize(("name", "up", "down"), [("resampled_44k", 80, 441), ("resampled_48k", 1, 6)])
def test_resampling_and_back_gives_the_machine_again(name: str, up: int, down: int) -> None:
    sound = made("notch").sound
    changed = KINDS[name].change(sound, np.random.default_rng(8), 0.5)
    back = signal.resample_poly(changed.samples, up, down)
    assert back.shape == sound.samples.shape
    was, now = band(sound.samples, sound.rate, 0, 3000, 4), band(back, sound.rate, 0, 3000, 4)
    assert np.corrcoef(was, now)[0, 1] > 0.999


@pytest.mark.parametrize("name", [n for n, k in KINDS.items() if not k.harmless])
def test_a_disturbance_changes_the_machine_or_what_is_known_of_it(name: str) -> None:
    sound = made("notch").sound
    changed = KINDS[name].change(sound, np.random.default_rng(8), 0.7)
    same = changed.samples.shape == sound.samples.shape and np.allclose(changed.samples, sound.samples, atol=1e-6)
    assert not same or changed.rate != sound.rate


def test_noise_is_as_loud_as_its_name_says() -> None:
    sound = made("normal").sound
    for name, over_db in (("noise_10db_below", -10), ("noise_as_loud", 0), ("noise_6db_above", 6)):
        changed = KINDS[name].change(sound, np.random.default_rng(8), 0.5)
        scale = float(changed.samples @ sound.samples / (sound.samples @ sound.samples))
        heard = 20 * np.log10(rms(changed.samples / scale - sound.samples) / rms(sound.samples))
        assert np.isclose(heard, over_db, atol=0.5)


def test_a_clip_is_as_long_as_its_name_says() -> None:
    sound = made("normal").sound
    for name, cycles in (("part_of_a_cycle", 0.3 + 0.6 * 0.5), ("just_over_a_cycle", 1.2)):
        changed = KINDS[name].change(sound, np.random.default_rng(8), 0.5)
        assert np.isclose(changed.samples.size / changed.rate, cycles * sound.period_s, atol=0.01)


# foreign sounds


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_makes_finite_repeatable_sounds_that_differ_by_seed(name: str) -> None:
    make = FAMILIES[name].make
    x = make(np.random.default_rng(1), 8000, 9.0)
    assert x.shape == (72000,)
    assert np.all(np.isfinite(x))
    assert np.max(envelope(x, 8000, 0.2)) > 0
    assert np.array_equal(x, make(np.random.default_rng(1), 8000, 9.0))
    assert not np.array_equal(x, make(np.random.default_rng(2), 8000, 9.0))


def test_halves_share_no_family_and_have_twenty_each() -> None:
    for half in ("work", "final"):
        assert len([f for f in FAMILIES.values() if f.half == half]) >= 20
    assert {f.half for f in FAMILIES.values()} == {"work", "final"}


def test_foreign_sounds_have_the_levels_of_recordings() -> None:
    for _, sound in foreign("work", 27, 1):
        assert 0.0005 < rms(sound.samples) < 0.2
        assert np.max(np.abs(sound.samples)) < 1


def test_a_voice_without_espeak_is_there() -> None:
    assert np.isclose(rms(formant_voice(np.random.default_rng(1), 8000, 5.0)), 1.0)


def test_a_room_keeps_the_direct_sound_in_place() -> None:
    x = np.zeros(8000)
    x[1000] = 1.0
    y = reverberated(x, 8000, np.random.default_rng(1), 0.5, 10)
    assert np.argmax(np.abs(y)) == 1000


# questions, files and scores


def test_each_kind_asks_as_many_of_each_label() -> None:
    labels = [label for label in LABELS for _ in range(20)]
    chosen = balanced(np.random.default_rng(1), labels)
    assert len(set(chosen)) == PER_KIND
    assert [sum(labels[i] == label for i in chosen) for label in LABELS] == [PER_KIND // 3] * 3


@pytest.mark.parametrize("name", ["flac_24bit", "dead_first_channel", "gain_down", "resampled_48k"])
def test_what_is_written_is_what_was_made(name: str, tmp_path: Path) -> None:
    changed = KINDS[name].change(made("normal").sound, np.random.default_rng(8), 0.5)
    read, rate = sf.read(write(changed, tmp_path / "x"))
    assert rate == changed.rate
    assert np.allclose(read, changed.samples, atol=3.2e-5)


def _asked(group: str, truth: str, verdict: str, label: str, p: float | None, clean: str = "notch") -> Asked:
    return Asked(group, "x", truth, "u", 0.0, 0.0, Answer(verdict, label, p), Answer("diagnosed", clean, 0.9))


def test_counts_tell_right_wrong_and_kept() -> None:
    rows = [
        _asked("harmless", "notch", "diagnosed", "notch", 0.9),
        _asked("harmless", "notch", "diagnosed", "play", 0.9),
        _asked("harmless", "notch", "ambiguous", "notch", 0.5),
        _asked("harmless", "notch", "refused", "", None),
    ]
    c = counts(rows)
    assert (c["n"], c["kept"], c["right"], c["wrong"], c["ambiguous"], c["unusable"]) == (4, 1, 1, 1, 1, 1)


def test_the_calibration_error_is_the_mean_distance_of_probability_and_truth() -> None:
    right = [_asked("harmless", "notch", "diagnosed", "notch", 0.85)] * 3
    wrong = [_asked("foreign", "", "diagnosed", "notch", 0.85)]
    silent = [_asked("harmless", "notch", "not_in_library", "", None)]
    result = reliability([*right, *wrong, *silent])
    assert result.count == 4
    assert np.isclose(result.error, 0.10)
    assert np.isclose(reliability([]).error, 0.0)


def test_halves_differ_in_their_gearboxes() -> None:
    work, final = (make_units(half_seed(half, "units")) for half in ("work", "final"))
    assert not {u.modes for u in work} & {u.modes for u in final}
