"""Two recordings of one gearbox: what has grown is named; gain, place, speed and what fell are not; nor a fan."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from signals.recording import Recording
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.acoustic.evidence import AcousticResult
from sim.investigation.acoustic.fusion import sound_alone
from sim.investigation.investigate import investigate
from sim.investigation.report.summary import story
from tests.sim.axes import two_gears

Array = NDArray[np.float64]
RATE, SECONDS, STROKE_S, RAMP_S = 8_000, 24, 2.0, 0.3
ORDERS = {"transfer": 14.0, "output": 2.0}
HOUSING = ((420.0, 0.03, 1.0), (1_300.0, 0.02, 0.7), (2_500.0, 0.03, 0.5))  # Hz, damping ratio, gain
LOOSE = (1_800.0, 0.01, 0.8)
AXIS = two_gears((14, 98), (14, 140))


def rung(mode: tuple[float, float, float], force: Array) -> Array:
    """What a mode of the housing answers: a resonator of two poles, of unit gain at its peak."""
    frequency, damping, gain = mode
    turn = 2.0 * math.pi * frequency / RATE
    radius = math.exp(-damping * turn)
    scale = gain * (1.0 - radius) * 2.0 * math.sin(turn)
    return np.asarray(lfilter([scale], [1.0, -2.0 * radius * math.cos(turn), radius**2], force))


def heard(
    seed: int,
    *,
    turns_per_s: float = 25.0,
    gain: float = 1.0,
    louder: dict[str, float] | None = None,
    loose: bool = False,
    fan: float = 0.0,
    place_db: float = 0.0,
    seconds: float = SECONDS,
    stroke_s: float = STROKE_S,
    rate: int = RATE,
) -> Recording:
    """A gearbox that goes back and forth and rests in between; teeth of a stage so many times louder than as new.

    `fan`: level of something beside it that sings at the loose part's pitch all the time; `place_db`: how much louder
    the microphone has one mode of the housing.
    """
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    phase = (time + random.uniform(0.0, stroke_s)) % stroke_s
    moving = stroke_s - 0.3
    rise = np.clip(np.minimum(phase, moving - phase) / RAMP_S, 0.0, 1.0)
    share = 0.5 * (1.0 - np.cos(math.pi * rise))
    angle = 2.0 * math.pi * np.cumsum(share) * turns_per_s / RATE
    force = 0.5 * share * random.standard_normal(time.size)
    for stage, order in ORDERS.items():
        for k, level in ((1, 0.15), (2, 0.08)):
            force += (louder or {}).get(stage, 1.0) * level * share * np.cos(k * order * angle + random.uniform(0, 6))
    sound = 0.2 * force + 0.02 * random.standard_normal(time.size)
    for place, mode in enumerate(HOUSING):
        sound += rung(mode, force) * 10.0 ** (place_db / 20.0 if place == 1 else 0.0)
    if loose:
        sound += rung(LOOSE, force)
    sound += fan * rung(LOOSE, random.standard_normal(time.size))
    heard = Recording(np.asarray(0.05 * gain * sound, dtype=np.float32), float(RATE))
    return heard if rate == RATE else heard.resampled(float(rate))


AS_NEW = heard(1)


def said(listening: AcousticResult) -> list[tuple[str, str | None]]:
    return [(h.mechanism, h.location) for h in listening.heard]


@pytest.mark.parametrize(
    "now",
    [
        {"gain": 0.2},
        {"place_db": 2.5},
        {"turns_per_s": 25.4},
        {"turns_per_s": 23.0, "gain": 3.0},
        {"louder": {"transfer": 0.3, "output": 0.3}},
    ],
)
def test_gain_and_place_of_a_microphone_speed_and_what_fell_are_no_growth(now: dict[str, object]) -> None:
    listening = sound_alone(AXIS, [heard(2, **now)], [AS_NEW])  # type: ignore[arg-type]
    assert said(listening) == []
    assert {"mesh_error", "structural_resonance"} <= set(listening.examined)


@pytest.mark.parametrize("stage", ["transfer", "output"])
def test_teeth_that_are_five_times_as_loud_are_named_at_their_gear(stage: str) -> None:
    now = heard(3, louder={stage: 5.0}, gain=0.5, turns_per_s=25.3)
    assert said(sound_alone(AXIS, [now], [AS_NEW])) == [("mesh_error", stage)]
    assert said(sound_alone(AXIS, [AS_NEW], [now])) == []


def test_what_comes_loose_is_named_at_its_pitch_whatever_the_speed() -> None:
    for turns_per_s in (22.0, 25.0, 27.0):
        now = heard(4, loose=True, gain=2.0, turns_per_s=turns_per_s)
        (found,) = sound_alone(AXIS, [now], [AS_NEW]).heard
        assert found.mechanism == "structural_resonance"
        value, low, high = found.parameters["frequency_hz"]
        assert low <= LOOSE[0] <= high
        assert value == pytest.approx(LOOSE[0], rel=0.02)
    assert said(sound_alone(AXIS, [AS_NEW], [now])) == []


def test_what_sings_at_rest_as_well_is_none_of_the_axis() -> None:
    assert said(sound_alone(AXIS, [heard(5, fan=1.0)], [AS_NEW])) == []


def test_one_recording_alone_leaves_both_open_and_says_what_would_tell() -> None:
    listening = sound_alone(AXIS, [heard(6, louder={"output": 5.0}, loose=True)])
    assert not {"mesh_error", "structural_resonance"} & {name for name, _ in said(listening)}
    for name in ("mesh_error", "structural_resonance"):
        assert "when the axis was new" in listening.not_examined[name]
    assert any("from when the axis was new" in remark for remark in listening.remarks)


def test_another_speed_is_not_compared_and_both_speeds_are_told() -> None:
    listening = sound_alone(AXIS, [heard(7, turns_per_s=15.0, louder={"output": 5.0})], [AS_NEW])
    assert "record the same motion" in listening.not_examined["mesh_error"]
    assert "15 times" in listening.not_examined["mesh_error"]
    assert "mesh_error" not in {name for name, _ in said(listening)}


def test_several_recordings_add_up_and_one_without_speaks_against() -> None:
    with_it = [heard(seed, louder={"transfer": 3.0}) for seed in (8, 9)]

    def sure(sounds: list[Recording]) -> float:
        return sum(h.probability for h in sound_alone(AXIS, sounds, [AS_NEW]).heard if h.mechanism == "mesh_error")

    mixed = sound_alone(AXIS, [with_it[0], heard(10)], [AS_NEW])
    assert sure([with_it[0], heard(10)]) < sure(with_it[:1]) < sure(with_it)
    assert any("contradict" in remark for remark in mixed.remarks)


@pytest.mark.parametrize(
    ("now", "before"),
    [
        ({"seconds": 9.0}, {}),
        ({}, {"seconds": 9.0}),
        ({"stroke_s": 5.0}, {"stroke_s": 1.6}),
        ({"stroke_s": 1.6}, {"stroke_s": 5.0}),
        ({"turns_per_s": 55.0}, {"turns_per_s": 55.0, "rate": 3_000}),
    ],
)
def test_length_stroke_and_sample_rate_are_no_growth(now: dict[str, float], before: dict[str, float]) -> None:
    """Noise over fewer cruises, lines of longer ones and lines beyond what one recording holds do not count."""
    listening = sound_alone(AXIS, [heard(23, **now)], [heard(24, **before)])  # type: ignore[arg-type]
    assert said(listening) == []
    assert "mesh_error" in listening.examined
    if "rate" in before:
        assert "as new the sample rate of 3000 Hz" in listening.not_examined["structural_resonance"]


def test_a_speed_that_is_only_described_is_not_compared() -> None:
    described = read_axis({**AXIS.to_mapping(), "motion": {"load_speed_rad_s": 25.0 * 2.0 * math.pi / AXIS.ratio}})
    silent = {"transfer": 0.0, "output": 0.0}
    listening = sound_alone(described, [heard(25)], [heard(26, louder=silent)])
    assert "mesh_error" not in {name for name, _ in said(listening)}
    assert "heard as a line as new" in listening.not_examined["mesh_error"]


@pytest.mark.parametrize("samples", [np.zeros(400), np.zeros(RATE), np.random.default_rng(1).normal(size=3 * RATE)])
def test_what_is_too_short_silent_or_steady_is_told_and_not_compared(samples: Array) -> None:
    poor = Recording(samples.astype(np.float32), float(RATE))
    for now, before in ((heard(19), poor), (poor, AS_NEW)):
        found = investigate(AXIS, None, now, as_new=[before])
        assert {"mesh_error", "structural_resonance"} <= set(found.not_examined)
        assert "Louder than as new" not in str(story(found)["overlay"])


def test_a_gear_without_tooth_numbers_and_an_axis_without_a_gear_are_told() -> None:
    toothless: Axis = read_axis(
        {
            "motor": {"inertia_kg_m2": 0.006},
            "stages": [{"name": "output", "ratio": 70.0}],
            "load": {"inertia_kg_m2": 40},
        }
    )
    assert "no tooth numbers" in sound_alone(toothless, [heard(16)], [AS_NEW]).not_examined["mesh_error"]
    direct = read_axis({"motor": {"inertia_kg_m2": 0.3}, "load": {"inertia_kg_m2": 1.0}})
    listening = sound_alone(direct, [heard(17, loose=True)], [AS_NEW])
    assert "no gear" in listening.not_examined["mesh_error"]
    assert ("structural_resonance", None) in said(listening)


def struck(recording: Recording, seed: int, place_s: float = 0.8) -> Recording:
    """Thuds at one place of every other stroke of a recording that was made with this seed."""
    samples = recording.samples.astype(np.float64)
    after = np.arange(int(0.08 * RATE)) / RATE
    thud = 0.2 * np.exp(-after / 0.01) * np.sin(2.0 * math.pi * 70.0 * after)
    start = 2.0 * STROKE_S + place_s - np.random.default_rng(seed).uniform(0.0, STROKE_S)
    for at in np.arange(start, SECONDS - 0.1, 2.0 * STROKE_S):
        samples[int(at * RATE) : int(at * RATE) + after.size] += thud
    return Recording(samples.astype(np.float32), float(RATE))


def test_impacts_where_all_teeth_have_grown_louder_stay_with_them() -> None:
    """Thuds at one place of every other stroke are a damaged tooth; where all teeth of a gear are louder, maybe not."""
    alone = sound_alone(AXIS, [struck(heard(18), 18)], [AS_NEW])
    assert said(alone) == [("tooth_damage", "output")]
    both = sound_alone(AXIS, [struck(heard(18, louder={"transfer": 5.0}), 18)], [AS_NEW])
    assert said(both) == [("mesh_error", "transfer")]
    assert both.heard[0].indistinguishable_from == ("tooth_damage",)
    assert any("Impacts as of tooth damage" in remark for remark in both.remarks)


@pytest.mark.parametrize(("place_s", "named"), [(0.8, []), (1.1, [("tooth_damage", "output")])])
def test_an_impact_that_was_there_as_new_is_no_fault(place_s: float, named: list[tuple[str, str]]) -> None:
    """At the same place of the travel; one at another place is new."""
    listening = sound_alone(AXIS, [struck(heard(18), 18, place_s)], [struck(heard(20), 20)])
    assert said(listening) == named
