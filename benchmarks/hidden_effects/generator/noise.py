"""Noise and disturbances: coloured, non-stationary, and what encoders add."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.hidden_effects.generator.joint import Joint
from benchmarks.hidden_effects.generator.kernel import TELEMETRY_RATE_HZ
from benchmarks.hidden_effects.generator.motion import SETTLE_S

STYLES = ("stationary", "burst", "with speed")
MOTOR_ENCODER_STEP = 2 * np.pi / 2**17
LOAD_ENCODER_STEP = 2 * np.pi / 2**20


@dataclass(frozen=True)
class Noise:
    """Torque noise as measured (samples) [N m], torque on the load (settling + samples + 1) [N m], and their rms.

    `torque_rms` [N m] is of both together as they appear in the motor torque; `twist_rms` [rad] of the
    difference between load angle and motor angle over ratio; `load_encoder_rms` [rad] before its steps.
    """

    measured_torque: NDArray[np.float64]
    load_torque: NDArray[np.float64]
    torque_rms: float
    twist_rms: float
    load_encoder_rms: float


def coloured(rng: np.random.Generator, samples: int, corner_hz: float, rate_hz: float) -> NDArray[np.float64]:
    """Return first-order noise of unit rms."""
    pole = float(np.exp(-2 * np.pi * corner_hz / rate_hz))
    white = rng.standard_normal(samples + 2000)
    return lfilter([np.sqrt(1 - pole**2)], [1, -pole], white)[2000:]


def draw_noise(rng: np.random.Generator, joint: Joint, style: str, seconds: float, speed: NDArray[np.float64]) -> Noise:
    """Draw all noise of a recording; `speed` (samples) is the motor's, over its top speed."""
    samples = round(seconds * TELEMETRY_RATE_HZ)
    white, colour, corner = rng.uniform(0.002, 0.006), rng.uniform(0.003, 0.01), rng.uniform(1.0, 25.0)
    torque = white * rng.standard_normal(samples)
    torque += colour * coloured(rng, samples, corner, TELEMETRY_RATE_HZ)
    envelope = np.ones(samples)
    if style == "burst":
        start, length = rng.integers(0, samples * 3 // 4), int(samples * rng.uniform(0.12, 0.25))
        envelope[start : start + length] = rng.uniform(3.0, 5.0)
    elif style == "with speed":
        envelope = 0.4 + 1.2 * np.abs(speed[:samples])
    torque *= envelope * joint.peak_torque
    outer = rng.uniform(0.001, 0.004) * joint.peak_torque * joint.ratio
    load = outer * coloured(
        rng, samples + round(SETTLE_S * TELEMETRY_RATE_HZ) + 1, rng.uniform(0.5, 4.0), TELEMETRY_RATE_HZ
    )
    encoder = float(rng.uniform(3e-6, 6e-6))
    twist = np.hypot(encoder, LOAD_ENCODER_STEP / np.sqrt(12))
    return Noise(
        torque,
        load,
        float(np.hypot(np.std(torque), outer / joint.ratio)),
        float(np.hypot(twist, outer / joint.stiffness)),
        encoder,
    )


def motor_encoder(errors: np.random.Generator, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a 17-bit motor encoder reads [rad]: its own error once per turn, and steps."""
    read = angle + 4e-6 * np.cos(angle + errors.uniform(0, 2 * np.pi))
    return np.round(read / MOTOR_ENCODER_STEP) * MOTOR_ENCODER_STEP


def load_encoder(
    rng: np.random.Generator,
    errors: np.random.Generator,
    angle: NDArray[np.float64],
    error: float,
    added: tuple[float, float],
    noise_rms: float,
) -> NDArray[np.float64]:
    """Return what a 20-bit load encoder reads [rad]; `error` as new, `added` amplitude and phase hidden on top.

    `errors` draws the encoder's own, `rng` its noise.
    """
    phases, part = errors.uniform(0, 2 * np.pi, 2), errors.uniform(0.3, 0.9)
    read = angle + part * error * np.cos(angle + phases[0]) + 0.2 * part * error * np.cos(2 * angle + phases[1])
    read = read + added[0] * np.cos(angle + added[1]) + noise_rms * rng.standard_normal(len(angle))
    return np.round(read / LOAD_ENCODER_STEP) * LOAD_ENCODER_STEP
