"""What a microphone on the housing hears: changing mesh forces and the impacts of a bearing, through housing modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

SOUND_RATE_HZ = 8_000


@dataclass(frozen=True)
class Mode:
    """A mode of the housing: frequency [Hz], damping ratio, gain."""

    frequency_hz: float
    damping: float
    gain: float


@dataclass(frozen=True)
class Bearing:
    """A defect of a bearing: impacts per turn of the motor, and the rms of their sound."""

    order: float
    rms: float


def draw_modes(rng: np.random.Generator) -> tuple[Mode, ...]:
    """Draw a housing of five modes."""
    usual = ((310, 1.0), (520, 0.6), (735, 0.8), (1490, 0.9), (2400, 0.5))
    return tuple(Mode(f * rng.uniform(0.9, 1.1), rng.uniform(0.008, 0.03), g * rng.uniform(0.6, 1.5)) for f, g in usual)


def _through(modes: Sequence[Mode], excitation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the velocity of the modes, each a resonator made digital by the bilinear transform."""
    heard = np.zeros(len(excitation))
    for mode in modes:
        rate = 2 * np.pi * mode.frequency_hz
        numerator, denominator = signal.bilinear([0, rate, 0], [1, 2 * mode.damping * rate, rate * rate], SOUND_RATE_HZ)
        heard += mode.gain * signal.lfilter(numerator, denominator, excitation)
    return heard


def of_meshes(
    modes: Sequence[Mode], torques: NDArray[np.float64], output_ratio: float, ratio: float
) -> NDArray[np.float64]:
    """Return the sound of the meshes, not yet scaled; `torques` (n, 2) at the driven gears at the sound's rate [N m].

    The housing answers to changes of the torques, both referred to the motor.
    """
    excitation = np.gradient(torques[:, 0]) * output_ratio + np.gradient(torques[:, 1])
    return _through(modes, excitation / ratio)


def of_bearing(
    rng: np.random.Generator,
    modes: Sequence[Mode],
    bearing: Bearing,
    motor_angle: NDArray[np.float64],
    motor_speed: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the sound of a bearing's defect; angle [rad] and speed [rad/s] of the motor at the sound's rate.

    The defect passes at fixed angles in both directions, with 3 % scatter; impacts grow with speed, and ring shortly
    near the bearing.
    """
    passes = motor_angle * bearing.order / (2 * np.pi)
    moments = np.flatnonzero(np.diff(np.floor(passes)) != 0)
    pace = np.abs(np.gradient(passes)[moments]) + 0.003
    moments = moments + np.rint(0.03 * rng.standard_normal(len(moments)) / pace).astype(int)
    moments = np.clip(moments, 0, len(motor_angle) - 1)
    force = 0.35 + 0.65 * np.abs(motor_speed[moments]) / 250
    impacts = np.zeros(len(motor_angle))
    impacts[moments] += force * (1 + 0.35 * rng.standard_normal(len(moments)))
    near = [Mode(mode.frequency_hz, 3 * mode.damping + 0.03, mode.gain) for mode in modes[1:]]
    heard = _through(near, impacts)
    return heard / heard.std() * bearing.rms
