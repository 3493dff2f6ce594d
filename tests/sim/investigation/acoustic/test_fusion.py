"""Sound without telemetry: what is put into a recording by place and time is named, the same without order is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.recording import Recording
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.acoustic.evidence import AcousticFinding, AcousticResult, probability
from sim.investigation.acoustic.fusion import not_named_yet, sound_alone, sound_with_telemetry
from sim.investigation.acoustic.recording_quality import mismatch
from sim.investigation.data.preprocessing import Measurement, prepare
from sim.investigation.investigate import investigate
from tests.sim.axes import two_gears

Array = NDArray[np.float64]
RATE, SECONDS, PERIOD_S, SPEED_RAD_S, RAMP_S = 8000, 16, 4.0, 2.5, 0.4
AXIS = two_gears((12, 96), (12, 150))


def course() -> tuple[Array, Array, Array]:
    """Time [s], speed [rad/s] and angle from the middle of the travel [rad] of a load that goes back and forth."""
    time = np.arange(SECONDS * RATE) / RATE
    # rest at the ends, raised-cosine ramps, steady between
    phase = (time + 0.7) % (PERIOD_S / 2.0)
    moving = PERIOD_S / 2.0 - 0.2
    rise = np.clip(np.minimum(phase, moving - phase) / RAMP_S, 0.0, 1.0)
    speed = SPEED_RAD_S * 0.5 * (1.0 - np.cos(math.pi * rise))
    speed *= np.where(((time + 0.7) % PERIOD_S) < PERIOD_S / 2.0, 1.0, -1.0)
    angle = np.cumsum(speed) / RATE
    return time, speed, angle - 0.5 * (angle.max() + angle.min())


TIME, LOAD_SPEED, ANGLE = course()
MOTOR_TURNS = np.cumsum(np.abs(LOAD_SPEED)) / RATE * AXIS.ratio / (2.0 * math.pi)


def running(seed: int) -> Array:
    """A gearbox in good order: rubbing that grows with speed, tooth whine of the transfer mesh, a quiet room."""
    random = np.random.default_rng(seed)
    share = np.abs(LOAD_SPEED) / SPEED_RAD_S
    whine = 0.4 * share * np.cos(2.0 * math.pi * 12.0 * MOTOR_TURNS)
    return np.asarray(
        0.05 * (share * random.standard_normal(TIME.size) + whine + 0.1 * random.standard_normal(TIME.size))
    )


def with_impacts(sound: Array, at: Array, size: float = 0.15) -> Array:
    """Short thuds of 70 Hz that die away within some 20 ms."""
    after = np.arange(int(0.08 * RATE)) / RATE
    thud = size * np.exp(-after / 0.01) * np.sin(2.0 * math.pi * 70.0 * after)
    out = sound.copy()
    for start in np.asarray(at * RATE, dtype=int):
        if start + after.size < out.size:
            out[start : start + after.size] += thud
    return out


def passes(angle: float, forward: bool) -> Array:
    """Times at which the load passes an angle one way [s]."""
    crossed = np.flatnonzero((ANGLE[:-1] - angle) * (ANGLE[1:] - angle) < 0.0)
    return np.asarray(TIME[crossed[(LOAD_SPEED[crossed] > 0.0) == forward]])


def found(axis: Axis, sound: Recording, m: Measurement | None, offset_s: float) -> tuple[AcousticFinding, ...]:
    return sound_with_telemetry(axis, sound, m, offset_s)[0]


def hear(*sounds: Array) -> AcousticResult:
    return sound_alone(AXIS, [recording(sound) for sound in sounds])


def recording(sound: Array) -> Recording:
    return Recording(samples=sound.astype(np.float32), sample_rate_hz=float(RATE), channel=0, channels=1)


def names(listened: AcousticResult) -> list[str]:
    return [h.mechanism for h in listened.heard]


@pytest.mark.parametrize(("angle", "forward"), [(0.4, True), (-0.7, True), (0.4, False)])
def test_impacts_at_one_angle_one_way_are_a_damaged_tooth_of_the_output_gear(angle: float, forward: bool) -> None:
    heard = hear(with_impacts(running(5), passes(angle, forward))).heard
    assert [(h.mechanism, h.location) for h in heard] == [("tooth_damage", "output")]
    value, low, high = heard[0].parameters["angle_from_middle_rad"]
    assert value == pytest.approx(angle if forward else -angle, abs=math.radians(2.0))
    assert low < (angle if forward else -angle) < high


def line(frequency_hz: float) -> Array:
    """A line as loud as the gearbox."""
    return 0.07 * np.sin(2.0 * math.pi * frequency_hz * TIME)


def swelling(seed: int) -> Array:
    """Noise for two seconds, ten times as loud as the gearbox."""
    inside = (TIME > 6.0) & (TIME < 8.0)
    return np.asarray(0.5 * inside * np.random.default_rng(seed).standard_normal(TIME.size))


@pytest.mark.parametrize(
    ("added", "kind"), [(line(1777.0), "frequency"), (line(2500.0), "frequency"), (swelling(3), "time")]
)
def test_what_is_of_no_order_and_no_hum_is_left_without_a_name(added: Array, kind: str) -> None:
    """A line by itself hides the standstills, and then the motion is heard beside it."""
    alone = investigate(AXIS, None, recording(running(5) + added))
    beside_telemetry = sound_with_telemetry(AXIS, recording(running(5) + added), measured(0.0), 0.0)[1]
    assert alone.verdict == "unnamed"
    for left in (alone.unexplained, beside_telemetry):
        assert left is not None
        assert (left.kind, left.channel) == (kind, "sound")
    if kind == "time":
        assert alone.unexplained
        assert 6.0 <= alone.unexplained.numbers["time_s"] <= 8.0


def test_a_finding_is_less_sure_beside_a_line_without_a_name() -> None:
    impacts = with_impacts(running(5), passes(0.4, True))
    (sure,), (doubted,) = (
        investigate(AXIS, None, recording(one)).findings for one in (impacts, impacts + line(1777.0))
    )
    assert sure.probability > 0.9 > doubted.probability


def test_a_sound_that_stops_for_a_while_has_lost_samples() -> None:
    sound = running(10)
    for start in (20_000, 60_000, 100_000):
        sound[start : start + 200] = 0.0
    assert names(hear(sound)) == ["lost_samples"]


def test_several_recordings_of_one_axis_agree_or_do_not() -> None:
    ill = [with_impacts(running(seed), passes(0.4, True)) for seed in (11, 12)]
    good = [running(seed) for seed in (13, 14, 15)]
    assert names(hear(*ill)) == ["tooth_damage"]
    assert names(hear(*good)) == []
    assert probability([1e-3, 1e-3]) > probability([1e-3]) > probability([1e-3, 1.0])
    assert probability([0.05] * 2 + [1.0] * 6) < 0.1


def test_with_telemetry_a_tooth_is_at_the_place_of_the_travel_where_the_sound_alone_has_it() -> None:
    heard = found(AXIS, recording(with_impacts(running(16), passes(0.4, False))), measured(1.3), 0.0)
    assert [h.mechanism for h in heard] == ["tooth_damage"]
    assert heard[0].parameters["angle_from_middle_rad"][0] == pytest.approx(-0.4, abs=math.radians(2.0))


def measured(offset_rad: float) -> Measurement:
    angle = (ANGLE[::8] + offset_rad) * AXIS.ratio
    return prepare(RATE / 8, np.zeros(angle.size), angle, ANGLE[::8] + offset_rad)


def test_beside_telemetry_no_name_is_said_twice_and_none_against_an_encoder() -> None:
    tooth = AcousticFinding("tooth_damage", None, 0.95, {}, "")
    bearing = AcousticFinding("bearing_defect", None, 0.95, {"order": (4.37, 4.35, 4.39)}, "")
    assert not_named_yet(["tooth_damage"], [tooth, bearing], load_encoder=False) == (bearing,)
    assert not_named_yet([], [tooth, bearing], load_encoder=True) == (bearing,)
    assert not_named_yet([], [tooth], load_encoder=False) == (tooth,)
    assert not_named_yet(["backlash"], [tooth], load_encoder=False) == ()


def test_the_document_says_what_is_out_of_reach_and_is_the_same_each_time() -> None:
    sounds = [recording(running(17))]
    first, second = (investigate(AXIS, None, sounds).document() for _ in range(2))
    assert first == second
    assert first["verdict"] == "nothing_missing"
    assert "friction" in str(first["remarks"])
    assert first["examined"] == ALL
    assert "coulomb_friction" in str(first["not_examined"])


ALL = ["electrical_hum", "clipping", "lost_samples", "tooth_damage", "backlash", "bearing_defect"]


RATIOS = replace(AXIS, stages=tuple(replace(s, driver_teeth=None, driven_teeth=None) for s in AXIS.stages))
GOOD = recording(running(23))
STEADY = recording(0.05 * np.random.default_rng(21).standard_normal(TIME.size))


@pytest.mark.parametrize(
    ("axis", "sound", "missing", "why"),
    [
        (AXIS, STEADY, ALL[3:], "no standstill"),
        (AXIS, recording(running(22)[:RATE]), ALL, ""),
        (RATIOS, GOOD, ALL[5:], "tooth numbers"),
        (replace(AXIS, stages=()), GOOD, ALL[3:4], "no gear"),
        (AXIS, GOOD.resampled(600.0), ALL[5:], "600 Hz is too low"),
    ],
    ids=["steady", "one second", "no tooth numbers", "no gear", "slow recorder"],
)
def test_what_was_not_examined_is_said_with_its_reason(
    axis: Axis, sound: Recording, missing: list[str], why: str
) -> None:
    result = investigate(axis, None, sound)
    assert set(missing) <= set(ALL) - set(result.examined)
    assert all(why in result.not_examined[name] for name in missing)


def with_motion(**numbers: float) -> Axis:
    return read_axis({**AXIS.to_mapping(), "motion": numbers})


@pytest.mark.parametrize("period_s", [10.0 * PERIOD_S, 2.1])
def test_a_wrong_described_period_silences_nothing(period_s: float) -> None:
    sound = recording(with_impacts(running(5), passes(0.4, True)))
    result = investigate(with_motion(period_s=period_s), None, sound)
    assert result.findings == investigate(AXIS, None, sound).findings


def test_where_the_sound_does_not_tell_the_stage_text_and_document_say_so() -> None:
    starts = np.flatnonzero(np.diff((np.abs(LOAD_SPEED) >= 0.999 * SPEED_RAD_S).astype(int)) < 0)
    (found,) = investigate(AXIS, None, recording(with_impacts(running(7), TIME[starts]))).findings
    assert (found.location, found.elsewhere) == ("output", ("transfer",))
    assert "output and transfer sound the same" in found.explanation


def test_which_recordings_show_a_fault_is_said_and_that_the_others_do_not() -> None:
    ill, good = recording(with_impacts(running(11), passes(0.4, True))), recording(running(13))
    result = investigate(AXIS, None, [replace(ill, name="ill.wav"), replace(good, name="good.wav")])
    assert result.findings[0].explanation.endswith("Heard in 1 of 2 recordings: ill.wav. Not heard in good.wav.")
    assert "would be named by ill.wav alone, but is not heard in good.wav" in " ".join(result.remarks)
    (unnamed,) = investigate(AXIS, None, [good, ill]).findings
    assert "Heard in 1 of 2 recordings: the second. Not heard in the first." in unnamed.explanation


def test_what_many_recordings_outvote_is_still_said() -> None:
    ill = recording(with_impacts(running(11), passes(0.4, True)))
    result = investigate(AXIS, None, [ill, *(recording(running(seed)) for seed in range(30, 38))])
    assert result.findings == ()
    assert "tooth damage would be named by the first alone" in " ".join(result.remarks)


def test_a_recording_in_which_a_fault_cannot_be_heard_does_not_speak_against_it() -> None:
    ill = recording(with_impacts(running(11), passes(0.4, True)))
    short = recording(running(12)[: 2 * RATE])
    (alone,), (both,) = (investigate(AXIS, None, sounds).findings for sounds in ([ill], [ill, short]))
    assert both.probability == alone.probability
    assert "Could not be looked for in the second." in both.explanation


def test_a_sound_of_another_motion_is_asked_whether_it_belongs_to_the_telemetry() -> None:
    sound = recording(running(16))
    assert mismatch(sound, measured(0.0), 0.0) == ()
    assert "is the offset of the sound right" in str(mismatch(sound, measured(0.0), 0.7))
    slower = replace(sound, sample_rate_hz=1.4 * RATE)
    assert "are they of one motion" in str(mismatch(slower, measured(0.0), 0.0))
    assert mismatch(recording(np.random.default_rng(3).standard_normal(TIME.size)), measured(0.0), 0.0) == ()
