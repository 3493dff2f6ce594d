"""Orders of a bearing, hum and a cut recording, heard in sounds whose answer is known."""

import numpy as np
import pytest

from signals.recording import Recording
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.acoustic.evidence import AcousticFinding
from sim.investigation.acoustic.fusion import sound_with_telemetry
from sim.investigation.data.preprocessing import Measurement, prepare

RATE = 8000
AXIS = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.01},
        "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": 1e4}],
        "load": {"inertia_kg_m2": 1.0},
    }
)


def found(axis: Axis, sound: Recording, m: Measurement | None, offset_s: float) -> tuple[AcousticFinding, ...]:
    return sound_with_telemetry(axis, sound, m, offset_s)[0]


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
    assert found(AXIS, recording(noise(seed)), motion(), 0.0) == ()


def cruise() -> Measurement:
    """To and fro at 5 turns per second, all but the turns at one speed."""
    t = np.arange(20_000) / 1000.0
    speed = 10.0 * np.pi * np.tanh(20.0 * np.sin(2 * np.pi * 0.15 * t))
    return prepare(1000.0, np.zeros(t.size), np.cumsum(speed) / 1000.0, None)


def impacts(phase: np.ndarray, size: float) -> np.ndarray:  # type: ignore[type-arg]
    """A short ring at every whole number that `phase` (n,) passes."""
    ring = np.exp(-np.arange(80) / 12.0) * np.sin(2 * np.pi * 2300.0 * np.arange(80) / RATE)
    hits = np.zeros(phase.size)
    hits[1:] = np.diff(np.floor(phase)) > 0
    return size * np.convolve(hits, ring)[: phase.size]


def turns(m: Measurement) -> np.ndarray:  # type: ignore[type-arg]
    t = np.arange(20 * RATE) / RATE
    return np.abs(np.interp(t, m.time_s, m.speed)).cumsum() / RATE / (2 * np.pi)


@pytest.mark.parametrize(("seed", "size"), [(3, 0.05), (9, 0.014)], ids=["strong", "weak"])
def test_impacts_of_a_bearing_are_named_by_their_order(seed: int, size: float) -> None:
    m, order = motion(), 4.37
    heard = found(AXIS, recording(noise(seed) + impacts(order * turns(m), size)), m, 0.0)
    assert [h.mechanism for h in heard] == ["bearing_defect"]
    assert heard[0].parameters["order"][0] == pytest.approx(order, rel=0.005)


def slipping(m: Measurement, order: float, seed: int) -> np.ndarray:  # type: ignore[type-arg]
    """Impacts passed so far: the way to the next one varies by a hundredth of itself."""
    passed = order * turns(m)
    ways = np.cumsum(1.0 + 0.01 * np.random.default_rng(seed).standard_normal(int(passed[-1])))
    return np.interp(passed, ways, np.arange(1.0, ways.size + 1.0))


@pytest.mark.parametrize(("order", "size"), [(3.37, 0.012), (5.61, 0.02), (8.43, 0.02), (15.3, 0.02)])
def test_impacts_that_slip_are_found_by_all_of_their_blurred_lines(order: float, size: float) -> None:
    """Where their sum over the path has drifted by turns of the phase, hardly one line is a line any more."""
    m = motion()
    heard = found(AXIS, recording(noise(9) + impacts(slipping(m, order, 1), size)), m, 0.0)
    assert [h.mechanism for h in heard] == ["bearing_defect"]
    low, high = heard[0].parameters["order"][1:]
    assert low <= order <= high


def test_impacts_that_keep_their_rhythm_while_the_axis_turns_are_no_bearing() -> None:
    """At one speed every frequency is an order, and what goes on through the turns shows which it is."""
    m = cruise()
    clock = 21.85 * np.arange(20 * RATE) / RATE
    assert found(AXIS, recording(noise(7) + impacts(clock, 0.05)), m, 0.0) == ()
    heard = found(AXIS, recording(noise(7) + impacts(4.37 * turns(m), 0.05)), m, 0.0)
    assert [h.mechanism for h in heard] == ["bearing_defect"]


def test_impacts_at_the_order_of_the_teeth_are_no_bearing() -> None:
    m = motion()
    t = np.arange(20 * RATE) / RATE
    path = np.abs(np.interp(t, m.time_s, m.speed)).cumsum() / RATE / (2 * np.pi)
    sound = noise(4) * (1.0 + 0.8 * np.cos(2 * np.pi * 12.0 * path))
    assert "bearing_defect" not in [h.mechanism for h in found(AXIS, recording(sound), m, 0.0)]


def test_a_line_of_the_teeth_counts_for_no_family() -> None:
    """Three times the order of the teeth is five times 7.2."""
    m = motion()
    path = 2 * np.pi * turns(m)
    two = 0.07 * np.cos(7.2 * path) + 0.07 * np.cos(14.4 * path)
    sound = noise(4) * (1.0 + 0.8 * np.cos(36.0 * path) + two)
    assert "bearing_defect" not in [h.mechanism for h in found(AXIS, recording(sound), m, 0.0)]


def test_a_tooth_that_hits_once_per_turn_of_its_gear_is_no_bearing() -> None:
    """Its lines are all multiples of one turn of the gear, here an eighth of the motor's."""
    m = motion()
    heard = found(AXIS, recording(noise(4) + impacts(turns(m) / 8.0, 0.3)), m, 0.0)
    assert "bearing_defect" not in [h.mechanism for h in heard]


@pytest.mark.parametrize("fixed_hz", [8.3, 9.1])
def test_multiples_of_what_is_fixed_in_frequency_are_no_bearing(fixed_hz: float) -> None:
    """At one speed its multiples are a family of orders, and its first ones are louder than all of them."""
    t = np.arange(20 * RATE) / RATE
    heights = (0.6, 0.6, 0.5, 0.5, 0.5, 0.4, 0.4, 0.4, 0.4)
    wave = sum(h * np.cos(2 * np.pi * k * fixed_hz * t) for k, h in enumerate(heights, start=1))
    heard = found(AXIS, recording(noise(4) * np.maximum(1.0 + 0.3 * wave, 0.0)), cruise(), 0.0)
    assert "bearing_defect" not in [h.mechanism for h in heard]


def test_lines_at_whole_orders_are_no_multiples_of_a_bearing() -> None:
    """Teeth of a pinion whose number nobody gave: 13 and 26 are loud, and a little is heard at half of 13."""
    m = cruise()
    angle = np.interp(np.arange(20 * RATE) / RATE, m.time_s, m.angle)
    wave = sum(h * np.cos(order * angle) for order, h in ((13.0, 0.6), (26.0, 0.5), (6.5, 0.3), (32.5, 0.3)))
    heard = found(AXIS, recording(noise(4) * np.maximum(1.0 + 0.3 * wave, 0.0)), m, 0.0)
    assert "bearing_defect" not in [h.mechanism for h in heard]


def test_hum_is_named_by_its_frequency() -> None:
    t = np.arange(20 * RATE) / RATE
    sound = noise(5) + 0.02 * np.sin(2 * np.pi * 50.0 * t) + 0.01 * np.sin(2 * np.pi * 100.0 * t)
    heard = found(AXIS, recording(sound), None, 0.0)
    assert [h.mechanism for h in heard] == ["electrical_hum"]
    assert heard[0].parameters["frequency_hz"][0] == pytest.approx(50.0, abs=0.02)


def test_a_turn_that_repeats_is_not_cut() -> None:
    turn = noise(8)[: RATE // 4]
    heard = found(AXIS, recording(np.tile(turn, 80)), None, 0.0)
    assert "clipping" not in [h.mechanism for h in heard]


def test_a_recording_cut_at_its_extremes_is_named_clipping() -> None:
    heard = found(AXIS, recording(np.clip(noise(6), -0.012, 0.012)), None, 0.0)
    assert [h.mechanism for h in heard] == ["clipping"]
