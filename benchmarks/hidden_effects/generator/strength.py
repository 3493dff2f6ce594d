"""How strong an effect is: its change in the signals, beyond what other data-sheet values could do, over the noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden_effects.generator.effect import Effect
from benchmarks.hidden_effects.generator.joint import Joint
from benchmarks.hidden_effects.generator.microphone import Microphone, of_gears
from benchmarks.hidden_effects.generator.motion import Motion
from benchmarks.hidden_effects.generator.noise import Noise
from benchmarks.hidden_effects.generator.plant import Plant, Run, simulate

WINDOW_S = 10.0


def _beyond(change: NDArray[np.float64], columns: list[NDArray[np.float64]]) -> float:
    """Return the rms of what no combination of the columns explains."""
    matrix = np.column_stack(columns)[::4]
    matrix = matrix / (np.linalg.norm(matrix, axis=0) + 1e-300)
    coefficients = np.linalg.lstsq(matrix, change[::4], rcond=None)[0]
    return float(np.sqrt(np.mean((change[::4] - matrix @ coefficients) ** 2)))


def sheet_columns(run: Run, joint: Joint, spared: tuple[str, ...]) -> list[NDArray[np.float64]]:
    """Return how signals would change with inertias, Coulomb and viscous friction."""
    speed = run.motor_speed
    columns = [np.gradient(speed), np.gradient(np.gradient(run.load_angle))]
    if "coulomb" not in spared:
        columns.append(np.tanh(speed / (0.01 * joint.top_speed * joint.ratio)))
    if "viscous" not in spared:
        columns.append(speed)
    return columns


def twist_columns(run: Run, joint: Joint, spared: tuple[str, ...]) -> list[NDArray[np.float64]]:
    """Return how the twist would change with stiffness, damping, the encoders' zero and as-new errors as well."""
    twist = run.load_angle - run.motor_angle / joint.ratio
    columns = [np.ones_like(twist), twist, np.gradient(twist), *sheet_columns(run, joint, spared)]
    if "encoder" not in spared:
        columns += [wave(order * run.load_angle) for order in (1, 2) for wave in (np.cos, np.sin)]
    return columns


@dataclass(frozen=True)
class Gauge:
    """Measures the strength of plant effects of one joint in one motion, free of noise.

    `microphone` None: in torque and, with a load encoder, in twist; otherwise in the sound alone.
    """

    motion: Motion
    noise: Noise
    load_encoder: bool
    microphone: Microphone | None
    seconds: float

    def strengths(self, plant: Plant, effect: Effect) -> Callable[[float], float]:
        """Return the effect's strength as a function of its amplitude; `plant` is the joint in good order."""
        # a damaged tooth may be passed rarely
        seconds = self.seconds if effect.mechanism == "tooth_damage" else min(WINDOW_S, self.seconds)

        def run(plant: Plant) -> Run:
            return simulate(plant, self.motion, seconds, quantised=False, drift_start=effect.drift_start)

        before = run(effect.without(plant))

        def strength(amplitude: float) -> float:
            change = self._change(plant.joint, effect, before, run(effect.act(plant, amplitude)))
            return effect.strength_share * change

        return strength

    def _change(self, joint: Joint, effect: Effect, before: Run, after: Run) -> float:
        if self.microphone is not None:
            healthy, ill = of_gears(self.microphone, before.force), of_gears(self.microphone, after.force)
            return float(self.microphone.shaking * np.std(ill - healthy) / np.max(np.abs(healthy)))
        torque = after.motor_torque - before.motor_torque
        strength = _beyond(torque, sheet_columns(before, joint, effect.spared)) / self.noise.torque_rms
        if not self.load_encoder:
            return strength
        twist = (after.load_angle - before.load_angle) - (after.motor_angle - before.motor_angle) / joint.ratio
        return max(strength, _beyond(twist, twist_columns(before, joint, effect.spared)) / self.noise.twist_rms)


def full_amplitude(strength: Callable[[float], float], effect: Effect) -> float:
    """Return the amplitude of strength 1, by secant steps on log scales, within the effect's cap and floor."""
    first = min(effect.guess, effect.cap)
    found = strength(first)
    if found <= 0:
        return effect.cap
    second = min(first / found, effect.cap)
    again = strength(second)
    if again <= 0 or abs(np.log(second / first)) < 1e-6:
        return max(second, effect.floor)
    power = np.clip(np.log(again / found) / np.log(second / first), 0.4, 2.5)
    return max(float(min(second * again ** (-1 / power), effect.cap)), effect.floor)
