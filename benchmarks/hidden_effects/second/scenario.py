"""One scenario of the plan: drawn by seed, simulated, measured, written as a technician would hand it over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from benchmarks.hidden_effects.second.axes import believed, describe, mistaken
from benchmarks.hidden_effects.second.effects import EFFECTS, LEVELS, Draw, Effect
from benchmarks.hidden_effects.second.kernel import Axis
from benchmarks.hidden_effects.second.plan import PLAN, Entry
from benchmarks.hidden_effects.second.scene import (
    LOAD_ENCODER_RMS,
    Recording,
    Run,
    Scene,
    draw_scene,
    hear_bearing,
    hear_meshes,
    measure,
    simulate,
)
from benchmarks.hidden_effects.second.sound import SOUND_RATE_HZ

PLACELESS = frozenset({"time_delay", "lost_samples"})
"""Effects whose channel or kind is no place in the gearbox."""
MOTOR_ENCODER_NOISE = 1.6e-5
"""Rms of what the motor encoder adds, steps included [rad]."""
COLUMNS = {
    "time": ("time_s", "%.4f"),
    "reference": ("reference_position_rad", "%.6f"),
    "motor_torque": ("motor_torque_nm", "%.4f"),
    "motor_position": ("motor_position_rad", "%.6f"),
    "load_position": ("load_position_rad", "%.8f"),
}


@dataclass(frozen=True)
class Scenario:
    """A recording with its answer: what was measured, `sound` (m,) at 8 kHz, and what the axis is believed to be.

    `answer` is JSON data: what is hidden (`answer`: pairs of mechanism and location), its sizes, how strong it is.
    """

    scene: Scene
    recording: Recording = field(repr=False)
    sound: NDArray[np.float64] = field(repr=False)
    believed: Axis
    answer: Mapping[str, object]


@dataclass(frozen=True)
class _Side:
    """A scene with or without its effects, free of noise."""

    recording: Recording
    sound: NDArray[np.float64]


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _draw_effects(rng: np.random.Generator, scene: Scene, entry: Entry) -> dict[str, Effect]:
    return {
        name: EFFECTS[name](Draw(rng, scene, LEVELS[entry.level], location or ""))
        for name, location in entry.hidden.items()
    }


def _joined(parts: Mapping[str, Mapping[str, object]]) -> dict[str, object]:
    """Return the values of all effects; what two effects call by the same name has the second's name before it."""
    joined: dict[str, object] = {}
    for effect, values in parts.items():
        joined |= {f"{effect}.{name}" if name in joined else name: value for name, value in values.items()}
    return joined


def _simulate_with(scene: Scene, effects: Sequence[Effect]) -> Run:
    axis, error = scene.axis, None
    for effect in effects:
        axis, error = effect.act(axis), effect.encoder_error or error
    return simulate(scene, axis, error)


def _both_sides(scene: Scene, effects: Sequence[Effect]) -> tuple[_Side, _Side]:
    """Return the scene without and with effects; the microphone is set for the first."""
    lacking = scene.axis
    for effect in effects:
        lacking = effect.without(lacking)
    before, after = simulate(scene, lacking), _simulate_with(scene, effects)
    quiet = hear_meshes(scene, before)
    gain = scene.loudness / quiet.std()
    heard, recording = hear_meshes(scene, after) * gain, after.recording
    for effect in effects:
        recording = effect.fault(recording)
        if effect.bearing is not None:
            heard = heard + hear_bearing(scene, after, effect.bearing)
    return _Side(before.recording, quiet * gain), _Side(recording, heard)


def _draw_kept(rng: np.random.Generator, samples: int, share: float) -> NDArray[np.bool_]:
    """Draw which samples are kept where a share is lost in short runs."""
    kept = np.ones(samples, dtype=bool)
    while (~kept).mean() < share:
        start = int(rng.integers(100, samples - 100))
        kept[start : start + int(rng.integers(1, 30))] = False
    return kept


def _held(recording: Recording, kept: NDArray[np.bool_]) -> Recording:
    """Return the recording with the last kept sample in place of a lost one."""
    last = np.maximum.accumulate(np.where(kept, np.arange(len(kept)), 0))
    measured = ("motor_torque", "motor_position", "load_position")
    return replace(recording, **{name: getattr(recording, name)[last] for name in measured})


def _rows(recording: Recording, kept: NDArray[np.bool_]) -> Recording:
    return Recording(**{column.name: getattr(recording, column.name)[kept] for column in fields(recording)})


def _strengths(scene: Scene, before: _Side, after: _Side, torque_limit: float, load_encoder: bool) -> dict[str, float]:
    """Return how much each channel changes by what is hidden, rms over the rms of its noise."""
    one, two, ratio = before.recording, after.recording, scene.sheet.ratio
    torque = np.clip(two.motor_torque, -torque_limit, torque_limit) - one.motor_torque
    twist = (two.load_position - two.motor_position / ratio) - (one.load_position - one.motor_position / ratio)
    steps_rms = 1.7e-6
    return {
        "motor_torque_nm": _rms(torque) / _rms(scene.torque_noise),
        "load_minus_motor": _rms(twist) / np.hypot(LOAD_ENCODER_RMS, steps_rms) if load_encoder else 0.0,
        "sound": _rms(after.sound - before.sound) / _rms(scene.microphone_noise),
        "motor_position_rad": _rms(two.motor_position - one.motor_position) / MOTOR_ENCODER_NOISE,
    }


def _answer(
    scene: Scene, entry: Entry, effects: Mapping[str, Effect], notes: Mapping[str, object], strengths: dict[str, float]
) -> dict[str, object]:
    strengths = {name: float(f"{value:.3g}") for name, value in strengths.items()}
    # the motor's position shows the servo's following error most of all, whatever is hidden
    channel = max((name for name in strengths if name != "motor_position_rad"), key=strengths.__getitem__, default=None)
    stick_speed = scene.axis.stick_speed
    return {
        "answer": [[name, None if name in PLACELESS else location] for name, location in entry.hidden.items()],
        "size": _joined({name: effect.size for name, effect in effects.items()}),
        "level": entry.level,
        "strength": strengths[channel] if channel else 0.0,
        "strength_channel": channel,
        "strengths": strengths,
        "load_encoder": entry.load_encoder,
        "motion": entry.motion,
        "noise": entry.noise,
        "stiction": "set-valued" if stick_speed == 0 else f"tanh(w/{stick_speed:.2f})",
        "extra": dict(notes),
    }


def _believed(seed: int, number: int, scene: Scene, effects: Sequence[Effect]) -> Axis:
    """Return what the description says: the axis a little off, without what is hidden."""
    axis = believed(np.random.default_rng((seed, 9000 + number)), scene.axis)
    for effect in effects:
        axis = effect.without(axis)
    return axis


def generate(seed: int, number: int) -> Scenario:
    """Generate the scenario of a seed that stands at `number` in the plan."""
    entry = PLAN[number]
    scene = draw_scene((seed, 1000 + number), entry.motion, entry.noise)
    rng = np.random.default_rng((seed, 5000 + number))
    effects = _draw_effects(rng, scene, entry)
    description = _believed(seed, number, scene, list(effects.values()))
    notes = _joined({name: effect.notes for name, effect in effects.items()})
    if entry.mistaken is not None:
        factor = 1 + float(rng.choice([-1, 1])) * rng.uniform(0.15, 0.3)
        description = mistaken(description, entry.mistaken, factor)
        notes["wrong_parameters"] = {"what": entry.mistaken, "sheet_over_truth": round(factor, 4)}
    before, after = _both_sides(scene, list(effects.values()))
    torque_limit = next((e.torque_limit for e in effects.values() if e.torque_limit is not None), np.inf)
    measured = measure(scene, after.recording, torque_limit)
    loss, lost = next((e.loss for e in effects.values() if e.loss is not None), None), None
    if loss is not None:
        kept = _draw_kept(rng, len(measured.time), loss.share)
        if loss.how == "held":
            measured, after = _held(measured, kept), replace(after, recording=_held(after.recording, kept))
        else:
            measured, lost = _rows(measured, kept), float((~kept).mean())
    strengths = _strengths(scene, before, after, torque_limit, entry.load_encoder) if effects else {}
    if lost is not None:
        strengths = {"rows_lost": lost}
    heard = after.sound + scene.microphone_noise
    return Scenario(scene, measured, heard, description, _answer(scene, entry, effects, notes, strengths))


def write(scenario: Scenario, folder: Path) -> None:
    """Write axis.toml, telemetry.csv and sound.wav (16 bit, mono) into a folder that names the axis; no answers."""
    folder.mkdir(parents=True, exist_ok=True)
    load_encoder = bool(scenario.answer["load_encoder"])
    axis = describe(f"axis-{folder.name}", scenario.believed, scenario.scene.sheet, load_encoder=load_encoder)
    (folder / "axis.toml").write_text(axis)
    names = [name for name in COLUMNS if load_encoder or name != "load_position"]
    np.savetxt(
        folder / "telemetry.csv",
        np.column_stack([getattr(scenario.recording, name) for name in names]),
        fmt=[COLUMNS[name][1] for name in names],
        delimiter=",",
        header=",".join(COLUMNS[name][0] for name in names),
        comments="",
    )
    # the level was set so that nothing clips
    sound = scenario.sound * min(1.0, 0.8 / np.abs(scenario.sound).max())
    soundfile.write(folder / "sound.wav", sound, SOUND_RATE_HZ, subtype="PCM_16")
