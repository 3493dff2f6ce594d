"""Recordings that say by themselves what they are: a hum with impacts that repeat, written as WAV."""

import io
import struct

import numpy as np
import soundfile
from numpy.typing import NDArray

RATE_HZ = 8000


def hum(seconds: float, seed: int, *, impacts: bool = False) -> NDArray[np.float32]:
    """Return noise below 200 Hz that follows a motion of 2 s, with one sharp impact per motion if asked for."""
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    carrier = sum(np.sin(2 * np.pi * f * time + random.uniform(0, 6.28)) for f in random.uniform(40, 180, 12))
    loud = 0.2 + np.abs(np.sin(np.pi * time / 1.0))
    samples = 0.01 * carrier * loud + 0.002 * random.normal(size=time.size)
    if impacts:
        for start in np.arange(0.4, seconds - 0.1, 2.0):
            ring = np.arange(round(0.05 * RATE_HZ)) / RATE_HZ
            first = round(start * RATE_HZ)
            samples[first : first + ring.size] += 0.5 * np.exp(-ring / 0.008) * np.sin(2 * np.pi * 150 * ring)
    return np.asarray(samples, dtype=np.float32)


def wav(samples: NDArray[np.float32], rate_hz: int = RATE_HZ) -> bytes:
    target = io.BytesIO()
    soundfile.write(target, samples, rate_hz, format="WAV", subtype="PCM_16")
    return target.getvalue()


def sound(seed: int, *, seconds: float = 6.0, impacts: bool = False) -> bytes:
    return wav(hum(seconds, seed, impacts=impacts))


def lying_wav(claimed: int) -> bytes:
    """Return 60 bytes whose header claims that this many follow."""
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 1, 1, RATE_HZ, 2 * RATE_HZ, 2, 16)
    return b"RIFF" + struct.pack("<I", claimed) + b"WAVE" + form + struct.pack("<4sI", b"data", claimed) + bytes(16)
