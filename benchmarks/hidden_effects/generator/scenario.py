"""One hidden-effect scenario: drawn by seed, simulated, measured, written as a technician would hand it over."""

from __future__ import annotations

import wave
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden_effects.generator import microphone as mic
from benchmarks.hidden_effects.generator import noise as noises
from benchmarks.hidden_effects.generator import recording
from benchmarks.hidden_effects.generator.comparison import compare
from benchmarks.hidden_effects.generator.effect import Draw, Effect
from benchmarks.hidden_effects.generator.effects import EFFECTS
from benchmarks.hidden_effects.generator.joint import Joint, believed, describe, draw_joint
from benchmarks.hidden_effects.generator.kernel import SERVO_RATE_HZ, TELEMETRY_RATE_HZ
from benchmarks.hidden_effects.generator.motion import SETTLE_S, Motion, draw_motion
from benchmarks.hidden_effects.generator.plant import Plant, build_plant, simulate
from benchmarks.hidden_effects.generator.recipe import LEVELS, Recipe, draw_recipe
from benchmarks.hidden_effects.generator.recording import Placed
from benchmarks.hidden_effects.generator.strength import Gauge, full_amplitude

SOUND_RATE_HZ = mic.SOUND_RATE_HZ
DECIMALS = {
    "time_s": 4,
    "reference_position_rad": 6,
    "motor_torque_nm": 4,
    "motor_position_rad": 6,
    "motor_speed_rad_s": 4,
    "load_position_rad": 8,
}


@dataclass(frozen=True)
class Hidden:
    """One thing that was hidden: its name, its place where data can tell, where it truly is, and its true size.

    `strength`: rms of its change in the signals over rms noise.  `channel`: where it enters.
    """

    mechanism: str
    location: str | None
    true_location: str | None
    size: Mapping[str, float]
    strength: float
    channel: str


@dataclass(frozen=True)
class Scenario:
    """A recording with its answer: `telemetry` columns (n,) by name, `sound` (m,) at 8 kHz; either may be absent.

    `as_new` (m,) is a sound of the same joint in good order, where there is one; `second_telemetry` columns (n,) of
    the same joint on another day, with the same effect; its strength is that in the first.
    `joint` is the truth, `axis` the description in TOML, which is believed and a little wrong.  `verdict` is what
    should be said, `may_be_unnamed` whether saying 'unnamed' is as right.
    """

    seed: int
    recipe: Recipe
    joint: Joint = field(repr=False)
    axis: str = field(repr=False)
    telemetry: Mapping[str, NDArray[np.float64]] | None = field(repr=False)
    sound: NDArray[np.float64] | None = field(repr=False)
    hidden: tuple[Hidden, ...]
    verdict: str
    may_be_unnamed: bool
    as_new: NDArray[np.float64] | None = field(default=None, repr=False)
    second_telemetry: Mapping[str, NDArray[np.float64]] | None = field(default=None, repr=False)

    def answer(self) -> dict[str, object]:
        """Return the answer as JSON data."""
        return {
            "id": f"s{self.seed}",
            "answer": [[h.mechanism, h.location] for h in self.hidden],
            "size": {name: value for h in self.hidden for name, value in h.size.items()},
            "verdict": self.verdict,
            "may_be_unnamed": self.may_be_unnamed,
            "group": self.recipe.group,
            "level": self.recipe.level,
            "kind": self.recipe.kind,
            "load_encoder": self.recipe.load_encoder,
            "noise": self.recipe.noise,
            "hidden": [
                {
                    "mechanism": h.mechanism,
                    "location": h.location,
                    "true_location": h.true_location,
                    "size": dict(h.size),
                    "strength": h.strength,
                    "channel": h.channel,
                }
                for h in self.hidden
            ],
        }


def generate(seed: int, recipe: Recipe | None = None, *, seconds: float = 30.0) -> Scenario:
    """Return the scenario of a seed; without a recipe, it is drawn by the seed as well. The same seed, the same data.

    Raises ValueError when an effect of the recipe cannot be felt at all in this joint.
    """
    recipe = recipe or draw_recipe(seed)
    rng = np.random.default_rng([seed, 2])
    joint = draw_joint(rng, recipe.kind)
    if recipe.group.startswith("sound compared"):
        return _compared(seed, rng, recipe, joint, seconds)
    motion, noise = _draw_day(rng, recipe, joint, seconds)
    microphone = mic.draw_microphone(rng)
    gauge = Gauge(motion, noise, recipe.load_encoder, None if recipe.telemetry else microphone, seconds)
    inside = int(rng.integers(2**32))
    placed, joint, recipe = _place(rng, recipe, joint, motion, gauge, inside)
    plant = build_plant(np.random.default_rng(inside), joint)
    healthy = simulate(plant, motion, min(6.0, seconds), quantised=False)
    for one in placed:
        plant = one.effect.act(plant, one.amplitude)
    run = simulate(plant, motion, seconds, disturbance=noise.load_torque)
    several = recipe.group.startswith("several")
    errors = _encoder_errors(inside) if several else rng
    telemetry = (
        recording.telemetry(rng, errors, recipe, joint, motion, run, noise, placed) if recipe.telemetry else None
    )
    sound = recording.sound(rng, microphone, joint, healthy, run, placed) if recipe.sound else None
    if telemetry is not None:
        telemetry = recording.spoil(rng, telemetry, placed)
    wrong = recipe.group == "wrong parameters"
    sheet = believed(
        rng, joint, spread=0.08 if wrong else 0.02, payload=float(rng.choice([-1, 1]) * rng.uniform(0.15, 0.25)) * wrong
    )
    for one in placed:
        sheet = one.effect.forget(sheet)
    axis = describe(
        sheet,
        load_encoder=recipe.load_encoder,
        teeth=recipe.teeth,
        whole_transmission=recipe.whole_transmission,
    )
    named = any(one.effect.mechanism != "unnamed" for one in placed)
    return Scenario(
        seed=seed,
        recipe=recipe,
        joint=joint,
        axis=axis,
        telemetry=telemetry,
        sound=sound,
        hidden=tuple(_hidden(one) for one in placed),
        verdict="named" if named else ("unnamed" if placed else "nothing_missing"),
        may_be_unnamed=any(one.effect.mechanism == "structural_resonance" for one in placed),
        second_telemetry=_on_another_day(seed, recipe, plant, placed, inside, seconds) if several else None,
    )


def _draw_day(rng: np.random.Generator, recipe: Recipe, joint: Joint, seconds: float) -> tuple[Motion, noises.Noise]:
    """Draw the program and the noise of a recording."""
    motion = draw_motion(rng, joint.top_speed, seconds)
    speed = motion.course[1, int(SETTLE_S * SERVO_RATE_HZ) :: SERVO_RATE_HZ // TELEMETRY_RATE_HZ] / joint.top_speed
    return motion, noises.draw_noise(rng, joint, recipe.noise, seconds, speed)


def _encoder_errors(inside: int) -> np.random.Generator:
    """Return what draws the same errors of the encoders for every recording of a joint."""
    return np.random.default_rng([inside, 1])


def _on_another_day(
    seed: int, recipe: Recipe, plant: Plant, placed: list[Placed], inside: int, seconds: float
) -> Mapping[str, NDArray[np.float64]]:
    """Return telemetry of the same plant in another motion and other noise."""
    rng, joint = np.random.default_rng([seed, 3]), plant.joint
    motion, noise = _draw_day(rng, recipe, joint, seconds)
    run = simulate(plant, motion, seconds, disturbance=noise.load_torque)
    errors = _encoder_errors(inside)
    telemetry = recording.telemetry(rng, errors, recipe, joint, motion, run, noise, placed)
    return recording.spoil(rng, telemetry, placed)


def _compared(seed: int, rng: np.random.Generator, recipe: Recipe, joint: Joint, seconds: float) -> Scenario:
    """Return a scenario of two sounds."""
    as_new, now, placed = compare(rng, joint, recipe.effects, LEVELS[recipe.level], seconds)
    return Scenario(
        seed=seed,
        recipe=recipe,
        joint=joint,
        axis=describe(believed(rng, joint), load_encoder=False),
        telemetry=None,
        sound=now.sound,
        hidden=tuple(_hidden(one) for one in placed),
        verdict="named" if placed else "nothing_missing",
        may_be_unnamed=False,
        as_new=as_new.sound,
    )


def _hidden(one: Placed) -> Hidden:
    e = one.effect
    return Hidden(e.mechanism, e.scored_location, e.location, e.size(one.amplitude), one.strength, e.where)


def _place(
    rng: np.random.Generator, recipe: Recipe, joint: Joint, motion: Motion, gauge: Gauge, inside: int
) -> tuple[list[Placed], Joint, Recipe]:
    """Draw places and amplitudes; where an effect cannot reach its level it is drawn again, at last at a lower one."""
    placed: list[Placed] = []
    lowest = recipe.level
    for name in recipe.effects:
        tried: list[tuple[Placed, str, Joint]] = []
        for _ in range(4):
            effect = EFFECTS[name](Draw(rng, joint, motion, recipe.load_encoder, recipe.telemetry, recipe.sound))
            prepared = effect.prepare(joint)
            inner = build_plant(np.random.default_rng(inside), prepared)
            found = _sized(gauge, inner, effect, recipe.level)
            if found is not None:
                tried.append((*found, prepared))
                if found[1] == recipe.level:
                    break
        if not tried:
            raise ValueError(f"{name} cannot be felt with {recipe}")
        one, level, joint = max(tried, key=lambda t: LEVELS[t[1]])
        placed.append(one)
        lowest = min(lowest, level, key=lambda level: LEVELS[level])
    return placed, joint, replace(recipe, level=lowest)


def _sized(gauge: Gauge, plant: Plant, effect: Effect, wanted: str) -> tuple[Placed, str] | None:
    """Give an effect its amplitude: a level times its full size; the wanted level, or the next that can be reached."""
    if effect.where != "plant":
        return _sized_outside(gauge, effect, LEVELS[wanted]), wanted
    strength = gauge.strengths(plant, effect)
    full = full_amplitude(strength, effect)
    for level in [name for name in LEVELS if LEVELS[name] <= LEVELS[wanted]]:
        amplitude = min(LEVELS[level] * full, effect.cap)
        reached = strength(amplitude)
        if reached >= 0.6 * LEVELS[level]:
            return Placed(effect, amplitude, reached), level
    return None


def _sized_outside(gauge: Gauge, effect: Effect, level: float) -> Placed:
    """Give an effect of sensors, recording or sound its amplitude."""
    if effect.where in ("torque offset", "torque hum"):
        return Placed(effect, level * gauge.noise.torque_rms, level)
    if effect.where == "load encoder":
        amplitude = level * effect.floor
        return Placed(effect, amplitude, float(amplitude / np.sqrt(2) / gauge.noise.twist_rms))
    return Placed(effect, min(level * effect.guess, effect.cap), level)


def write(scenario: Scenario, folder: Path) -> None:
    """Write axis.toml and, where recorded, telemetry.csv, telemetry_2.csv, sound.wav and as_new.wav; no answers."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "axis.toml").write_text(scenario.axis)
    for name, telemetry in (("telemetry.csv", scenario.telemetry), ("telemetry_2.csv", scenario.second_telemetry)):
        if telemetry is not None:
            _write_telemetry(telemetry, folder / name)
    for name, sound in (("sound.wav", scenario.sound), ("as_new.wav", scenario.as_new)):
        if sound is not None:
            _write_sound(sound, folder / name)


def _write_telemetry(telemetry: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """Write columns (n,) by name as CSV."""
    names = list(telemetry)
    table = np.column_stack([telemetry[name] for name in names])
    row = ",".join(f"%.{DECIMALS[name]}f" for name in names) + "\n"
    text = (row * len(table)) % tuple(table.ravel().tolist())
    path.write_text(",".join(names) + "\n" + text)


def _write_sound(sound: NDArray[np.float64], path: Path) -> None:
    """Write a sound within -1 to 1 as WAV, 16 bit, mono."""
    samples = np.round(sound * 32767).astype("<i2")
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(SOUND_RATE_HZ)
        file.writeframes(samples.tobytes())
