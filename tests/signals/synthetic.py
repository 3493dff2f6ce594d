"""A sound of a robot joint made from what is known of it, independent of the analysis under test.

Noise through housing resonances, loud as the joint is fast; trapezoidal motion back and forth; a notch adds a
short ring at one position in one direction, play one at every torque reversal.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from signals.recording import Recording

RATE_HZ = 8000.0
SILENT_S, KNOCK_S = 3.0, 12.0


@dataclass(frozen=True)
class Joint:
    """What the sound is made of; times [s], frequencies [Hz], ring heights relative to the low noise [1]."""

    label: str = "normal"
    seed: int = 0
    duration_s: float = 20.0
    stroke_s: float = 3.1
    braking_s: float = 0.35
    start_s: float = 0.9
    ring_hz: float = 55.0
    ring: float = 8.0
    noise: float = 0.0
    notch_phase: float = 0.35

    @property
    def reversals_s(self) -> NDArray[np.float64]:
        """Standstills, from before the start of the record to after its end."""
        count = int(self.duration_s / self.stroke_s) + 3
        return self.start_s + self.stroke_s * np.arange(-1, count)


def sound(joint: Joint) -> NDArray[np.float32]:
    """Return samples, shape (duration * 8000,)."""
    rng = np.random.default_rng(joint.seed)
    n = int(joint.duration_s * RATE_HZ)
    time = np.arange(n) / RATE_HZ
    since = (time - joint.start_s) % joint.stroke_s
    away = np.minimum(since, joint.stroke_s - since)
    speed = np.clip(away / joint.braking_s, 0.0, 1.0)
    body = np.zeros(n)
    for frequency, width in zip(rng.uniform([250, 700, 1400], [450, 1100, 2600]), (30, 60, 150), strict=True):
        b, a = signal.iirpeak(frequency, frequency / width, fs=RATE_HZ)
        body += signal.lfilter(b, a, rng.normal(size=n))
    low = signal.sosfilt(signal.butter(2, 200, fs=RATE_HZ, output="sos"), rng.normal(size=n))
    low /= low.std()
    level = 0.02 + 0.98 * speed
    samples = body / body.std() * level + 0.15 * low * (0.4 + 0.6 * speed)
    samples += 0.15 * joint.ring * rings(joint, time)
    samples += joint.noise * samples.std() * rng.normal(size=n)
    return (0.1 * samples / samples.std()).astype(np.float32)


def ring_times_s(joint: Joint) -> NDArray[np.float64]:
    """Return when the fault rings; empty for a normal joint."""
    if joint.label == "play":
        return np.sort(np.concatenate([joint.reversals_s - joint.braking_s, joint.reversals_s + 0.1]))
    if joint.label == "notch":
        return joint.reversals_s[::2] + (0.3 + 0.4 * joint.notch_phase) * joint.stroke_s
    return np.empty(0)


def rings(joint: Joint, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rings of the fault: decaying sines of 25 ms."""
    total = np.zeros_like(time)
    for start in ring_times_s(joint):
        since = np.maximum(time - start, 0.0)
        total += (time >= start) * np.exp(-since / 0.025) * np.sin(2 * np.pi * joint.ring_hz * since)
    return total


def disturbed(seed: int = 1, label: str = "normal") -> Recording:
    """Three seconds of silence, then a joint that moves, with one knock at the microphone at 12 s."""
    samples = np.concatenate([np.zeros(round(SILENT_S * RATE_HZ)), sound(Joint(label, seed))])
    time = np.arange(round(0.2 * RATE_HZ)) / RATE_HZ
    knock = 12 * samples.std() * np.exp(-time / 0.02) * np.sin(2 * np.pi * 90 * time)
    start = round(KNOCK_S * RATE_HZ)
    samples[start : start + time.size] += knock
    return Recording((0.5 * samples / np.abs(samples).max()).astype(np.float32), RATE_HZ)
