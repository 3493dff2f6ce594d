"""Building blocks: noises, filters, events in time, voices. Every sound is an array of shape (n,) with no unit."""

import shutil
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO

import numpy as np
import soundfile as sf
from numpy.typing import NDArray
from scipy import signal

Floats = NDArray[np.float64]
Rng = np.random.Generator


@dataclass(frozen=True)
class Sound:
    """What becomes a file: samples of shape (n,) or (n, channels), rate in Hz, and how it is written.

    `standstills` are the times in s, begin and end, in which the machine stands; `period_s` is one full cycle of it.
    """

    samples: Floats
    rate: int
    subtype: str = "PCM_16"
    suffix: str = ".wav"
    standstills: tuple[tuple[float, float], ...] = ()
    period_s: float = 0.0


def coloured(rng: Rng, n: int, slope: float) -> Floats:
    """Return noise of n samples whose power falls with f**-slope (0 white, 1 pink, 2 brown), rms 1."""
    size = max(n, 2)
    spectrum = np.fft.rfft(rng.standard_normal(size))
    k = np.maximum(np.arange(spectrum.size), size / 4000.0)
    spectrum *= k ** (-slope / 2)
    spectrum[0] = 0.0
    x = np.fft.irfft(spectrum, size)[:n]
    return np.asarray(x / (np.sqrt(np.mean(x**2)) + 1e-12))


def band(x: Floats, rate: int, low_hz: float, high_hz: float, order: int = 2) -> Floats:
    """Return x between two frequencies; a limit of 0, or one beyond what the rate holds, is no limit."""
    nyquist = rate / 2
    if low_hz <= 0 and high_hz >= 0.95 * nyquist:
        return x
    if low_hz <= 0:
        sos = signal.butter(order, high_hz / nyquist, "lowpass", output="sos")
    elif high_hz >= 0.95 * nyquist:
        sos = signal.butter(order, min(low_hz / nyquist, 0.9), "highpass", output="sos")
    else:
        sos = signal.butter(order, (low_hz / nyquist, high_hz / nyquist), "bandpass", output="sos")
    return np.asarray(signal.sosfilt(sos, x))


def rms(x: Floats) -> float:
    """Return the root mean square, never 0."""
    return float(np.sqrt(np.mean(np.square(x)))) + 1e-12


def at_level(x: Floats, level: float) -> Floats:
    """Return x with the rms `level`."""
    return x * (level / rms(x))


def envelope(x: Floats, rate: int, seconds: float) -> Floats:
    """Return the running rms of x over a window of so many seconds, same shape."""
    n = max(int(seconds * rate), 1)
    power = np.cumsum(np.concatenate((np.zeros(1), x**2)))
    low = np.clip(np.arange(x.size) - n // 2, 0, x.size)
    high = np.clip(np.arange(x.size) + n - n // 2, 0, x.size)
    return np.asarray(np.sqrt(np.maximum(power[high] - power[low], 0.0) / np.maximum(high - low, 1)))


def put(y: Floats, rate: int, at_s: float | np.floating, what: NDArray[np.floating]) -> None:
    """Add `what` to y from a time on; what is outside of y is left away."""
    start = round(float(at_s) * rate)
    begin, end = max(start, 0), min(start + what.size, y.size)
    if end > begin:
        y[begin:end] += what[begin - start : end - start]


def ring(rate: int, modes: Iterable[tuple[float, float, float]], seconds: float) -> Floats:
    """Return decaying tones; a mode is frequency in Hz, time constant in s and amplitude."""
    t = np.arange(int(seconds * rate)) / rate
    y = np.zeros(t.size)
    for f, tau, a in modes:
        if f < 0.48 * rate:
            y += a * np.exp(-t / tau) * np.sin(2 * np.pi * f * t)
    return y


def burst(rng: Rng, rate: int, low_hz: float, high_hz: float, tau_s: float, attack_s: float = 0.002) -> Floats:
    """Return a burst of noise in a band with peak 1, rising in `attack_s` and falling with `tau_s`."""
    n = max(int((6 * tau_s + attack_s) * rate), 16)
    t = np.arange(n) / rate
    y = band(rng.standard_normal(n), rate, low_hz, high_hz) * np.minimum(t / attack_s, 1.0) * np.exp(-t / tau_s)
    return np.asarray(y / (np.max(np.abs(y)) + 1e-12))


def sweep(frequency_hz: Floats, rate: int) -> Floats:
    """Return a tone of amplitude 1 that follows a frequency of shape (n,)."""
    return np.asarray(np.sin(2 * np.pi * np.cumsum(frequency_hz) / rate))


def harmonics(frequency_hz: Floats, rate: int, amplitudes: Iterable[float]) -> Floats:
    """Return a sum of harmonics of a frequency of shape (n,); those beyond half the rate are left away."""
    phase = 2 * np.pi * np.cumsum(frequency_hz) / rate
    top = float(np.max(frequency_hz))
    y = np.zeros(frequency_hz.size)
    for k, a in enumerate(amplitudes, start=1):
        if k * top < 0.48 * rate:
            y += a * np.sin(k * phase)
    return y


def wander(rng: Rng, n: int, rate: int, seconds: float) -> Floats:
    """Return a slow random course of shape (n,), standard deviation about 1, that turns in about so many seconds."""
    knots = max(int(n / rate / seconds) + 4, 5)
    at = np.linspace(0, knots - 3, n)
    return np.asarray(np.interp(at, np.arange(knots), rng.standard_normal(knots)))


def beats(rng: Rng, seconds: float, interval_s: float, jitter: float = 0.0) -> Floats:
    """Return times in s that follow each other at an interval, each off by a part of it."""
    at = rng.uniform(0, interval_s) + interval_s * np.arange(int(seconds / interval_s) + 1)
    at = at + jitter * interval_s * rng.standard_normal(at.size)
    return np.asarray(at[(at >= 0) & (at < seconds)])


def reverberated(x: Floats, rate: int, rng: Rng, rt60_s: float, direct_to_room_db: float) -> Floats:
    """Return x in a room: itself and a diffuse tail of that decay time and level, same shape."""
    n = int(rt60_s * rate) + 1
    tail = rng.standard_normal(n) * 10 ** (-3 * np.arange(n) / n)
    tail[: int(0.004 * rate)] = 0.0
    tail *= 10 ** (-direct_to_room_db / 20) / (np.sqrt(np.sum(tail**2)) + 1e-12)
    tail[0] = 1.0
    return np.asarray(signal.fftconvolve(x, tail)[: x.size])


WORDS = (
    "the axis is moving back and forth, please wait",
    "can you hear me over there, I think it is the second motor",
    "one two three four five six seven eight nine ten",
    "hand me the wrench, then we open the cover",
    "this recording was made in hall seven on a monday morning",
    "der Roboter faehrt gleich wieder an, Vorsicht bitte",
    "good morning everybody, coffee is ready in the kitchen",
    "left a little, right a little, stop, that is good",
    "we measured it yesterday and it sounded much louder",
    "attention please, the train to the north leaves from platform two",
)
VOICES = ("en", "en-us", "de", "fr", "es", "it", "sv", "nl", "pl", "pt")


def espeak(text: str, voice: str, words_per_minute: int, pitch: int) -> tuple[Floats, int] | None:
    """Return speech and its rate, or None where espeak-ng is not installed or has no such voice."""
    if shutil.which("espeak-ng") is None:
        return None
    command = ["espeak-ng", "--stdout", "-v", voice, "-s", str(words_per_minute), "-p", str(pitch), text]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode != 0 or len(done.stdout) < 1000:
        return None
    samples, rate = sf.read(BytesIO(done.stdout), dtype="float64")
    return np.asarray(samples), int(rate)


def formant_voice(rng: Rng, rate: int, seconds: float) -> Floats:
    """Return syllables of a synthetic voice: a glottal pulse train or breath through three changing formants."""
    y = np.zeros(int(seconds * rate))
    vowels = ((730, 1090, 2440), (270, 2290, 3010), (300, 870, 2240), (530, 1840, 2480), (570, 840, 2410))
    base, at = rng.uniform(90, 220), rng.uniform(0, 0.5)
    while at < seconds:
        n = int(rng.uniform(0.09, 0.28) * rate)
        pitch = base * (1 + 0.12 * np.linspace(rng.normal(), rng.normal(), n))
        source = signal.sawtooth(2 * np.pi * np.cumsum(pitch) / rate) + 0.05 * rng.standard_normal(n)
        if rng.random() < 0.25:
            source = 0.5 * rng.standard_normal(n)
        formants = vowels[rng.integers(len(vowels))]
        syllable = sum(
            (band(source, rate, 0.92 * f, 1.08 * f, 1) / (k + 1) for k, f in enumerate(formants) if f < 0.45 * rate),
            np.zeros(n),
        )
        put(y, rate, at, syllable * np.hanning(n))
        at += n / rate + (rng.uniform(0.3, 0.9) if rng.random() < 0.15 else rng.uniform(0.0, 0.06))
    return at_level(y, 1.0)


def speech(rng: Rng, rate: int, seconds: float) -> Floats:
    """Return somebody speaking for so many seconds, rms 1; a synthetic voice where espeak-ng is absent."""
    words = " . ".join(WORDS[i] for i in rng.permutation(len(WORDS))[:6])
    speed, pitch = int(rng.integers(110, 230)), int(rng.integers(15, 85))
    spoken = espeak(words, VOICES[rng.integers(len(VOICES))], speed, pitch)
    if spoken is None:
        return formant_voice(rng, rate, seconds)
    samples, own_rate = spoken
    n = int(seconds * rate)
    x = signal.resample(samples, int(samples.size * rate / own_rate))
    return at_level(np.asarray(np.resize(x, n)), 1.0)
