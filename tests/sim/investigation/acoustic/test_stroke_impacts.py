"""Sound of a motion that never repeats: tooth and play are told, a gearbox in good order is silent."""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.recording import Recording
from sim.investigation.acoustic.evidence import AcousticResult
from sim.investigation.acoustic.fusion import sound_alone
from tests.sim.axes import two_gears

Array = NDArray[np.float64]
RATE = 8000
AXIS = two_gears((20, 101), (13, 100))
STROKES = (  # rad, rad/s, s at rest after it
    (2.9, 2.1, 0.3), (-4.1, 1.9, 0.5), (5.2, 2.3, 0.2), (-3.0, 1.4, 0.6), (2.6, 2.2, 0.4), (-3.9, 1.6, 0.3),
    (4.6, 2.4, 0.5), (-4.4, 2.0, 0.4),
)  # fmt: skip
RAMP_S = 0.4


def stroke(distance: float, speed: float, rest_s: float) -> Array:
    """Speed [rad/s] of one stroke with raised-cosine ramps, and the rest after it."""
    time = np.arange(0.0, abs(distance) / speed + RAMP_S, 1.0 / RATE)
    rise = np.clip(np.minimum(time, time[-1] - time) / RAMP_S, 0.0, 1.0)
    moving = math.copysign(speed, distance) * 0.5 * (1.0 - np.cos(math.pi * rise))
    return np.concatenate([moving, np.zeros(round(rest_s * RATE))])


PARTS = [stroke(*one) for one in STROKES]
LOAD_SPEED: Array = np.concatenate(PARTS)
STOPS_S = [n / RATE for n in accumulate(part.size for part in PARTS)]
TIME: Array = np.arange(LOAD_SPEED.size) / RATE
ANGLE: Array = np.cumsum(LOAD_SPEED) / RATE
TURNS: Array = np.cumsum(np.abs(LOAD_SPEED)) / RATE * AXIS.ratio / (2.0 * math.pi)


def running(seed: int) -> Array:
    """Rubbing that grows with speed, tooth whine of the transfer mesh, a quiet room."""
    random = np.random.default_rng(seed)
    share = np.abs(LOAD_SPEED) / 2.4
    whine = 0.4 * share * np.cos(40.0 * math.pi * TURNS)
    return np.asarray(
        0.05 * (share * random.standard_normal(TIME.size) + whine + 0.1 * random.standard_normal(TIME.size))
    )


def struck(sound: Array, times: Array, hertz: float, size: float, decay_s: float = 0.01) -> Array:
    """Blows that ring at a frequency and die away."""
    after = np.arange(int(8.0 * decay_s * RATE)) / RATE
    blow = size * np.exp(-after / decay_s) * np.sin(2.0 * math.pi * hertz * after)
    out = np.concatenate([sound, np.zeros(after.size)])
    for start in np.asarray(times * RATE, dtype=int):
        out[start : start + after.size] += blow
    return np.asarray(out[: sound.size])


def each_turn(order: float) -> Array:
    """Times at which a shaft of `order` turns per turn of the motor has turned once more [s]."""
    return np.asarray(TIME[np.flatnonzero(np.diff(np.floor(TURNS * order)))])


def hear(sound: Array) -> AcousticResult:
    return sound_alone(AXIS, [recording(sound)])


def recording(sound: Array) -> Recording:
    return Recording(samples=sound.astype(np.float32), sample_rate_hz=float(RATE), channel=0, channels=1)


def named(listened: AcousticResult) -> list[tuple[str, str | None]]:
    return [(h.mechanism, h.location) for h in listened.heard]


@pytest.mark.parametrize("seed", range(4))
def test_a_gearbox_in_good_order_is_silent_and_was_examined(seed: int) -> None:
    heard = hear(running(seed))
    assert named(heard) == []
    assert {"tooth_damage", "backlash", "bearing_defect"} <= set(heard.examined)
    assert not heard.courses[0].repeats


@pytest.mark.parametrize(("angle", "forward"), [(1.4, True), (0.9, False)])
def test_impacts_at_one_angle_are_a_tooth_of_the_output_gear(angle: float, forward: bool) -> None:
    crossed = np.flatnonzero((ANGLE[:-1] - angle) * (ANGLE[1:] - angle) < 0.0)
    crossed = crossed[(LOAD_SPEED[crossed] > 0.0) == forward]
    assert crossed.size >= 3
    heard = hear(struck(running(5), TIME[crossed], 70.0, 0.4))
    assert named(heard) == [("tooth_damage", "output")]
    assert heard.heard[0].elsewhere == ("transfer",)
    assert heard.heard[0].indistinguishable_from == ("mesh_error",)


def test_teeth_that_are_as_new_leave_impacts_to_a_damaged_one() -> None:
    crossed = np.flatnonzero((ANGLE[:-1] - 1.4) * (ANGLE[1:] - 1.4) < 0.0)
    now = recording(struck(running(5), TIME[crossed[LOAD_SPEED[crossed] > 0.0]], 70.0, 0.4))
    heard = sound_alone(AXIS, [now], [recording(running(6))])
    assert named(heard) == [("tooth_damage", "output")]
    assert heard.heard[0].indistinguishable_from == ()


def test_impacts_at_the_end_of_every_stroke_are_play() -> None:
    ends = np.array([stop - rest - 0.3 for stop, (_, _, rest) in zip(STOPS_S, STROKES, strict=True)])
    assert named(hear(struck(running(6), ends, 70.0, 0.15))) == [("backlash", "output")]


def test_impacts_at_both_ends_of_every_stroke_are_no_play() -> None:
    ends = np.array([stop - rest - 0.3 for stop, (_, _, rest) in zip(STOPS_S, STROKES, strict=True)])
    begins = np.array([0.0, *STOPS_S[:-1]]) + 0.3
    assert "backlash" not in {
        h.mechanism for h in hear(struck(running(6), np.sort([*ends, *begins]), 70.0, 0.15)).heard
    }


def test_weak_impacts_once_per_turn_of_a_gear_between_are_a_tooth_of_it_for_certain() -> None:
    heard = hear(struck(running(7), each_turn(20 / 101), 1100.0, 0.6, 0.002))
    assert named(heard) == [("tooth_damage", "transfer")]
    assert heard.heard[0].elsewhere == ()
