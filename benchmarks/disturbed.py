"""What people do to recordings in the field, made here of good ones; independent of what the product learns from.

Every function takes the samples of a good recording, shape (n,), its rate [Hz] and a source of chance.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

Samples = NDArray[np.float64]
Change = Callable[[Samples, float, np.random.Generator], Samples]
STEP = 2.0**-15
"""The resolution of 16 bits."""


def rms(samples: Samples) -> float:
    return float(np.sqrt(np.mean(samples**2)))


def standstill(samples: Samples, rate_hz: float) -> int:
    """Return the sample about which the axis stands, the quietest of the middle third."""
    level = ndimage.uniform_filter1d(samples**2, round(0.1 * rate_hz))
    third = samples.size // 3
    return third + int(np.argmin(level[third : 2 * third]))


def stops(samples: Samples, rate_hz: float) -> list[int]:
    """Return the samples about which the axis stands."""
    fast = samples - signal.sosfiltfilt(signal.butter(4, 200, fs=rate_hz, output="sos"), samples)
    level = np.sqrt(ndimage.uniform_filter1d(fast**2, round(0.15 * rate_hz)))
    places, _ = signal.find_peaks(-level, height=-0.6 * float(np.median(level)), distance=round(1.5 * rate_hz))
    return [int(place) for place in places]


def hush(seconds: float, rate_hz: float, level: float, rng: np.random.Generator) -> Samples:
    """Return noise of this effective value, whole steps of the recorder."""
    noise = level * rng.normal(size=round(seconds * rate_hz))
    return np.asarray(np.round(noise / STEP) * STEP)


def lead(seconds: float, level_db: float, *, where: str = "start") -> Change:
    """Record for some seconds before or after the motion, at a level against the sound of it [dB]."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        still = hush(seconds, rate_hz, 10 ** (level_db / 20) * rms(samples), rng)
        parts = {"start": [still, samples], "end": [samples, still], "both": [still, samples, still]}
        return np.concatenate(parts[where])

    return change


def lead_with_button(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Press the button of the recorder, then start the robot."""
    still = hush(2.0, rate_hz, 0.002 * rms(samples), rng)
    add(still, round(0.1 * rate_hz), 4 * rms(samples) * thump(rate_hz, 900.0, 0.01))
    return np.concatenate([still, samples])


def pause(seconds: float) -> Change:
    """Let the robot wait at a standstill."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        place = standstill(samples, rate_hz)
        around = samples[place - 200 : place + 200]
        return np.concatenate([samples[:place], hush(seconds, rate_hz, rms(around), rng), samples[place:]])

    return change


def thump(rate_hz: float, frequency_hz: float, decay_s: float) -> Samples:
    """Return a blow of height 1."""
    time = np.arange(round(8 * decay_s * rate_hz)) / rate_hz
    return np.asarray(np.sin(2 * np.pi * frequency_hz * time) * np.exp(-time / decay_s))


def add(samples: Samples, place: int, what: Samples) -> None:
    part = samples[place : place + what.size]
    part += what[: part.size]


def thumps(count: int, frequency_hz: float, height: float, decay_s: float = 0.03) -> Change:
    """Touch the microphone so often, at any time."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        touched = samples.copy()
        for place in rng.integers(0, samples.size, count):
            blow = thump(rate_hz, frequency_hz * rng.uniform(0.8, 1.25), decay_s)
            add(touched, int(place), height * rms(samples) * blow)
        return touched

    return change


def brake(frequency_hz: float, every: int) -> Change:
    """Let the brake click at every standstill, or at every second one."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        clicked = samples.copy()
        for place in stops(samples, rate_hz)[::every]:
            height = rms(samples) * rng.uniform(3, 5)
            add(clicked, place, height * thump(rate_hz, frequency_hz, 0.012))
        return clicked

    return change


def strikes(every_s: float, height: float) -> Change:
    """Let a press work beside it."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        struck = samples.copy()
        for time_s in np.arange(0.4, samples.size / rate_hz, every_s):
            blow = thump(rate_hz, 80.0, 0.05) + 0.3 * rng.normal(size=round(0.4 * rate_hz)) * np.exp(
                -np.arange(round(0.4 * rate_hz)) / rate_hz / 0.03
            )
            add(struck, round(time_s * rate_hz), height * rms(samples) * blow)
        return struck

    return change


def talk(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Return vowels of a deep voice with consonants between, as long as the samples, effective value 1."""
    spoken = np.zeros(samples.size)
    place = 0
    while place < samples.size:
        size = round(rng.uniform(0.08, 0.3) * rate_hz)
        time = np.arange(size) / rate_hz
        pitch, formant = rng.uniform(90, 160), rng.uniform(300, 1200)
        vowel = sum(
            np.exp(-(((k * pitch - formant) / 300) ** 2)) * np.sin(2 * np.pi * k * pitch * time)
            for k in range(1, int(3500 / pitch))
        ) + 0.4 * np.sin(2 * np.pi * pitch * time)
        add(spoken, place, np.asarray(vowel) * np.hanning(size))
        add(spoken, place + size, 0.1 * rng.normal(size=round(0.05 * rate_hz)))
        place += size + round((rng.uniform(0.5, 1.2) if rng.random() < 0.2 else 0.07) * rate_hz)
    return spoken / rms(spoken)


def talked(level_db: float) -> Change:
    """Talk beside it."""
    return lambda samples, rate_hz, rng: samples + 10 ** (level_db / 20) * rms(samples) * talk(samples, rate_hz, rng)


def chords(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Return music of as many samples, effective value 1."""
    size = round(0.5 * rate_hz)
    time = np.arange(size) / rate_hz
    notes = []
    for _ in range(samples.size // size + 1):
        base = 110.0 * 2 ** (rng.integers(0, 12) / 12)
        notes.append(
            sum(np.sin(2 * np.pi * base * step * time) * np.exp(-3 * time) / step for step in (1, 1.25, 1.5, 2, 3))
        )
    played = np.concatenate(notes)[: samples.size]
    return np.asarray(played / rms(played))


def with_music(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Let the radio play, as loud as the machine."""
    return samples + rms(samples) * chords(samples, rate_hz, rng)


def coloured(size: int, slope: float, rng: np.random.Generator) -> Samples:
    """Return noise of effective value 1 whose power falls with this power of the frequency."""
    spectrum = np.fft.rfft(rng.normal(size=size)) * np.maximum(np.arange(size // 2 + 1), size / 800.0) ** (-slope / 2)
    noise = np.fft.irfft(spectrum, size)
    return np.asarray(noise / rms(noise))


def gusts(height: float) -> Change:
    """Let the wind blow into the microphone, three times."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        blown, size = samples.copy(), round(2.5 * rate_hz)
        for place in rng.integers(0, samples.size - size, 3):
            add(blown, int(place), height * rms(samples) * np.hanning(size) * coloured(size, 3.0, rng))
        return blown

    return change


def hall(level_db: float) -> Change:
    """Record in a hall whose noise has this level against the machine [dB]."""
    return lambda samples, rate_hz, rng: (
        samples + 10 ** (level_db / 20) * rms(samples) * coloured(samples.size, 1.0, rng)
    )


def speech_recorder(release_s: float) -> Change:
    """Record with an automatic gain that makes everything as loud, turned up so slowly and down at once."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        block = round(0.005 * rate_hz)
        blocks = samples[: samples.size // block * block].reshape(-1, block)
        level = np.sqrt((blocks**2).mean(axis=1))
        gain, current = np.empty(level.size), 1 / float(np.median(level))
        most = 40 / rms(samples)
        for index, value in enumerate(level):
            wanted = min(1 / max(value, 1e-9), most)
            fall, rise = 0.3, 1 - np.exp(-0.005 / release_s)
            current += (fall if wanted < current else rise) * (wanted - current)
            gain[index] = current
        louder = samples[: level.size * block] * np.repeat(gain, block)
        return np.asarray(0.1 * louder / rms(louder))

    return change


def telephone(cut_hz: float) -> Change:
    """Record with what takes the low band."""
    return lambda samples, rate_hz, rng: np.asarray(
        signal.sosfilt(signal.butter(4, cut_hz, "highpass", fs=rate_hz, output="sos"), samples)
    )


def cut(start_s: float, seconds: float) -> Change:
    """Keep a piece."""
    return lambda samples, rate_hz, rng: samples[round(start_s * rate_hz) : round((start_s + seconds) * rate_hz)]


def two_channels(other: str, *, dead: int) -> Change:
    """Record with one of two microphones; the other is dead. Return shape (n, 2)."""

    def change(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
        time = np.arange(samples.size) / rate_hz
        silent = {
            "zeros": np.zeros(samples.size),
            "hum": 0.05 * rms(samples) * (np.sin(314.16 * time) + 0.3 * np.sin(942.5 * time)),
            "hiss": hush(samples.size / rate_hz, rate_hz, 3 * STEP, rng),
        }[other]
        return np.stack([silent, samples] if dead == 0 else [samples, silent], axis=1)

    return change


def turned(gain: float) -> Change:
    """Turn the gain, or the polarity."""
    return lambda samples, rate_hz, rng: gain * samples


def holes(samples: Samples, rate_hz: float, rng: np.random.Generator) -> Samples:
    """Lose 20 ms ten times."""
    torn = samples.copy()
    for place in rng.integers(0, samples.size - 160, 10):
        torn[place : place + round(0.02 * rate_hz)] = 0.0
    return torn


HARMLESS: dict[str, Change] = {
    "as recorded": turned(1.0),
    "quieter, turned over": turned(-0.2),
    "0.2 s of zeros before": lead(0.2, -300),
    "1 s of zeros before": lead(1.0, -300),
    "5 s at -60 dB before": lead(5.0, -60),
    "3 s at -35 dB before": lead(3.0, -35),
    "8 s at -25 dB before": lead(8.0, -25),
    "0.5 s of zeros after": lead(0.5, -300, where="end"),
    "10 s of zeros after": lead(10.0, -300, where="end"),
    "4 s at -30 dB before and after": lead(4.0, -30, where="both"),
    "a button, then 2 s before": lead_with_button,
    "dead first channel, zeros": two_channels("zeros", dead=0),
    "dead second channel, hum": two_channels("hum", dead=1),
    "dead first channel, hiss": two_channels("hiss", dead=0),
}
"""What changes nothing of the machine: the label stays, and is as sure."""
SILENT = {
    "1 s of zeros before": (0.0, 1.0),
    "5 s at -60 dB before": (0.0, 5.0),
    "3 s at -35 dB before": (0.0, 3.0),
    "8 s at -25 dB before": (0.0, 8.0),
    "10 s of zeros after": (20.0, 30.0),
}
"""Where it is silent in those that are [s]."""
DISTURBED: dict[str, Change] = {
    "pause of 3 s": pause(3.0),
    "pause of 15 s": pause(15.0),
    "one deep knock": thumps(1, 60.0, 12.0),
    "one bright knock": thumps(1, 1500.0, 8.0),
    "seven knocks": thumps(7, 90.0, 8.0),
    "brake at every stop": brake(150.0, 1),
    "bright brake at every stop": brake(1200.0, 1),
    "brake at every second stop": brake(90.0, 2),
    "press every 1.37 s": strikes(1.37, 5.0),
    "press every 0.9 s, faint": strikes(0.9, 1.0),
    "talk, as loud": talked(0.0),
    "talk, 12 dB below": talked(-12.0),
    "music, as loud": with_music,
    "gusts": gusts(4.0),
    "faint gusts": gusts(0.7),
    "hall 6 dB below": hall(-6.0),
    "hall 6 dB above": hall(6.0),
    "holes": holes,
    "9 s": cut(4.0, 9.0),
}
"""What may hide or pretend a fault: the true label, or doubt."""
NEVER_SURE: dict[str, tuple[Change, str]] = {
    "slow automatic gain": (speech_recorder(1.5), "automatic_gain"),
    "automatic gain": (speech_recorder(0.5), "automatic_gain"),
    "nothing below 200 Hz": (telephone(200.0), "low_band_missing"),
    "nothing below 300 Hz": (telephone(300.0), "low_band_missing"),
}
"""What takes the truth away, and how it is to be named."""
SHORT: dict[str, Change] = {
    "2 s of the way": cut(3.0, 2.0),
    "3.5 s": cut(0.0, 3.5),
    "5 s": cut(8.0, 5.0),
}
"""Less than a cycle."""


def foreign(kind: str, seconds: float, rate_hz: float) -> Samples:
    """Return a sound that no gearbox makes."""
    rng = np.random.default_rng(len(kind))
    blank = np.zeros(round(seconds * rate_hz))
    time = np.arange(blank.size) / rate_hz
    made: dict[str, Callable[[], Samples]] = {
        "talk": lambda: talk(blank, rate_hz, rng),
        "music": lambda: chords(blank, rate_hz, rng),
        "white noise": lambda: rng.normal(size=blank.size),
        "surf": lambda: coloured(blank.size, 1.0, rng) * (1.1 + np.sin(2 * np.pi * time / 7)),
        "hum": lambda: np.sin(314.16 * time) + 0.01 * rng.normal(size=blank.size),
        "metronome": lambda: strikes(1.0, 1.0)(0.01 * rng.normal(size=blank.size), rate_hz, rng),
        "siren": lambda: np.sin(2 * np.pi * np.cumsum(800 + 300 * np.sin(2 * np.pi * time / 4)) / rate_hz),
        "vacuum cleaner back and forth": lambda: (
            (coloured(blank.size, 0.5, rng) + 0.5 * np.sin(2 * np.pi * 310 * time))
            * (0.3 + np.abs(np.sin(np.pi * time / 2.5)))
        ),
    }
    sound = made[kind]()
    return np.asarray(0.1 * sound / rms(sound))


FOREIGN = ("talk", "music", "white noise", "surf", "hum", "metronome", "siren", "vacuum cleaner back and forth")
