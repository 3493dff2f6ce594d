"""Sounds that are no gearbox of a robot: voices, music, animals, weather, household, traffic, machines.

A family is a pure function of a source of chance, a rate in Hz and a duration in s; it returns shape (n,), any level.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import soundfile as sf
from scipy import signal

from benchmarks.field_bank.sounds import (
    Floats,
    Rng,
    Sound,
    band,
    beats,
    burst,
    coloured,
    formant_voice,
    harmonics,
    put,
    reverberated,
    ring,
    rms,
    speech,
    sweep,
    wander,
)
from benchmarks.shared_data import SHARED

Make = Callable[[Rng, int, float], Floats]


@dataclass(frozen=True)
class Family:
    """One kind of foreign sound; each belongs to one half of the bank only."""

    make: Make
    half: str


FAMILIES: dict[str, Family] = {}


def family(half: str) -> Callable[[Make], Make]:
    """Enter a function into FAMILIES under its name."""

    def enter(make: Make) -> Make:
        FAMILIES[make.__name__] = Family(make, half)
        return make

    return enter


def foreign(half: str, count: int, seed: int) -> Iterator[tuple[str, Sound]]:
    """Yield `count` sounds with the names of their families, in turn; levels, rates and durations vary."""
    members = [(name, f.make) for name, f in FAMILIES.items() if f.half == half]
    machines = [partial(_measured, str(p)) for p in sorted((SHARED / "data" / REAL[half]).glob("*.wav"))]
    for i in range(count):
        rng = np.random.default_rng((seed, i))
        turn, place = divmod(i, len(members) + (1 if machines else 0))
        name, make = members[place] if place < len(members) else ("real_machine", machines[turn % len(machines)])
        rate = int(rng.choice((8000, 8000, 8000, 16000)))
        x = make(rng, rate, float(rng.uniform(9, 22)))
        if rng.random() < 0.5:
            x = x + coloured(rng, x.size, 1.0) * rms(x) * 10 ** rng.uniform(-2.5, -1)
        x = x - np.mean(x)
        level = min(10 ** rng.uniform(-2.2, -0.9) / rms(x), 0.95 / (float(np.max(np.abs(x))) + 1e-12))
        yield name, Sound(x * level, rate)


REAL = {"work": "spectraquest", "final": "seu"}


def _measured(path: str, rng: Rng, rate: int, seconds: float) -> Floats:
    """A real machine that is no robot axis: steady vibration, one channel of it."""
    x, own = sf.read(path, dtype="float64", always_2d=True)
    channel = x[:, int(rng.integers(x.shape[1]))]
    y = signal.resample(channel, int(channel.size * rate / own))
    return np.asarray(np.resize(y, int(seconds * rate)))


def _n(rate: int, seconds: float) -> int:
    return int(rate * seconds)


def _train(rng: Rng, rate: int, seconds: float, times: Floats, make: Callable[[], Floats], spread: float) -> Floats:
    y = np.zeros(_n(rate, seconds))
    for at in times:
        put(y, rate, float(at), make() * 10 ** (spread * rng.standard_normal()))
    return y


def _notes(rng: Rng, rate: int, seconds: float, beat_s: float, timbre: tuple[float, ...], decay_s: float) -> Floats:
    scale = 220 * 2 ** (np.array((0, 2, 3, 5, 7, 8, 10, 12, 15, -5, -12)) / 12) * rng.uniform(0.7, 1.3)

    def note() -> Floats:
        n = int(3 * decay_s * rate)
        return np.asarray(
            harmonics(np.full(n, rng.choice(scale)), rate, timbre) * np.exp(-np.arange(n) / rate / decay_s)
        )

    return _train(rng, rate, seconds, beats(rng, seconds, beat_s), note, 0.1)


# voices


@family("work")
def voice(rng: Rng, rate: int, seconds: float) -> Floats:
    """Somebody speaks."""
    return speech(rng, rate, seconds)


@family("final")
def phrases(rng: Rng, rate: int, seconds: float) -> Floats:
    """Somebody says a phrase, waits, says the next, in an even rhythm."""
    t = np.arange(_n(rate, seconds)) / rate
    return speech(rng, rate, seconds) * (np.mod(t, rng.uniform(2.5, 6)) < rng.uniform(1.2, 2.2))


@family("final")
def synthetic_voice(rng: Rng, rate: int, seconds: float) -> Floats:
    """A synthetic voice."""
    return formant_voice(rng, rate, seconds)


@family("work")
def crowd(rng: Rng, rate: int, seconds: float) -> Floats:
    """Many people talk at once."""
    return np.asarray(sum(formant_voice(rng, rate, seconds) for _ in range(6)))


@family("final")
def applause(rng: Rng, rate: int, seconds: float) -> Floats:
    """Many hands clap, more and less."""
    n = _n(rate, seconds)
    claps = (rng.random(n) < 60 / rate) * rng.uniform(0.2, 1, n)
    return np.asarray(
        np.asarray(signal.fftconvolve(claps, burst(rng, rate, 700, 3500, 0.006))[:n])
        * np.exp(0.4 * wander(rng, n, rate, 2))
    )


@family("work")
def breathing(rng: Rng, rate: int, seconds: float) -> Floats:
    """Somebody breathes in and out."""
    n = _n(rate, seconds)
    phase = 2 * np.pi * np.arange(n) / rate / rng.uniform(2.5, 5.5)
    breath_in = band(rng.standard_normal(n), rate, 400, 2500) * np.maximum(np.sin(phase), 0) ** 1.5
    breath_out = band(rng.standard_normal(n), rate, 200, 1200) * np.maximum(-np.sin(phase), 0) ** 1.5
    return np.asarray(breath_in + 1.4 * breath_out)


@family("final")
def snoring(rng: Rng, rate: int, seconds: float) -> Floats:
    """Somebody snores."""
    n = _n(rate, seconds)
    phase = 2 * np.pi * np.arange(n) / rate / rng.uniform(3, 6)
    rattle = signal.sawtooth(2 * np.pi * np.cumsum(35 + 12 * np.abs(np.sin(phase))) / rate)
    y = band(rattle + 0.5 * rng.standard_normal(n), rate, 80, 900) * np.maximum(np.sin(phase), 0)
    return np.asarray(y + 0.2 * band(rng.standard_normal(n), rate, 300, 1500) * np.maximum(-np.sin(phase), 0))


@family("work")
def heartbeat(rng: Rng, rate: int, seconds: float) -> Floats:
    """A heart through a stethoscope."""
    every = rng.uniform(0.6, 1.1)
    first, second = (ring(rate, [(f, 0.03, 1.0)], 0.2) for f in (rng.uniform(35, 60), rng.uniform(50, 80)))
    y = np.zeros(_n(rate, seconds))
    for at in beats(rng, seconds, every, 0.02):
        put(y, rate, at, first)
        put(y, rate, at + 0.3 * every, 0.6 * second)
    return y


# music


@family("work")
def piano(rng: Rng, rate: int, seconds: float) -> Floats:
    """Notes that are struck and fade."""
    return _notes(rng, rate, seconds, rng.uniform(0.2, 0.8), (1, 0.5, 0.3, 0.2, 0.1), rng.uniform(0.2, 0.8))


@family("work")
def band_music(rng: Rng, rate: int, seconds: float) -> Floats:
    """Bass, drums and chords at one beat."""
    beat = rng.uniform(0.3, 0.7)
    y = 0.5 * _notes(rng, rate, seconds, beat, (1, 0.7, 0.5, 0.4, 0.3), 0.3)
    kick = ring(rate, [(rng.uniform(45, 75), 0.07, 1.5)], 0.3)
    for k, at in enumerate(np.arange(0, seconds, beat)):
        put(y, rate, at, kick if k % 2 == 0 else 0.8 * burst(rng, rate, 900, 3500, 0.05))
        put(y, rate, at + beat / 2, 0.3 * burst(rng, rate, 3000, 3900, 0.02))
    return y


@family("final")
def strings_swelling(rng: Rng, rate: int, seconds: float) -> Floats:
    """Strings that swell and fade every few seconds."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    swell = np.sin(np.pi * t / rng.uniform(2, 6)) ** 2
    y = np.zeros(n)
    for step in (0, 4, 7):
        f = 196 * 2 ** (step / 12) * (1 + 0.004 * np.sin(2 * np.pi * 5.5 * t + rng.uniform(0, 6)))
        y += harmonics(f, rate, 1 / np.arange(1, 9))
    return np.asarray(y * swell)


@family("final")
def techno(rng: Rng, rate: int, seconds: float) -> Floats:
    """A machine beat with a bass line and a filter that opens and closes."""
    beat = 60 / rng.uniform(115, 145)
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    bass = signal.sawtooth(2 * np.pi * 55 * t) * np.abs(signal.sawtooth(2 * np.pi * t / beat * 2))
    open_filter = 0.5 + 0.5 * np.sin(2 * np.pi * t / (8 * beat))
    y = band(bass, rate, 0, 250) + 0.5 * open_filter * band(bass, rate, 250, 2500)
    kick = sweep(45 + 150 * np.exp(-np.arange(int(0.25 * rate)) / rate / 0.03), rate)
    kick *= np.exp(-np.arange(kick.size) / rate / 0.1)
    for at in np.arange(0, seconds, beat):
        put(y, rate, at, 2 * kick)
    return y


@family("final")
def glass_harp(rng: Rng, rate: int, seconds: float) -> Floats:
    """Rubbed glasses: pure tones that rise and fade slowly."""
    y = np.zeros(_n(rate, seconds))
    for at in beats(rng, seconds, rng.uniform(1, 3)):
        n = int(rng.uniform(1.5, 4) * rate)
        put(y, rate, at, sweep(np.full(n, rng.uniform(500, 1800)), rate) * np.hanning(n))
    return y


@family("work")
def glissando(rng: Rng, rate: int, seconds: float) -> Floats:
    """A tone that slides up and down, as of a siren or a theremin."""
    t = np.arange(_n(rate, seconds)) / rate
    f = 600 * 2 ** (rng.uniform(0.3, 1) * np.sin(2 * np.pi * t / rng.uniform(1.5, 8)))
    return harmonics(f, rate, (1, 0.4, 0.2))


# animals


@family("work")
def birds(rng: Rng, rate: int, seconds: float) -> Floats:
    """Birds chirp."""

    def chirp() -> Floats:
        n = int(rng.uniform(0.05, 0.25) * rate)
        f = rng.uniform(1800, 3500) + 300 * np.sin(np.linspace(0, rng.uniform(2, 30), n))
        return sweep(f, rate) * np.hanning(n)

    return _train(rng, rate, seconds, np.sort(rng.uniform(0, seconds, int(3 * seconds))), chirp, 0.3)


@family("final")
def frogs(rng: Rng, rate: int, seconds: float) -> Floats:
    """Frogs croak, each in its rhythm."""
    y = np.zeros(_n(rate, seconds))
    for _ in range(int(rng.integers(1, 5))):
        n, f = int(rng.uniform(0.15, 0.5) * rate), rng.uniform(300, 1200)
        t = np.arange(n) / rate
        croak = np.sin(2 * np.pi * f * t) * np.hanning(n) * (1 + signal.square(2 * np.pi * rng.uniform(20, 60) * t))
        for at in beats(rng, seconds, rng.uniform(0.8, 4), 0.05):
            put(y, rate, at, croak)
    return y


@family("work")
def dog(rng: Rng, rate: int, seconds: float) -> Floats:
    """A dog barks."""

    def bark() -> Floats:
        n = int(rng.uniform(0.12, 0.25) * rate)
        f = rng.uniform(250, 500) * (1 - 0.4 * np.linspace(0, 1, n))
        return (harmonics(f, rate, (1, 0.8, 0.6, 0.3)) + 0.4 * rng.standard_normal(n)) * np.hanning(n)

    return _train(rng, rate, seconds, beats(rng, seconds, rng.uniform(0.5, 3), 0.1), bark, 0.1)


@family("final")
def crickets(rng: Rng, rate: int, seconds: float) -> Floats:
    """Crickets chirp without end."""
    t = np.arange(_n(rate, seconds)) / rate
    pulses = np.maximum(signal.square(2 * np.pi * rng.uniform(20, 50) * t), 0)
    phrases_on = np.mod(t, rng.uniform(0.5, 2.5)) < rng.uniform(0.2, 0.6)
    return np.asarray(np.sin(2 * np.pi * rng.uniform(2500, 3800) * t) * pulses * phrases_on)


# weather and water


@family("work")
def sea_waves(rng: Rng, rate: int, seconds: float) -> Floats:
    """Waves come in every few seconds."""
    n = _n(rate, seconds)
    phase = np.arange(n) / rate / rng.uniform(4, 9) + 0.1 * wander(rng, n, rate, 6)
    swell = np.mod(phase, 1)
    return coloured(rng, n, 1.0) * np.where(swell < 0.4, swell / 0.4, (1 - swell) / 0.6) ** 1.5


@family("final")
def rain(rng: Rng, rate: int, seconds: float) -> Floats:
    """Rain with single drops on a sill."""
    n = _n(rate, seconds)
    drops = (rng.random(n) < 12 / rate) * rng.uniform(0.3, 1, n)
    on_sill = signal.fftconvolve(drops, ring(rate, [(rng.uniform(400, 1500), 0.01, 1.0)], 0.08))[:n]
    return 0.1 * band(rng.standard_normal(n), rate, 500, 3900) + np.asarray(on_sill)


@family("work")
def storm(rng: Rng, rate: int, seconds: float) -> Floats:
    """Wind in gusts that whistles."""
    n = _n(rate, seconds)
    gust = np.exp(0.7 * wander(rng, n, rate, 1.5))
    whistle = sweep(500 * (1 + 0.2 * wander(rng, n, rate, 1.0)), rate)
    return np.asarray((coloured(rng, n, 1.6) + 0.1 * whistle) * gust)


@family("final")
def thunder(rng: Rng, rate: int, seconds: float) -> Floats:
    """Thunder rolls in the rain."""
    n = _n(rate, seconds)
    y = 0.1 * rng.standard_normal(n)
    for at in rng.uniform(0, seconds, 3):
        roll = band(coloured(rng, 4 * rate, 1.5), rate, 20, 300) * np.exp(-np.arange(4 * rate) / rate / 1.2)
        put(y, rate, at, 4 * roll)
    return y


# household and hands


@family("work")
def clock(rng: Rng, rate: int, seconds: float) -> Floats:
    """A clock or a metronome ticks."""
    y = np.zeros(_n(rate, seconds))
    tick = ring(rate, [(rng.uniform(1200, 3500), 0.004, 1.0), (rng.uniform(200, 800), 0.006, 0.6)], 0.06)
    for k, at in enumerate(beats(rng, seconds, rng.choice((0.25, 0.5, 1.0, 60 / 80, 2.0)))):
        put(y, rate, at, tick if k % 2 else 0.8 * tick)
    return y


@family("final")
def typing(rng: Rng, rate: int, seconds: float) -> Floats:
    """Somebody types."""
    at = np.cumsum(rng.gamma(2, 0.07, int(seconds / 0.1)))
    return _train(rng, rate, seconds, at[at < seconds], lambda: burst(rng, rate, 600, 3900, 0.006), 0.15)


@family("work")
def saw_strokes(rng: Rng, rate: int, seconds: float) -> Floats:
    """A hand saw, pushed and pulled."""
    n = _n(rate, seconds)
    phase = 2 * np.pi * np.arange(n) / rate / rng.uniform(0.8, 3)
    teeth = 1 + 0.5 * np.sin(40 * np.sin(phase) * rng.uniform(3, 8))
    stroke = np.abs(np.cos(phase)) * np.where(np.cos(phase) > 0, 1.0, rng.uniform(0.3, 0.8))
    return np.asarray(band(rng.standard_normal(n), rate, 400, 3800) * stroke * teeth)


@family("final")
def hammering(rng: Rng, rate: int, seconds: float) -> Floats:
    """Somebody hammers at a steady rhythm."""
    blow = ring(rate, [(rng.uniform(200, 700), 0.03, 1), (rng.uniform(900, 3000), 0.08, 0.8)], 0.5)
    return reverberated(
        _train(rng, rate, seconds, beats(rng, seconds, rng.uniform(0.5, 3), 0.02), lambda: blow, 0.05),
        rate, rng, 0.8, 6,
    )  # fmt: skip


@family("work")
def rocking_chair(rng: Rng, rate: int, seconds: float) -> Floats:
    """A chair rocks to and fro on a wooden floor: creak and rumble."""
    n = _n(rate, seconds)
    every = rng.uniform(1.8, 5)
    phase = 2 * np.pi * np.arange(n) / rate / every
    rumble = band(rng.standard_normal(n), rate, 40, 300) * np.abs(np.sin(phase))
    creak = harmonics(200 + 80 * np.sin(phase), rate, 1 / np.arange(1, 8)) * (np.sin(phase) > 0.7)
    return np.asarray(rumble + 0.2 * creak)


@family("final")
def swing(rng: Rng, rate: int, seconds: float) -> Floats:
    """A swing that squeaks on the way out and on the way back."""
    t = np.arange(_n(rate, seconds)) / rate
    phase = 2 * np.pi * t / rng.uniform(2.2, 4.5)
    squeak = harmonics(700 + 250 * np.sin(phase), rate, (1, 0.3, 0.3, 0.2)) * np.abs(np.cos(phase)) ** 6
    return np.asarray(squeak + 0.1 * band(rng.standard_normal(t.size), rate, 100, 1500) * np.abs(np.cos(phase)))


@family("work")
def washing_machine(rng: Rng, rate: int, seconds: float) -> Floats:
    """A drum turns one way, rests, and turns the other way, with water and slaps."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    turns = np.clip(8 * np.sin(2 * np.pi * t / rng.uniform(5, 12)), -1, 1)
    motor = harmonics(np.full(n, rng.uniform(80, 140)), rate, (1, 0.6, 0.5, 0.3))
    y = (0.4 * motor + band(rng.standard_normal(n), rate, 100, 1500)) * np.abs(turns)
    slap = burst(rng, rate, 60, 700, 0.08)
    for at in beats(rng, seconds, rng.uniform(0.7, 1.3), 0.05):
        put(y, rate, at, 1.5 * slap * abs(turns[min(int(at * rate), n - 1)]))
    return np.asarray(y)


@family("final")
def wiper(rng: Rng, rate: int, seconds: float) -> Floats:
    """A windscreen wiper goes back and forth in the rain."""
    n = _n(rate, seconds)
    phase = 2 * np.pi * np.arange(n) / rate / rng.uniform(1.2, 4)
    speed = np.abs(np.sin(phase)) * (0.8 + 0.2 * np.sign(np.sin(phase)))
    motor = harmonics(60 + 250 * speed, rate, (1, 0.5, 0.4, 0.3))
    y = 0.3 * motor * speed + band(rng.standard_normal(n), rate, 200, 2500) * speed
    for k in np.flatnonzero(np.diff(np.sign(np.sin(phase)))):
        put(y, rate, k / rate, burst(rng, rate, 60, 600, 0.03))
    return np.asarray(y + 0.1 * rng.standard_normal(n))


@family("work")
def telephone(rng: Rng, rate: int, seconds: float) -> Floats:
    """A telephone rings: on and off."""
    t = np.arange(_n(rate, seconds)) / rate
    on = np.mod(t, rng.uniform(2, 6)) < rng.uniform(1, 2)
    warble = np.sign(np.sin(2 * np.pi * rng.uniform(10, 25) * t))
    return np.sin(2 * np.pi * np.cumsum(1200 + 150 * warble) / rate) * on


# traffic


@family("work")
def engine_idling(rng: Rng, rate: int, seconds: float) -> Floats:
    """A combustion engine idles."""
    n = _n(rate, seconds)
    f = rng.uniform(12, 35) * (1 + 0.02 * wander(rng, n, rate, 0.5))
    firing = np.maximum(harmonics(f, rate, 1 / np.arange(1, 12)), 0) ** 2
    return band(firing + 0.3 * firing * rng.standard_normal(n), rate, 20, 1500)


@family("final")
def engine_revving(rng: Rng, rate: int, seconds: float) -> Floats:
    """An engine is revved up again and again."""
    n = _n(rate, seconds)
    revs = np.clip(np.sin(2 * np.pi * np.arange(n) / rate / rng.uniform(2.5, 7)), 0, 1)
    f = rng.uniform(20, 40) * (1 + 3 * revs)
    firing = harmonics(f, rate, 1 / np.arange(1, 20) ** 0.7)
    return (firing + band(rng.standard_normal(n), rate, 200, 2500)) * (0.3 + revs)


@family("work")
def train(rng: Rng, rate: int, seconds: float) -> Floats:
    """Wheels over rail joints, in pairs, and rolling noise."""
    n = _n(rate, seconds)
    y = 0.3 * band(rng.standard_normal(n), rate, 80, 1200)
    clack = ring(rate, [(rng.uniform(60, 160), 0.04, 1), (rng.uniform(400, 1200), 0.02, 0.6)], 0.3)
    for at in beats(rng, seconds, rng.uniform(0.7, 2)):
        for k in (0.0, 0.14):
            put(y, rate, at + k, 2 * clack)
    return y


@family("final")
def helicopter(rng: Rng, rate: int, seconds: float) -> Floats:
    """A rotor chops, near and far."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    chop = np.maximum(np.sin(2 * np.pi * rng.uniform(9, 22) * t), 0) ** 4
    return np.asarray(
        (band(rng.standard_normal(n), rate, 40, 900) * chop + 0.1 * sweep(np.full(n, 700.0), rate))
        * (1 + 0.4 * np.sin(2 * np.pi * t / rng.uniform(4, 15)))
    )


@family("work")
def cars_passing(rng: Rng, rate: int, seconds: float) -> Floats:
    """Cars pass by every few seconds."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    near = sum(
        np.exp(-(((t - at) / rng.uniform(0.6, 1.5)) ** 2)) for at in beats(rng, seconds + 4, rng.uniform(2.5, 6))
    )
    return np.asarray(coloured(rng, n, 1.0) * np.asarray(near) + 0.02 * rng.standard_normal(n))


# machines that are no robot axis


@family("work")
def fan(rng: Rng, rate: int, seconds: float) -> Floats:
    """A fan runs."""
    n = _n(rate, seconds)
    blades = harmonics(np.full(n, rng.uniform(60, 350)), rate, (1, 0.4, 0.2, 0.1))
    return coloured(rng, n, rng.uniform(0.5, 1.5)) + rng.uniform(0, 0.8) * blades


@family("final")
def fan_swivelling(rng: Rng, rate: int, seconds: float) -> Floats:
    """A table fan turns its head: louder and softer every few seconds."""
    t = np.arange(_n(rate, seconds)) / rate
    return fan(rng, rate, seconds)[: t.size] * (1 + rng.uniform(0.3, 0.9) * np.sin(2 * np.pi * t / rng.uniform(3, 9)))


@family("work")
def pump(rng: Rng, rate: int, seconds: float) -> Floats:
    """A piston pump: strokes with valves that click."""
    n = _n(rate, seconds)
    every = rng.uniform(0.25, 2.5)
    phase = 2 * np.pi * np.arange(n) / rate / every
    y = band(rng.standard_normal(n), rate, 100, 2000) * np.maximum(np.sin(phase), 0.1)
    click = burst(rng, rate, 300, 3500, 0.01)
    for at in np.arange(0, seconds, every):
        put(y, rate, at, 2 * click)
    return np.asarray(y)


@family("final")
def compressor(rng: Rng, rate: int, seconds: float) -> Floats:
    """A compressor switches on and off."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    on = (np.mod(t + rng.uniform(0, 9), rng.uniform(4, 9)) < rng.uniform(2, 3.5)).astype(float)
    on = signal.lfilter([1 / (0.15 * rate)], [1, -1 + 1 / (0.15 * rate)], on)
    hum = harmonics(24.5 * (0.3 + 0.7 * on), rate, 1 / np.arange(1, 15))
    return np.asarray((hum + 0.7 * band(rng.standard_normal(n), rate, 100, 3000)) * on)


@family("work")
def drill(rng: Rng, rate: int, seconds: float) -> Floats:
    """A drill is started and stopped."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    on = (np.mod(t, rng.uniform(2.5, 7)) < rng.uniform(1.2, 2.2)).astype(float)
    up = np.asarray(signal.lfilter([1 / (0.2 * rate)], [1, -1 + 1 / (0.2 * rate)], on))
    whine = harmonics(rng.uniform(250, 600) * up + 5, rate, 1 / np.arange(1, 7))
    return np.asarray((whine + band(rng.standard_normal(n), rate, 300, 3800)) * up)


@family("final")
def sewing_machine(rng: Rng, rate: int, seconds: float) -> Floats:
    """A sewing machine: seams with pauses."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    on = np.mod(t, rng.uniform(2, 6)) < rng.uniform(1, 2)
    stitches = np.maximum(np.sin(2 * np.pi * rng.uniform(6, 14) * t), 0) ** 8
    return np.asarray(band(rng.standard_normal(n), rate, 200, 3500) * (0.15 + stitches) * on)


@family("work")
def printer(rng: Rng, rate: int, seconds: float) -> Floats:
    """A printer's carriage goes back and forth, paper feeds between."""
    n = _n(rate, seconds)
    u = np.mod(np.arange(n) / rate / rng.uniform(0.7, 2.5), 1)
    speed = np.clip(8 * np.minimum(u, 0.75 - u), 0, 1)
    y = (0.3 * sweep(900 * speed + 1, rate) + band(rng.standard_normal(n), rate, 500, 3800)) * speed
    return np.asarray(y + 0.5 * (u > 0.85) * signal.square(2 * np.pi * 120 * np.arange(n) / rate))


@family("final")
def steady_machine(rng: Rng, rate: int, seconds: float) -> Floats:
    """A steadily turning motor with its gear: lines with side bands."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    f = rng.uniform(15, 50)
    y = 0.5 * coloured(rng, n, 0.5)
    for order in rng.integers(1, 60, 8):
        y += rng.uniform(0.1, 1) * np.sin(2 * np.pi * order * f * t) * (1 + 0.5 * np.sin(2 * np.pi * f * t))
    return y


# plain signals


@family("work")
def noise_swelling(rng: Rng, rate: int, seconds: float) -> Floats:
    """Noise of some colour that swells every 2 to 8 s."""
    n = _n(rate, seconds)
    swell = np.abs(np.sin(np.pi * np.arange(n) / rate / rng.uniform(2, 8))) ** rng.uniform(0.3, 2)
    return np.asarray(coloured(rng, n, float(rng.choice((0, 1, 2)))) * swell)


@family("final")
def noise_gated(rng: Rng, rate: int, seconds: float) -> Floats:
    """Noise of some colour that is switched on and off every few seconds."""
    n = _n(rate, seconds)
    t = np.arange(n) / rate
    edge = np.clip(20 * np.sin(2 * np.pi * t / rng.uniform(2, 8)) + rng.uniform(0, 10), 0, 1)
    return coloured(rng, n, float(rng.choice((0, 1, 2)))) * (edge + 0.02)


@family("work")
def noise_steady(rng: Rng, rate: int, seconds: float) -> Floats:
    """Noise of some colour."""
    return coloured(rng, _n(rate, seconds), float(rng.uniform(0, 2)))


@family("final")
def sweeps(rng: Rng, rate: int, seconds: float) -> Floats:
    """Sweeps up and down the scale, again and again."""
    t = np.arange(_n(rate, seconds)) / rate
    u = np.abs(signal.sawtooth(2 * np.pi * t / rng.uniform(2, 8), 0.5))
    return sweep(100 * 30**u, rate)


@family("work")
def clicks_in_silence(rng: Rng, rate: int, seconds: float) -> Floats:
    """Nothing but a few clicks, regular or not."""
    regular, some = beats(rng, seconds, rng.uniform(1, 6)), rng.uniform(0, seconds, int(rng.integers(3, 12)))
    times = regular if rng.random() < 0.5 else some
    y = _train(rng, rate, seconds, times, lambda: burst(rng, rate, 50, 3500, 0.01), 0.2)
    return y + 1e-3 * rng.standard_normal(y.size)


@family("final")
def empty_room(rng: Rng, rate: int, seconds: float) -> Floats:
    """A quiet room with hum."""
    n = _n(rate, seconds)
    return coloured(rng, n, 1.2) + rng.uniform(0, 1) * harmonics(np.full(n, 50.0), rate, (1, 0.6, 0.3))
