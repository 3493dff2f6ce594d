"""The bank's truths hold: what it says of its sounds is so. Nothing here asks the product."""

from functools import cache

import numpy as np
import pytest

from benchmarks.field_bank.bank import half_seed
from benchmarks.field_bank.disturbances import KINDS, cut
from benchmarks.field_bank.foreign import FAMILIES
from benchmarks.field_bank.gearboxes import (
    Recording,
    make_units,
    record,
)
from benchmarks.field_bank.sounds import rms


@cache
def made(label: str, seed: int = 3, unit: int = 0) -> Recording:
    return record(make_units(np.random.default_rng(11))[unit], label, np.random.default_rng(seed))


# machines


@pytest.mark.parametrize("seed", range(2))
def test_a_notch_strikes_once_per_cycle_at_one_angle_in_one_direction(seed: int) -> None:
    r = made("notch", seed)
    assert np.allclose(np.diff(r.events_s), r.period_s, atol=2e-3)


@pytest.mark.parametrize("seed", range(2))
def test_play_strikes_in_both_directions_and_near_the_ends_of_strokes_only(seed: int) -> None:
    r = made("play", seed)
    assert len(r.events_s) >= 3 * (20 / r.period_s - 1)
    ends = np.array(r.sound.standstills).ravel()
    # braking begins a ramp before the standstill, and no ramp is longer than 0.6 s
    assert max(float(np.min(np.abs(ends - t))) for t in r.events_s if ends[0] < t < ends[-1]) < 0.62


def test_the_same_seed_makes_the_same_recording_and_another_does_not() -> None:
    units = make_units(np.random.default_rng(11))
    again = record(units[0], "notch", np.random.default_rng(3)).sound.samples
    assert np.array_equal(again, made("notch").sound.samples)
    assert not np.array_equal(again, made("notch", 4).sound.samples)


# disturbances


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_is_pure_finite_repeatable_and_within_full_scale(name: str) -> None:
    sound = made("play").sound
    before = sound.samples.copy()
    changed = KINDS[name].change(sound, np.random.default_rng(8), 1.0)
    again = KINDS[name].change(sound, np.random.default_rng(8), 1.0)
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


# foreign sounds


def test_halves_share_no_family_and_have_twenty_each() -> None:
    for half in ("work", "final"):
        assert len([f for f in FAMILIES.values() if f.half == half]) >= 20
    assert {f.half for f in FAMILIES.values()} == {"work", "final"}


# questions, files and scores


def test_halves_differ_in_their_gearboxes() -> None:
    work, final = (make_units(half_seed(half, "units")) for half in ("work", "final"))
    assert not {u.modes for u in work} & {u.modes for u in final}
