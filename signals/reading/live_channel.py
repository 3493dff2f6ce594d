"""Which of several channels carry the machine: a dead one has nothing of what the loudest one hears."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAINS_HZ = (50.0, 60.0)
LOWEST_HZ = 20.0
MOST_SPECTRA = 256
TINY = np.finfo(np.float64).tiny
QUIET_DB = 20.0
"""A channel this much quieter than the loudest is dead if it hears nothing of the same."""

FAINT_DB = 40.0
"""A channel this much quieter is dead, for what it hears is the crosstalk."""

SAME = 0.2
"""Least share of the power that a channel has in common with the loudest, if it hears the same machine."""


@dataclass(frozen=True)
class Channels:
    """What is heard on several channels.

    Args:
        dead: those that carry no machine, from 0.
        loudest: the one with most sound away from the lines of the mains.
        below_db: how far each one is below the loudest there [dB].
    """

    dead: tuple[int, ...]
    loudest: int
    below_db: tuple[float, ...]


def hear(samples: NDArray[np.float32], rate_hz: float) -> Channels:
    """Compare the channels of a recording, shape (frames, channels), two channels or more.

    Mains lines are left out, for a cable without a microphone picks up hum. Microphones that hear the same machine
    have much of their power in common (coherence), noise of recorders has not.
    """
    auto = np.asarray(sum(np.abs(each) ** 2 for each in _spectra(samples, rate_hz)))
    power = np.sum(auto, axis=0)
    loudest = int(power.argmax())
    if not power[loudest] > 0:
        return Channels((), 0, (0.0,) * samples.shape[1])
    cross = sum(each * each[:, loudest, None].conj() for each in _spectra(samples, rate_hz))
    common = np.abs(cross) ** 2 / np.maximum(auto[:, loudest, None], TINY)
    share = np.sum(common, axis=0) / np.maximum(power, TINY)
    below_db = 10 * np.log10(power[loudest] / np.maximum(power, power[loudest] * 1e-30))
    dead = (below_db >= FAINT_DB) | ((below_db >= QUIET_DB) & (share < SAME))
    return Channels(tuple(map(int, np.flatnonzero(dead))), loudest, tuple(map(float, below_db)))


def _spectra(samples: NDArray[np.float32], rate_hz: float) -> Iterator[NDArray[np.complex128]]:
    """Give the spectrum of one piece after another, shape (bins, channels), away from the lines of the mains."""
    frames, channels = samples.shape
    length = min(frames, 1 << int(np.log2(max(16.0, min(rate_hz, frames / 8)))))
    count = min(MOST_SPECTRA // channels, max(1, 2 * frames // length - 1))
    window = np.hanning(length)[:, None]
    frequency = np.fft.rfftfreq(length, 1 / rate_hz)
    audible = frequency > LOWEST_HZ
    clean = audible.copy()
    for line in MAINS_HZ:
        clean &= np.abs(frequency - line * np.round(frequency / line)) > max(3.0, 2.5 * rate_hz / length)
    wanted = clean if clean.any() else audible
    for start in np.linspace(0, frames - length, count).astype(int):
        piece = samples[start : start + length].astype(np.float64)
        yield np.fft.rfft(window * (piece - piece.mean(axis=0)), axis=0)[wanted]
