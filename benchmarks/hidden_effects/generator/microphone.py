"""What a microphone on the housing hears: mesh forces and impacts through housing modes, and a workshop's noise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, resample_poly, sosfilt

from benchmarks.hidden_effects.generator.kernel import STEP_RATE_HZ, TELEMETRY_RATE_HZ
from benchmarks.hidden_effects.generator.noise import coloured

SOUND_RATE_HZ = 8_000
WHINE = ((1, 1.0), (2, 0.5), (3, 0.25))


@dataclass(frozen=True)
class Microphone:
    """Housing modes (n, 3): frequency [Hz], damping ratio, gain; direct gain, background noise, fan [Hz] and its part.

    `shaking`: peak of what the simulated mesh forces contribute to the sound of a gearbox in good order, over the
    rms of its tooth whine and rolling noise; `loudness`: that rms as recorded.
    """

    modes: NDArray[np.float64]
    direct: float
    shaking: float
    noise_ratio: float
    noise_corner_hz: float
    fan_hz: float
    loudness: float
    fan: float = 0.3


@dataclass(frozen=True)
class Whine:
    """One line of tooth whine at top speed: per turn of the motor, amplitude, phase [rad]."""

    order: float
    amplitude: float
    phase: float


def draw_microphone(rng: np.random.Generator) -> Microphone:
    """Draw a housing of three to five modes and a noise 6 to 20 dB below the gearbox."""
    count = int(rng.integers(3, 6))
    modes = np.column_stack(
        [rng.uniform(200, 3300, count), rng.uniform(0.01, 0.05, count), rng.uniform(0.3, 1.0, count)]
    )
    return Microphone(
        modes,
        float(rng.uniform(0.1, 0.5)),
        float(rng.uniform(1.5, 3.5)),
        float(10 ** (-rng.uniform(6, 20) / 20)),
        float(rng.uniform(50, 400)),
        float(rng.uniform(80, 140)),
        float(0.01 * 10 ** rng.uniform(-0.3, 0.5)),
    )


def through_housing(microphone: Microphone, excitation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the modes' and the direct answer to an excitation, both at the sound's rate."""
    heard = microphone.direct * excitation
    for frequency, damping, gain in microphone.modes:
        heard = heard + through_mode(frequency, damping, gain, excitation)
    return heard


def through_mode(frequency: float, damping: float, gain: float, excitation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the answer of one mode of `frequency` [Hz] to an excitation at the sound's rate."""
    rate = 2 * np.pi * frequency / SOUND_RATE_HZ
    radius = np.exp(-damping * rate)
    filter_ = np.array([[gain * damping * 4, 0, -gain * damping * 4, 1, -2 * radius * np.cos(rate), radius**2]])
    return sosfilt(filter_, excitation)


def of_gears(microphone: Microphone, force: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the gearbox's own sound from the mesh force at the simulation's rate, not yet scaled."""
    return through_housing(microphone, shaken_by(force))


def shaken_by(force: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return how the mesh force at the simulation's rate excites the housing, at the sound's rate, not yet scaled."""
    rough = resample_poly(np.diff(force, prepend=force[:1]), 1, STEP_RATE_HZ // SOUND_RATE_HZ)
    return sosfilt(butter(2, 25, "high", fs=SOUND_RATE_HZ, output="sos"), rough.astype(np.float64))


def fine_angle(motor_angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the motor's angle [rad] at the sound's rate."""
    fine = SOUND_RATE_HZ // TELEMETRY_RATE_HZ
    return np.interp(np.arange(len(motor_angle) * fine) / fine, np.arange(len(motor_angle)), motor_angle)


def of_running(
    rng: np.random.Generator,
    microphone: Microphone,
    motor_angle: NDArray[np.float64],
    mesh_orders: tuple[float, ...],
) -> NDArray[np.float64]:
    """Return tooth whine at the mesh orders (per turn of the motor) and rolling noise, both louder at speed; rms 1."""
    angle = fine_angle(motor_angle)
    rolling = 0.5 * rng.standard_normal(len(angle))
    lines = []
    for order in mesh_orders:
        for harmonic, level in WHINE:
            phase = float(rng.uniform(0, 2 * np.pi))
            lines.append(Whine(harmonic * order, float(level * rng.uniform(0.3, 1.0)), phase))
    heard = through_housing(microphone, excited_by(angle, np.max(np.abs(np.gradient(angle))), rolling, lines))
    return heard / np.std(heard)


def excited_by(
    angle: NDArray[np.float64], top_speed: float, rolling: NDArray[np.float64], lines: Iterable[Whine]
) -> NDArray[np.float64]:
    """Return how whine and rolling noise (both given as at the top speed, rad per sample) excite the housing."""
    speed = np.abs(np.gradient(angle))
    share = speed / top_speed
    source = rolling * share
    for line in lines:
        audible = np.clip(2 - line.order * speed / (0.45 * np.pi), 0, 1)
        source += line.amplitude * share * audible * np.cos(line.order * angle + line.phase)
    return source


def of_bearing(
    rng: np.random.Generator, microphone: Microphone, motor_angle: NDArray[np.float64], order: float
) -> NDArray[np.float64]:
    """Return the sound of impacts `order` times per turn of the motor, with 1 % slip and louder at speed.

    Its rms is 1.
    """
    angle = fine_angle(motor_angle)
    samples = len(angle)
    speed = np.abs(np.gradient(angle)) * SOUND_RATE_HZ
    travelled = np.cumsum(speed) / SOUND_RATE_HZ * order / (2 * np.pi)
    events = int(travelled[-1])
    moments = np.interp(np.cumsum(1 + 0.01 * rng.standard_normal(events)), travelled, np.arange(samples))
    moments = moments[moments < samples - 2]
    whole = moments.astype(int)
    strength = (1 + 0.25 * rng.standard_normal(len(whole))) * speed[whole] / (np.max(speed) + 1e-12)
    excitation = np.zeros(samples)
    np.add.at(excitation, whole, strength * (1 - (moments - whole)))
    np.add.at(excitation, whole + 1, strength * (moments - whole))
    heard = through_housing(microphone, excitation)
    return heard / np.std(heard)


def background(rng: np.random.Generator, microphone: Microphone, samples: int) -> NDArray[np.float64]:
    """Return the workshop's noise of unit rms: coloured, a fan's line, and slowly changing."""
    time = np.arange(samples) / SOUND_RATE_HZ
    noise = 0.7 * coloured(rng, samples, microphone.noise_corner_hz, SOUND_RATE_HZ)
    noise += 0.5 * rng.standard_normal(samples)
    noise *= 1 + 0.3 * np.sin(2 * np.pi * time / rng.uniform(8, 20) + rng.uniform(0, 2 * np.pi))
    noise += microphone.fan * np.sin(2 * np.pi * microphone.fan_hz * time + rng.uniform(0, 2 * np.pi))
    return noise / np.std(noise)


def hum(frequency: float, samples: int, rate_hz: float, phases: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a mains hum of unit rms: the line frequency with its second and third harmonic."""
    time = np.arange(samples) / rate_hz
    parts = (1.0, 0.35, 0.2)
    wave = sum(
        part * np.sin(2 * np.pi * (k + 1) * frequency * time + phase)
        for k, (part, phase) in enumerate(zip(parts, phases, strict=True))
    )
    return wave / np.sqrt(0.5 * sum(part**2 for part in parts))
