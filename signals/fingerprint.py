"""A fingerprint of what is heard, which container, sample rate, gain and coding leave as it is.

Bits are signs of how the energy of neighbouring bands changes from frame to frame. What recordings of one motion have
in common, such as the spectrum of the place and how loud it is when, drops out of these differences; the fine structure
of the noise, which no second recording has, stays. Where there is little noise the tones of the meshes make the bits,
and every recording of that motion has those. So equal bits only say which recordings are held against each other: of
one sound, the phases agree at most frequencies, and at more of them than in both halves of one recording, which have
all in common that the machine repeats, and no noise.

Sources: Haitsma and Kalker, A Highly Robust Audio Fingerprinting System, ISMIR 2002; Knapp and Carter, The generalized
correlation method for estimation of time delay, IEEE Trans. ASSP 24 (1976), for the phase transform.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from signals.recording import Recording

Words = NDArray[np.uint32]

RATE_HZ = 8000.0
WINDOW, HOP = 2048, 256
PHASES = (0, 128)
"""Samples by which what is looked for may begin elsewhere in a hop than what is known."""
BITS = 24
LOWEST_HZ, HIGHEST_HZ = 250.0, 3000.0
LONGEST_S = 120.0
"""Of a longer recording, so much of its beginning counts."""
KEYS = 32
"""A sound is looked up by so many of its words: those whose weakest bit is the surest."""
FLOOR = 1e-9
"""Of the strongest frame's power; what is weaker is silence."""
SILENT = 0.02
"""A frame with no difference larger than this (of logarithms of energy) says nothing."""
FEWEST_FRAMES = 16
LARGEST_DIFFERENCE = 0.3
"""Of all bits. Copies differ by up to 0.12 (MP3, 16 bit at -34 dB, another beginning); other recordings of the same
gearbox and motion by 0.45 and more where noise is as loud as the tones, by 0.2 and more where it is 60 dB below."""
SHARED_LENGTH = 0.5
"""The same sound shares at least so much of the longer recording."""
PLACES = 16
AGREEMENT = (0.5, 0.95)
"""Copies agree by more than both halves of the recording do, that taken as no less and no more than this [1]: MP3
of tones 20 dB above the noise by 0.8, halves by 0.65 at most. What repeats entirely agrees by 1, as its copies do."""
FINER = 2
"""Places between two samples, plus one, where recordings are laid over each other."""


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """Words of BITS bits, one for every HOP samples at RATE_HZ; zero where nothing is heard.

    Args:
        words: shape (frames,).
        keys: words by which it is looked up, at most KEYS.
    """

    words: Words
    keys: tuple[int, ...]


def fingerprints(recording: Recording) -> tuple[Fingerprint, ...]:
    """Return the fingerprint to keep, and the others to look for besides it: of the same sound, begun within a hop.

    Nothing for a recording that is too short, sampled below 8 kHz, silent, or so steady that it has no fine structure.
    """
    if recording.sample_rate_hz < RATE_HZ:
        return ()
    heard = _heard(recording)
    found = [_fingerprint(heard[phase:]) for phase in PHASES]
    return tuple(each for each in found if each is not None) if found[0] is not None else ()


def difference(one: Words, other: Words) -> float:
    """Return the smallest share of bits that differ [1], at the places where most words are equal; 1 if nowhere."""
    least = max(FEWEST_FRAMES, SHARED_LENGTH * max(np.count_nonzero(one), np.count_nonzero(other)))
    return min((_difference_at(one, other, place, least) for place in _places(one, other)), default=1.0)


def same_samples(one: Recording, other: Recording) -> bool:
    """Return whether two recordings have more in common than the machine that both are of."""
    here, there = _heard(one), _heard(other)
    low, high = AGREEMENT
    return agreement(here, there) > min(high, max(low, agreement(*np.array_split(here, 2))))


def agreement(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return at how many frequencies of what two sounds share the phases agree [1]: 1 of copies, 0 of strangers.

    Args:
        one, other: at RATE_HZ, shapes (n,) and (m,); they share half of the longer one or more.
    """
    _, ahead = _phases(one, other, max(one.size, other.size) // 2)
    here, there = one[max(0, ahead) :], other[max(0, -ahead) :]
    size = min(here.size, there.size)
    window = np.hanning(size).astype(np.float32)
    return _phases(here[:size] * window, there[:size] * window, 1)[0]


def _phases(one: NDArray[np.float32], other: NDArray[np.float32], reach: int) -> tuple[float, int]:
    """Return how much phases agree where they do most, and by how many samples the first is ahead there."""
    from scipy.fft import irfft, next_fast_len, rfft  # slow to import; unlike NumPy's they stay in float32

    size = next_fast_len(one.size + other.size, real=True)
    cross = rfft(one, size) * rfft(other, size).conj()
    low, high = (round(hertz * size / RATE_HZ) for hertz in (LOWEST_HZ, HIGHEST_HZ))
    turned = np.zeros_like(cross)
    turned[low:high] = cross[low:high] / np.maximum(np.abs(cross[low:high]), np.float32(1e-30))
    found = np.abs(irfft(turned, FINER * size)) * (FINER * size / (2 * (high - low)))
    found[FINER * reach + 1 : -FINER * reach] = 0.0
    place = int(found.argmax())
    return float(found[place]), round((place if place <= FINER * reach else place - FINER * size) / FINER)


def _heard(recording: Recording) -> NDArray[np.float32]:
    samples = recording.samples[: round(LONGEST_S * recording.sample_rate_hz)]
    return Recording(samples, recording.sample_rate_hz).resampled(RATE_HZ).samples


def _difference_at(one: Words, other: Words, place: int, least: float) -> float:
    here, there = one[max(0, place) :], other[max(0, -place) :]
    size = min(here.size, there.size)
    here, there = here[:size], there[:size]
    heard = (here != 0) & (there != 0)
    count = int(np.count_nonzero(heard))
    if count < least:
        return 1.0
    return float(np.bitwise_count(here[heard] ^ there[heard]).sum()) / (BITS * count)


def _places(one: Words, other: Words) -> list[int]:
    """Return by how many frames the first is ahead of the second where words are equal, the commonest first."""
    words, here, there = np.intersect1d(one, other, return_indices=True)
    ahead = Counter((here - there)[words != 0].tolist())
    return [place for place, _ in ahead.most_common(PLACES)]


def _fingerprint(samples: NDArray[np.float32]) -> Fingerprint | None:
    if samples.size < WINDOW + FEWEST_FRAMES * HOP:
        return None
    changes = _changes(samples)
    sizes = np.abs(changes)
    words = np.where(sizes.max(axis=1) > SILENT, (changes > 0) @ (1 << np.arange(BITS, dtype=np.int64)), 0)
    if np.count_nonzero(words) < FEWEST_FRAMES:
        return None
    surest = np.argsort(np.where(words == 0, -1.0, sizes.min(axis=1)))[::-1][:KEYS]
    keys = {int(word) for word in words[surest] if word}
    return Fingerprint(words.astype(np.uint32), tuple(sorted(keys)))


def _changes(samples: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return how the logarithm of the energy of neighbouring bands changes against each other, (frames, BITS)."""
    window, edges = _window_and_edges()
    frames = np.lib.stride_tricks.sliding_window_view(samples, WINDOW)[::HOP]
    from scipy.fft import rfft  # slow to import; unlike NumPy's it stays in float32

    spectrum = rfft(frames * window, axis=1)
    power = spectrum.real**2 + spectrum.imag**2
    floor = np.float32(FLOOR) * power.sum(axis=1).max() + np.float32(1e-37)
    energy = np.log(np.add.reduceat(power[:, : edges[-1]], edges[:-1], axis=1) + floor)
    return np.asarray(np.diff(np.diff(energy, axis=1), axis=0), dtype=np.float32)


@cache
def _window_and_edges() -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    window = (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(WINDOW) / WINDOW)).astype(np.float32)
    edges = np.round(np.geomspace(LOWEST_HZ, HIGHEST_HZ, BITS + 2) * WINDOW / RATE_HZ).astype(np.intp)
    return window, edges
