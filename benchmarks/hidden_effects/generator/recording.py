"""What is recorded of a run: encoders, drive and microphone, and the faults of the recorder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden_effects.generator import microphone as mic
from benchmarks.hidden_effects.generator import noise as noises
from benchmarks.hidden_effects.generator.effect import Effect
from benchmarks.hidden_effects.generator.joint import Joint
from benchmarks.hidden_effects.generator.kernel import SERVO_RATE_HZ, TELEMETRY_RATE_HZ
from benchmarks.hidden_effects.generator.motion import SETTLE_S, Motion
from benchmarks.hidden_effects.generator.plant import Run
from benchmarks.hidden_effects.generator.recipe import Recipe


@dataclass(frozen=True)
class Placed:
    """An effect with its amplitude."""

    effect: Effect
    amplitude: float
    strength: float


def telemetry(
    rng: np.random.Generator,
    errors: np.random.Generator,
    recipe: Recipe,
    joint: Joint,
    motion: Motion,
    run: Run,
    noise: noises.Noise,
    placed: list[Placed],
) -> dict[str, NDArray[np.float64]]:
    """Return what encoders and drive report, without recording faults; `errors` draws those of the encoders."""
    samples = len(run.motor_torque)
    start, every = round(SETTLE_S * SERVO_RATE_HZ), SERVO_RATE_HZ // TELEMETRY_RATE_HZ
    telemetry = {"time_s": np.arange(samples) / TELEMETRY_RATE_HZ}
    if recipe.reference:
        telemetry["reference_position_rad"] = motion.course[0, start::every][:samples] * joint.ratio
    telemetry["motor_torque_nm"] = run.motor_torque + noise.measured_torque
    telemetry["motor_position_rad"] = noises.motor_encoder(errors, run.motor_angle)
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
            rng, errors, run.load_angle, joint.encoder_error, added, noise.load_encoder_rms
        )
    return telemetry


def spoil(
    rng: np.random.Generator, telemetry: dict[str, NDArray[np.float64]], placed: list[Placed]
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


def mesh_orders(joint: Joint) -> tuple[float, ...]:
    """Return the tooth contacts per turn of the motor of each stage."""
    turns, orders = 1.0, []
    for stage in joint.stages:
        orders.append(turns * stage.driver_teeth)
        turns /= stage.ratio
    return tuple(orders)


def sound(
    rng: np.random.Generator,
    microphone: mic.Microphone,
    joint: Joint,
    healthy: Run,
    run: Run,
    placed: list[Placed],
) -> NDArray[np.float64]:
    """Return what the microphone hears, within -1 to 1; a gearbox in good order has about the rms `loudness`."""
    shaken = mic.of_gears(microphone, run.force) / np.max(np.abs(mic.of_gears(microphone, healthy.force)))
    running = mic.of_running(rng, microphone, run.motor_angle, mesh_orders(joint))
    heard = microphone.shaking * shaken + running
    heard += microphone.noise_ratio * mic.background(rng, microphone, len(heard))
    for one in placed:
        if one.effect.where == "sound bearing":
            heard += one.amplitude * mic.of_bearing(rng, microphone, run.motor_angle, one.effect.detail[0])
        elif one.effect.where == "sound hum":
            phases = rng.uniform(0, 2 * np.pi, 3)
            heard += one.amplitude * mic.hum(one.effect.detail[0], len(heard), mic.SOUND_RATE_HZ, phases)
    heard *= microphone.loudness
    heard *= min(1.0, 0.9 / np.max(np.abs(heard)))
    for one in placed:
        if one.effect.where == "sound clipped":
            limit = np.quantile(np.abs(heard), 1 - one.amplitude)
            heard = np.clip(heard, -limit, limit)
    return heard
