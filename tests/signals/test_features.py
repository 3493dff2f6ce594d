"""What every feature of the catalogue must keep: names, units, gain, sign, length, rate."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signals.condition import OperatingCondition
from signals.errors import BrokenAudioError
from signals.features import EXTRACTOR_VERSION, FEATURES, catalogue, extract
from signals.recording import Recording
from tests.signals.synthetic import RATE_HZ, Joint, sound

AXIS = OperatingCondition(
    speed_rad_s=2.5, shaft_orders=(100.0, 12.5, 1.0), mesh_orders=(1200.0, 150.0), payload_kg_m2=30.0
)
COMPARED = np.array([definition.compared for definition in catalogue().values()])
NOTCH = sound(Joint(label="notch", seed=4))


def vector(samples: np.ndarray, rate_hz: float = RATE_HZ, condition: OperatingCondition = AXIS) -> np.ndarray:
    return extract(Recording(samples.astype(np.float32), rate_hz), condition).features.values


def test_names_are_unique_and_in_the_order_of_the_vector() -> None:
    names = [definition.name for family in FEATURES for definition in family.definitions]
    assert len(set(names)) == len(names)
    features = extract(Recording(NOTCH, RATE_HZ), AXIS).features
    assert list(features.names) == names == list(catalogue())
    assert features.values.shape == (len(names),)
    assert features.values.dtype == np.float32
    assert features["crest_factor_whole_record"] == pytest.approx(features["peak"] / features["rms"], rel=1e-5)


def test_all_features_are_known_for_a_whole_recording_of_a_known_axis() -> None:
    values = vector(NOTCH)
    missing = [name for name, value in zip(catalogue(), values, strict=True) if not math.isfinite(value)]
    assert missing == []


def test_unknown_axis_leaves_out_the_mesh_alone() -> None:
    values = vector(NOTCH, condition=OperatingCondition())
    missing = {name for name, value in zip(catalogue(), values, strict=True) if not math.isfinite(value)}
    assert missing == {name for name in catalogue() if name.startswith("mesh_")}


@settings(deadline=None, max_examples=8)
@given(exponent=st.floats(-4, 3), sign=st.sampled_from([-1.0, 1.0]))
def test_what_is_compared_follows_neither_gain_nor_sign(exponent: float, sign: float) -> None:
    changed = vector(NOTCH * sign * 10**exponent)
    np.testing.assert_allclose(changed[COMPARED], vector(NOTCH)[COMPARED], atol=0.01, rtol=1e-3)


@pytest.mark.parametrize("rate_hz", [16000.0, 44100.0, 48000.0, 96000.0, 12345.0])
def test_features_are_the_same_at_another_sample_rate(rate_hz: float) -> None:
    """Up to what resampling there and back takes away near half the lower rate."""
    there = Recording(NOTCH, RATE_HZ).resampled(rate_hz)
    difference = np.abs(vector(there.samples, rate_hz) - vector(NOTCH))[COMPARED]
    assert difference.max() < 0.7
    bumps = [name for name in catalogue() if "bump" in name and "12_200" in name]
    place = [list(catalogue()).index(name) for name in bumps]
    np.testing.assert_allclose(vector(there.samples, rate_hz)[place], vector(NOTCH)[place], atol=0.15)


def test_an_offset_changes_nothing_but_the_flag() -> None:
    shifted = extract(Recording(NOTCH + np.float32(0.3), RATE_HZ), AXIS)
    np.testing.assert_allclose(shifted.features.values, vector(NOTCH), atol=0.05, rtol=1e-2)
    assert [flag.name for flag in shifted.quality] == ["dc_offset"]


@settings(deadline=None, max_examples=16)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(400, 30000),
    rate_hz=st.sampled_from([5120.0, 8000.0, 12800.0, 48000.0]),
    kind=st.sampled_from(["noise", "tone", "steps", "one impulse", "mostly zero", "huge", "tiny"]),
)
def test_anything_that_is_a_recording_has_features_or_a_reason(
    seed: int, count: int, rate_hz: float, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    samples = {
        "noise": rng.normal(size=count),
        "tone": np.sin(np.arange(count) * rng.uniform(0.001, 3)),
        "steps": np.repeat(rng.normal(size=count // 50 + 1), 50)[:count],
        "one impulse": np.eye(1, count, count // 3)[0],
        "mostly zero": np.where(np.arange(count) < 50, 1.0, 0.0) * rng.normal(size=count),
        "huge": 1e11 * rng.normal(size=count),
        "tiny": 1e-30 * rng.normal(size=count),
    }[kind]
    if count / rate_hz < 0.05:
        with pytest.raises(BrokenAudioError, match="at least 50 ms"):
            extract(Recording(samples.astype(np.float32), rate_hz))
        return
    extraction = extract(Recording(samples.astype(np.float32), rate_hz))
    assert not np.isinf(extraction.features.values).any()
    assert extraction.usable == (extraction.unusable_reason is None)
    assert all(a.time_s <= b.time_s for a, b in itertools.pairwise(extraction.events))
    assert extraction.extractor_version == EXTRACTOR_VERSION
    assert all(value is None or math.isfinite(value) for value in extraction.features.to_dict().values())


def test_a_mesh_line_is_found_at_its_order_and_a_sideband_beside_it() -> None:
    """Output at 2.5 rad/s: mesh 2 at 59.7 Hz; modulated by the output shaft at 0.398 Hz."""
    time = np.arange(160000) / RATE_HZ
    rng = np.random.default_rng(0)
    mesh_hz, shaft_hz = 150 * 2.5 / (2 * np.pi), 2.5 / (2 * np.pi)
    noise = rng.normal(0, 0.1, time.size)
    tone = np.cos(2 * np.pi * mesh_hz * time) * (1 + 0.8 * np.cos(2 * np.pi * shaft_hz * time))
    names = list(catalogue())
    with_tone, without = vector(noise + 0.05 * tone), vector(noise)
    assert with_tone[names.index("mesh_2_line")] > without[names.index("mesh_2_line")] + 10
    assert with_tone[names.index("mesh_2_sidebands")] > without[names.index("mesh_2_sidebands")] + 5
    assert abs(with_tone[names.index("mesh_1_line")] - without[names.index("mesh_1_line")]) < 1


def test_a_modulation_stands_in_its_octave() -> None:
    time = np.arange(160000) / RATE_HZ
    noise = np.random.default_rng(1).normal(size=time.size)
    names = list(catalogue())
    for rate_hz in (3.0, 11.0, 45.0, 180.0):
        change = vector(noise * (1 + 0.7 * np.cos(2 * np.pi * rate_hz * time))) - vector(noise)
        octave = 2 ** int(np.log2(rate_hz))
        place = names.index(f"modulation_{octave}_{2 * octave}_hz")
        modulations = [names.index(name) for name in names if name.startswith("modulation_") and "line" not in name]
        assert change[place] == max(change[modulations])
        assert change[place] > 3


def test_band_levels_of_white_noise_rise_three_decibels_per_octave() -> None:
    values = vector(np.random.default_rng(2).normal(size=160000))
    levels = [values[k] for k, name in enumerate(catalogue()) if name.startswith("band_level")][:-1]
    slope = np.polyfit(np.arange(len(levels)) / 2, levels, 1)[0]
    assert slope == pytest.approx(10 * np.log10(2), abs=0.1)


def test_a_brake_that_clicks_at_each_stop_strikes_no_tooth() -> None:
    """Peakedness is taken while the axis moves; only the whole record and the standstill show the click."""
    joint = Joint(seed=5)
    clicked = sound(joint).astype(np.float64)
    time = np.arange(round(0.03 * RATE_HZ)) / RATE_HZ
    click = 6 * clicked.std() * np.exp(-time / 0.005) * np.sin(2 * np.pi * 120 * time)
    for at_s in joint.reversals_s[1:-2]:
        clicked[round(at_s * RATE_HZ) :][: click.size] += click[: clicked.size - round(at_s * RATE_HZ)]
    before, after = (dict(zip(catalogue(), vector(each).tolist(), strict=True)) for each in (sound(joint), clicked))
    assert (
        after["crest_factor_low_pass_200_hz_whole_record"] > 1.5 * before["crest_factor_low_pass_200_hz_whole_record"]
    )
    for name in (
        "crest_factor_low_pass_200_hz_mean_of_1_s_windows",
        "crest_factor_low_pass_200_hz_median_of_cycles",
        "kurtosis_low_pass_200_hz",
    ):
        assert after[name] == pytest.approx(before[name], rel=0.1)
    for name in ("spectral_kurtosis_12_200_hz", "strongest_impulse_12_200_hz", "envelope_line_1000_3600_hz"):
        assert after[name] == pytest.approx(before[name], abs=1.0)
