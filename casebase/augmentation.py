"""Augmentation: recordings of the library as people would have brought them, to learn how far an answer then holds.

Each copy is a recording of the library with one thing done to it that happens in the field, at a strength drawn from
what is usual. What was learned from the copies says how often the library is right of a recording as poor as they are.
"""

import hashlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from casebase.signals.recording import Recording

Samples = NDArray[np.float64]
PEAK = 0.7


def _noise(rng: np.random.Generator, size: int, rate_hz: float, slope: float) -> Samples:
    """Return noise of effective value 1 whose amplitude falls with the frequency to the power of the slope."""
    frequency = np.fft.rfftfreq(size, 1 / rate_hz)
    spectrum = np.fft.rfft(rng.normal(size=size)) / np.maximum(frequency, 20.0) ** slope
    noise: Samples = np.fft.irfft(spectrum, size)
    return np.asarray(noise / noise.std())


def _slow(rng: np.random.Generator, size: int, rate_hz: float, step_s: float) -> Samples:
    """Return a course between 0 and 1 that changes within some seconds."""
    seconds = size / rate_hz
    places = np.arange(0.0, seconds + 2 * step_s, step_s)
    return np.asarray(np.interp(np.arange(size) / rate_hz, places, rng.uniform(0, 1, places.size)))


def white_noise(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Add noise from 12 dB below the sound to 6 dB above."""
    return np.asarray(samples + samples.std() * 10 ** (rng.uniform(-12, 6) / 20) * rng.normal(size=samples.size))


def pink_noise(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Add the noise of a hall, from 15 dB below the sound to 6 dB above."""
    return np.asarray(
        samples + samples.std() * 10 ** (rng.uniform(-15, 6) / 20) * _noise(rng, samples.size, rate_hz, 0.5)
    )


def wind(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Add gusts: noise below 100 Hz that comes and goes."""
    gusts = _noise(rng, samples.size, rate_hz, 1.0) * _slow(rng, samples.size, rate_hz, rng.uniform(0.5, 2)) ** 2
    return np.asarray(samples + samples.std() * rng.uniform(0.5, 4) * gusts)


def knocks(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Knock at the microphone, once or often."""
    knocked = samples.copy()
    time = np.arange(int(0.3 * rate_hz)) / rate_hz
    for _ in range(int(rng.integers(1, 12))):
        ring = np.sin(2 * np.pi * rng.uniform(30, 400) * time) * np.exp(-time / rng.uniform(0.01, 0.06))
        start = int(rng.integers(0, samples.size))
        part = ring[: samples.size - start]
        knocked[start : start + part.size] += samples.std() * rng.uniform(2, 15) * part
    return knocked


def rhythm(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Let a press or a feeder strike beside it, in a rhythm of its own."""
    struck = samples.copy()
    time = np.arange(int(0.4 * rate_hz)) / rate_hz
    ring = np.sin(2 * np.pi * rng.uniform(40, 300) * time) + 0.5 * rng.normal(size=time.size)
    ring *= np.exp(-time / rng.uniform(0.02, 0.1))
    strength, every_s = samples.std() * rng.uniform(1, 8), rng.uniform(0.6, 3.5)
    for start_s in np.arange(rng.uniform(0, every_s), samples.size / rate_hz, every_s):
        start = int(start_s * rate_hz)
        part = ring[: samples.size - start]
        struck[start : start + part.size] += strength * part
    return struck


def voice(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Let somebody speak: harmonics of 80 to 250 Hz in syllables, with pauses."""
    size = samples.size
    pitch_hz = rng.uniform(80, 200) * (1 + 0.2 * _slow(rng, size, rate_hz, 0.3))
    phase = 2 * np.pi * np.cumsum(pitch_hz) / rate_hz
    colour = rng.uniform(0.3, 1, 16) / np.arange(1, 17) ** 0.7
    spoken = np.asarray(sum(part * np.sin((k + 1) * phase) for k, part in enumerate(colour)))
    spoken *= np.maximum(_slow(rng, size, rate_hz, 0.12) - 0.4, 0) * (_slow(rng, size, rate_hz, 1.0) > 0.35)
    return np.asarray(samples + samples.std() * rng.uniform(0.2, 2) * spoken / max(spoken.std(), 1e-12))


def automatic_gain(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Turn up what is quiet and down what is loud, as recorders for speech do."""
    block = max(1, round(0.01 * rate_hz))
    level = np.sqrt(ndimage.uniform_filter1d(samples**2, block)[::block]) + 1e-9
    follows, release = np.empty(level.size), np.exp(-0.01 / rng.uniform(0.2, 2))
    state = level[0]
    for index, value in enumerate(level):
        state = value if value > state else release * state + (1 - release) * value
        follows[index] = state
    gain = np.maximum(follows, 0.03 * follows.max()) ** -rng.uniform(0.4, 1)
    return np.asarray(samples * np.interp(np.arange(samples.size), np.arange(level.size) * block, gain))


def high_pass(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Filter as telephones do: nothing below 100 to 300 Hz."""
    sections = signal.butter(int(rng.integers(2, 5)), rng.uniform(100, 300), "highpass", fs=rate_hz, output="sos")
    return np.asarray(signal.sosfilt(sections, samples))


def piece(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Keep 2 to 10 seconds."""
    size = min(samples.size, int(rng.uniform(2, 10) * rate_hz))
    start = int(rng.integers(0, samples.size - size + 1))
    return samples[start : start + size]


def second_axis(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Let another axis of the kind move beside it, faster or slower, without its impacts in step."""
    stretch = rng.uniform(0.6, 0.95)
    places = np.arange(samples.size) * stretch + rng.uniform(0, samples.size)
    other = np.interp(places % samples.size, np.arange(samples.size), samples[::-1])
    return np.asarray(samples + rng.uniform(0.2, 1.2) * other)


AUGMENTATIONS: tuple[Callable[[Samples, float, np.random.Generator], Samples], ...] = (
    white_noise,
    pink_noise,
    wind,
    knocks,
    rhythm,
    voice,
    automatic_gain,
    high_pass,
    piece,
    second_axis,
)
"""The catalogue: a new one is a function above and a line here."""


def disturbed_copies(recording: Recording) -> list[Recording]:
    """Return one copy of a recording per augmentation; the same ones each time."""
    copies = []
    for augment in AUGMENTATIONS:
        seed = hashlib.sha256(f"{augment.__name__} {recording.sha256}".encode()).digest()[:8]
        rng = np.random.default_rng(int.from_bytes(seed, "big"))
        samples = augment(recording.samples.astype(np.float64), recording.sample_rate_hz, rng)
        highest = float(np.abs(samples).max())
        copies.append(replace(recording, samples=(PEAK / highest * samples if highest else samples).astype(np.float32)))
    return copies
