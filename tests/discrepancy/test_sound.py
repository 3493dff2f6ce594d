"""Orders of a bearing, hum and a cut recording, heard in sounds whose answer is known."""

import numpy as np
import pytest

from casebase.signals.recording import Recording
from sim.axis import read_axis
from sim.discrepancy.measurement import Measurement, prepare
from sim.discrepancy.sound import listen

RATE = 8000
AXIS = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.01},
        "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": 1e4}],
        "load": {"inertia_kg_m2": 1.0},
    }
)


def motion() -> Measurement:
    t = np.arange(20_000) / 1000.0
    angle = 200.0 * np.sin(2 * np.pi * 0.15 * t) / (2 * np.pi * 0.15)
    return prepare(1000.0, np.zeros(t.size), angle, None)


def recording(samples: np.ndarray) -> Recording:  # type: ignore[type-arg]
    return Recording(samples=samples.astype(np.float32), sample_rate_hz=float(RATE), channel=0, channels=1)


def noise(seed: int) -> np.ndarray:  # type: ignore[type-arg]
    return 0.01 * np.random.default_rng(seed).standard_normal(20 * RATE)


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_silent(seed: int) -> None:
    assert listen(AXIS, recording(noise(seed)), motion(), 0.0) == ()


def test_impacts_of_a_bearing_are_named_by_their_order() -> None:
    m, order = motion(), 4.37
    t = np.arange(20 * RATE) / RATE
    path = np.abs(np.interp(t, m.time_s, m.speed)).cumsum() / RATE / (2 * np.pi)
    hits = np.flatnonzero(np.diff(np.floor(order * path)) > 0)
    ring = np.exp(-np.arange(80) / 12.0) * np.sin(2 * np.pi * 2300.0 * np.arange(80) / RATE)
    sound = noise(3)
    for hit in hits[hits < t.size - 80]:
        sound[hit : hit + 80] += 0.05 * ring
    heard = listen(AXIS, recording(sound), m, 0.0)
    assert [h.mechanism for h in heard] == ["bearing_defect"]
    assert heard[0].parameters["order"][0] == pytest.approx(order, rel=0.005)


def test_impacts_at_the_order_of_the_teeth_are_no_bearing() -> None:
    m = motion()
    t = np.arange(20 * RATE) / RATE
    path = np.abs(np.interp(t, m.time_s, m.speed)).cumsum() / RATE / (2 * np.pi)
    sound = noise(4) * (1.0 + 0.8 * np.cos(2 * np.pi * 12.0 * path))
    assert "bearing_defect" not in [h.mechanism for h in listen(AXIS, recording(sound), m, 0.0)]


def test_hum_is_named_by_its_frequency() -> None:
    t = np.arange(20 * RATE) / RATE
    sound = noise(5) + 0.02 * np.sin(2 * np.pi * 50.0 * t) + 0.01 * np.sin(2 * np.pi * 100.0 * t)
    heard = listen(AXIS, recording(sound), None, 0.0)
    assert [h.mechanism for h in heard] == ["electrical_hum"]
    assert heard[0].parameters["frequency_hz"][0] == pytest.approx(50.0, abs=0.02)


def test_a_recording_cut_at_its_extremes_is_named_clipping() -> None:
    heard = listen(AXIS, recording(np.clip(noise(6), -0.012, 0.012)), None, 0.0)
    assert [h.mechanism for h in heard] == ["clipping"]
