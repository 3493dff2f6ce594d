"""One hidden-effect scenario: drawn by seed, simulated, measured, written as a technician would hand it over."""

from __future__ import annotations

import wave
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.hidden_effects.generator import microphone as mic
from tests.hidden_effects.generator import noise as noises
from tests.hidden_effects.generator.effects import EFFECTS, Draw, Effect
from tests.hidden_effects.generator.joint import Joint, believed, describe, draw_joint
from tests.hidden_effects.generator.kernel import SERVO_RATE_HZ, TELEMETRY_RATE_HZ
from tests.hidden_effects.generator.motion import SETTLE_S, Motion, draw_motion
from tests.hidden_effects.generator.plant import Plant, Run, build_plant, simulate
from tests.hidden_effects.generator.recipe import LEVELS, Recipe, draw_recipe
from tests.hidden_effects.generator.strength import Gauge, full_amplitude

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


@dataclass(frozen=True)
class _Placed:
    """An effect with its amplitude."""

    effect: Effect
    amplitude: float
    strength: float

    def hidden(self) -> Hidden:
        e = self.effect
        return Hidden(e.mechanism, e.scored_location, e.location, e.size(self.amplitude), self.strength, e.where)


def generate(seed: int, recipe: Recipe | None = None, *, seconds: float = 30.0) -> Scenario:
    """Return the scenario of a seed; without a recipe, it is drawn by the seed as well. The same seed, the same data.

    Raises ValueError when an effect of the recipe cannot be felt at all in this joint.
    """
    recipe = recipe or draw_recipe(seed)
    rng = np.random.default_rng([seed, 2])
    joint = draw_joint(rng, recipe.kind)
    motion = draw_motion(rng, joint.top_speed, seconds)
    speed = motion.course[1, int(SETTLE_S * SERVO_RATE_HZ) :: SERVO_RATE_HZ // TELEMETRY_RATE_HZ] / joint.top_speed
    noise = noises.draw_noise(rng, joint, recipe.noise, seconds, speed)
    microphone = mic.draw_microphone(rng)
    gauge = Gauge(motion, noise, recipe.load_encoder, None if recipe.telemetry else microphone, seconds)
    inside = int(rng.integers(2**32))
    placed, joint, recipe = _place(rng, recipe, joint, motion, gauge, inside)
    plant = build_plant(np.random.default_rng(inside), joint)
    healthy = simulate(plant, motion, 6.0, quantised=False)
    for one in placed:
        plant = one.effect.act(plant, one.amplitude)
    run = simulate(plant, motion, seconds, disturbance=noise.load_torque)
    telemetry = _telemetry(rng, recipe, joint, motion, run, noise, placed) if recipe.telemetry else None
    sound = _sound(rng, microphone, joint, healthy, run, placed) if recipe.sound else None
    if telemetry is not None:
        telemetry = _spoil(rng, telemetry, placed)
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
        hidden=tuple(one.hidden() for one in placed),
        verdict="named" if named else ("unnamed" if placed else "nothing_missing"),
        may_be_unnamed=any(one.effect.mechanism == "structural_resonance" for one in placed),
    )


def _place(
    rng: np.random.Generator, recipe: Recipe, joint: Joint, motion: Motion, gauge: Gauge, inside: int
) -> tuple[list[_Placed], Joint, Recipe]:
    """Draw places and amplitudes; where an effect cannot reach its level it is drawn again, at last at a lower one."""
    placed: list[_Placed] = []
    lowest = recipe.level
    for name in recipe.effects:
        tried: list[tuple[_Placed, str, Joint]] = []
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


def _sized(gauge: Gauge, plant: Plant, effect: Effect, wanted: str) -> tuple[_Placed, str] | None:
    """Give an effect its amplitude: a level times its full size; the wanted level, or the next that can be reached."""
    if effect.where != "plant":
        return _sized_outside(gauge, effect, LEVELS[wanted]), wanted
    strength = gauge.strengths(plant, effect)
    full = full_amplitude(strength, effect)
    for level in [name for name in LEVELS if LEVELS[name] <= LEVELS[wanted]]:
        amplitude = min(LEVELS[level] * full, effect.cap)
        reached = strength(amplitude)
        if reached >= 0.6 * LEVELS[level]:
            return _Placed(effect, amplitude, reached), level
    return None


def _sized_outside(gauge: Gauge, effect: Effect, level: float) -> _Placed:
    """Give an effect of sensors, recording or sound its amplitude."""
    if effect.where in ("torque offset", "torque hum"):
        return _Placed(effect, level * gauge.noise.torque_rms, level)
    if effect.where == "load encoder":
        amplitude = level * effect.floor
        return _Placed(effect, amplitude, float(amplitude / np.sqrt(2) / gauge.noise.twist_rms))
    return _Placed(effect, min(level * effect.guess, effect.cap), level)


def _telemetry(
    rng: np.random.Generator,
    recipe: Recipe,
    joint: Joint,
    motion: Motion,
    run: Run,
    noise: noises.Noise,
    placed: list[_Placed],
) -> dict[str, NDArray[np.float64]]:
    """Return what encoders and drive report, without recording faults."""
    samples = len(run.motor_torque)
    start, every = round(SETTLE_S * SERVO_RATE_HZ), SERVO_RATE_HZ // TELEMETRY_RATE_HZ
    telemetry = {"time_s": np.arange(samples) / TELEMETRY_RATE_HZ}
    if recipe.reference:
        telemetry["reference_position_rad"] = motion.course[0, start::every][:samples] * joint.ratio
    telemetry["motor_torque_nm"] = run.motor_torque + noise.measured_torque
    telemetry["motor_position_rad"] = noises.motor_encoder(rng, run.motor_angle)
    if recipe.speed_channel:
        telemetry["motor_speed_rad_s"] = run.motor_speed + 1e-4 * joint.top_speed * joint.ratio * (
            rng.standard_normal(samples)
        )
    if recipe.load_encoder:
        added = next(
            ((one.amplitude, one.effect.detail[0]) for one in placed if one.effect.where == "load encoder"),
            (0.0, 0.0),
        )
        telemetry["load_position_rad"] = noises.load_encoder(
            rng, run.load_angle, joint.encoder_error, added, noise.load_encoder_rms
        )
    return telemetry


def _spoil(
    rng: np.random.Generator, telemetry: dict[str, NDArray[np.float64]], placed: list[_Placed]
) -> dict[str, NDArray[np.float64]]:
    """Add recording faults in the order in which a recorder would: delay, hum, offset, clipping, lost rows."""
    time, torque = telemetry["time_s"], telemetry["motor_torque_nm"]
    order = ("delay", "torque hum", "torque offset", "torque clipped", "lost")
    for one in sorted((p for p in placed if p.effect.where in order), key=lambda p: order.index(p.effect.where)):
        where, size = one.effect.where, one.amplitude
        if where == "delay":
            late = "load_position_rad" if one.effect.detail[0] else "motor_torque_nm"
            telemetry[late] = np.interp(time - size, time, telemetry[late])
            torque = telemetry["motor_torque_nm"]
        elif where == "torque hum":
            phases = rng.uniform(0, 2 * np.pi, 3)
            torque = torque + size * mic.hum(one.effect.detail[0], len(time), TELEMETRY_RATE_HZ, phases)
        elif where == "torque offset":
            torque = torque + size * one.effect.detail[0]
        elif where == "torque clipped":
            limit = np.quantile(np.abs(torque), 1 - size)
            torque = np.clip(torque, -limit, limit)
        telemetry["motor_torque_nm"] = torque
        if where == "lost":
            telemetry = _lose(rng, telemetry, size, hold=bool(one.effect.detail[0]))
    return telemetry


def _lose(
    rng: np.random.Generator, telemetry: dict[str, NDArray[np.float64]], part: float, *, hold: bool
) -> dict[str, NDArray[np.float64]]:
    """Lose a part of the rows in short runs: they are missing, or hold the last value."""
    samples = len(telemetry["time_s"])
    lost = np.zeros(samples, dtype=bool)
    while lost.mean() < part:
        start = int(rng.integers(1, samples - 20))
        lost[start : start + int(rng.integers(1, 9))] = True
    if not hold:
        return {name: values[~lost] for name, values in telemetry.items()}
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(samples)))
    return {name: values if name == "time_s" else values[last] for name, values in telemetry.items()}


def _mesh_orders(joint: Joint) -> tuple[float, ...]:
    """Return the tooth contacts per turn of the motor of each stage."""
    turns, orders = 1.0, []
    for stage in joint.stages:
        orders.append(turns * stage.driver_teeth)
        turns /= stage.ratio
    return tuple(orders)


def _sound(
    rng: np.random.Generator,
    microphone: mic.Microphone,
    joint: Joint,
    healthy: Run,
    run: Run,
    placed: list[_Placed],
) -> NDArray[np.float64]:
    """Return what the microphone hears, within -1 to 1; a gearbox in good order has about the rms `loudness`."""
    shaken = mic.of_gears(microphone, run.force) / np.max(np.abs(mic.of_gears(microphone, healthy.force)))
    running = mic.of_running(rng, microphone, run.motor_angle, _mesh_orders(joint))
    heard = microphone.shaking * shaken + running
    heard += microphone.noise_ratio * mic.background(rng, microphone, len(heard))
    for one in placed:
        if one.effect.where == "sound bearing":
            heard += one.amplitude * mic.of_bearing(rng, microphone, run.motor_angle, one.effect.detail[0])
        elif one.effect.where == "sound hum":
            phases = rng.uniform(0, 2 * np.pi, 3)
            heard += one.amplitude * mic.hum(one.effect.detail[0], len(heard), SOUND_RATE_HZ, phases)
    heard *= microphone.loudness
    heard *= min(1.0, 0.9 / np.max(np.abs(heard)))
    for one in placed:
        if one.effect.where == "sound clipped":
            limit = np.quantile(np.abs(heard), 1 - one.amplitude)
            heard = np.clip(heard, -limit, limit)
    return heard


def write(scenario: Scenario, folder: Path) -> None:
    """Write axis.toml and, where recorded, telemetry.csv and sound.wav (16 bit, mono) into a folder; no answers."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "axis.toml").write_text(scenario.axis)
    if scenario.telemetry is not None:
        names = list(scenario.telemetry)
        table = np.column_stack([scenario.telemetry[name] for name in names])
        row = ",".join(f"%.{DECIMALS[name]}f" for name in names) + "\n"
        text = (row * len(table)) % tuple(table.ravel().tolist())
        (folder / "telemetry.csv").write_text(",".join(names) + "\n" + text)
    if scenario.sound is not None:
        samples = np.round(scenario.sound * 32767).astype("<i2")
        with wave.open(str(folder / "sound.wav"), "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(SOUND_RATE_HZ)
            file.writeframes(samples.tobytes())
