"""What happens to a recording in the field: harmless edges that must keep the label, and disturbances.

Every kind is a pure function of a sound of shape (n,), a source of chance and a strength from 0 (mild) to 1 (strong).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import gcd

import numpy as np
from scipy import signal

from benchmarks.field_bank.sounds import (
    Floats,
    Rng,
    Sound,
    at_level,
    band,
    beats,
    burst,
    coloured,
    envelope,
    harmonics,
    put,
    reverberated,
    ring,
    rms,
    speech,
    sweep,
    wander,
)

Change = Callable[[Sound, Rng, float], Sound]


@dataclass(frozen=True)
class Kind:
    """A kind of change; `harmless` keeps the label, `final_only` kinds are kept from the half that is worked with."""

    change: Change
    harmless: bool
    final_only: bool


KINDS: dict[str, Kind] = {}


def kind(*, harmless: bool = False, final_only: bool = False) -> Callable[[Change], Change]:
    """Enter a function into KINDS under its name."""

    def enter(change: Change) -> Change:
        KINDS[change.__name__] = Kind(change, harmless, final_only)
        return change

    return enter


def quietest(sound: Sound) -> float:
    """Return the rms of the quietest moments: what the room is without the machine."""
    return float(np.percentile(envelope(sound.samples, sound.rate, 0.1), 3)) + 1e-7


def room(sound: Sound, rng: Rng, seconds: float) -> Floats:
    """Return the noise of the room alone."""
    return coloured(rng, int(seconds * sound.rate), 1.0) * quietest(sound)


def added(sound: Sound, what: Floats, over_db: float) -> Sound:
    """Return the sound with something added whose rms is so many dB above the machine's."""
    return written(sound, sound.samples + at_level(what, rms(sound.samples) * 10 ** (over_db / 20)))


def written(sound: Sound, samples: Floats) -> Sound:
    """Return the sound with other samples; louder than full scale it is turned down, as whoever records does."""
    peak = float(np.max(np.abs(samples)))
    return replace(sound, samples=samples * min(1.0, 0.98 / (peak + 1e-12)))


def cut(sound: Sound, begin_s: float, end_s: float) -> Sound:
    """Return a piece; its standstills are counted from its beginning."""
    still = tuple((a - begin_s, b - begin_s) for a, b in sound.standstills if b > begin_s and a < end_s)
    samples = sound.samples[int(begin_s * sound.rate) : int(end_s * sound.rate)]
    return replace(sound, samples=samples, standstills=still)


def length(sound: Sound) -> float:
    """Return the duration in s."""
    return float(sound.samples.size / sound.rate)


# harmless edges


def _lead(sound: Sound, before: Floats) -> Sound:
    return replace(sound, samples=np.concatenate((before, sound.samples)))


@kind(harmless=True)
def lead_silence(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Digital silence before the machine."""
    return _lead(sound, np.zeros(int((0.3 + 4.7 * strength) * sound.rate)))


@kind(harmless=True)
def lead_room(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The room before the machine starts."""
    return _lead(sound, room(sound, rng, 0.3 + 4.7 * strength))


@kind(harmless=True)
def lead_40db(sound: Sound, rng: Rng, strength: float) -> Sound:
    """White noise 40 dB below the machine before it starts."""
    n = int((0.3 + 4.7 * strength) * sound.rate)
    return _lead(sound, rng.standard_normal(n) * rms(sound.samples) * 0.01)


@kind(harmless=True)
def trailing_zeros(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Digital silence after the machine."""
    return replace(sound, samples=np.concatenate((sound.samples, np.zeros(int((0.3 + 4 * strength) * sound.rate)))))


@kind(harmless=True, final_only=True)
def trailing_room(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The room after the machine stopped."""
    return replace(sound, samples=np.concatenate((sound.samples, room(sound, rng, 0.3 + 4 * strength))))


@kind(harmless=True)
def faded(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Faded in and out by an editor."""
    n = int((0.2 + 1.3 * strength) * sound.rate)
    gain = np.ones(sound.samples.size)
    gain[:n], gain[-n:] = np.linspace(0, 1, n), np.linspace(1, 0, n)
    return replace(sound, samples=sound.samples * gain)


@kind(harmless=True)
def dead_first_channel(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A stereo recorder with one microphone, on the second channel."""
    n = sound.samples.size
    dead = (np.zeros(n), 2e-5 * rng.standard_normal(n), 1e-3 * np.sin(2 * np.pi * 50 / sound.rate * np.arange(n)))
    return replace(sound, samples=np.stack((dead[rng.integers(3)], sound.samples), axis=1))


@kind(harmless=True)
def dc_offset(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A constant from a cheap converter."""
    offset = (0.002 + 0.05 * strength) * rng.choice((-1, 1))
    return written(sound, sound.samples + offset)


@kind(harmless=True)
def gain_up(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A recorder that is turned up, short of clipping."""
    return replace(sound, samples=sound.samples / np.max(np.abs(sound.samples)) * (0.5 + 0.48 * strength))


@kind(harmless=True)
def gain_down(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A recorder that is turned down, written with 24 bit."""
    return replace(sound, samples=sound.samples * 10 ** (-(6 + 24 * strength) / 20), subtype="PCM_24")


@kind(harmless=True)
def trimmed_start(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Started somewhere else in the cycle, by at most half of one."""
    return cut(sound, (0.05 + 0.45 * strength) * sound.period_s, length(sound))


def resampled(sound: Sound, rate: int) -> Sound:
    """Return the sound at another rate."""
    common = gcd(rate, sound.rate)
    samples = np.asarray(signal.resample_poly(sound.samples, rate // common, sound.rate // common))
    return written(replace(sound, rate=rate), samples)


@kind(harmless=True)
def resampled_44k(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Written at 44.1 kHz."""
    return resampled(sound, 44100)


@kind(harmless=True, final_only=True)
def resampled_48k(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Written at 48 kHz, as float."""
    return replace(resampled(sound, 48000), subtype="FLOAT")


@kind(harmless=True)
def flac_24bit(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Written as FLAC with 24 bit."""
    return replace(sound, subtype="PCM_24", suffix=".flac")


# blows, steps, clicks


def thump(rng: Rng, rate: int) -> Floats:
    """Return a knock at a microphone or its stand: low, short, with a click; peak 1."""
    modes = [(rng.uniform(25, 140), rng.uniform(0.01, 0.06), 1.0), (rng.uniform(150, 500), 0.01, rng.uniform(0.2, 1))]
    y = ring(rate, modes, 0.35)
    click = burst(rng, rate, 300, 3000, 0.003)
    y[: click.size] += 0.4 * click[: y.size]
    return np.asarray(y / np.max(np.abs(y)))


def struck(sound: Sound, times: Floats, snippets: list[Floats], peaks: Floats) -> Sound:
    """Return the sound with snippets (in turn) at times in s, their peaks in multiples of the machine's rms."""
    y, level = sound.samples.copy(), rms(sound.samples)
    for i, (at, peak) in enumerate(zip(times, peaks, strict=True)):
        put(y, sound.rate, float(at), snippets[i % len(snippets)] * peak * level)
    return written(sound, y)


@kind()
def bump_once(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Somebody touches the microphone once."""
    at = np.array([rng.uniform(0.5, length(sound) - 1)])
    return struck(sound, at, [thump(rng, sound.rate)], np.array([4 + 20 * strength]))


@kind()
def bumps(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Somebody touches the microphone several times."""
    at = rng.uniform(0.3, length(sound) - 0.5, int(rng.integers(3, 9)))
    snippets = [thump(rng, sound.rate) for _ in at]
    return struck(sound, at, snippets, (4 + 16 * strength) * rng.uniform(0.5, 1.5, at.size))


@kind()
def handling(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A microphone in the hand: rustle that comes and goes, with knocks."""
    n = sound.samples.size
    rustle = band(rng.standard_normal(n), sound.rate, 40, 900) * np.maximum(wander(rng, n, sound.rate, 0.3), 0) ** 2
    return bumps(added(sound, rustle, -10 + 14 * strength), rng, strength * 0.6)


@kind()
def press_beside(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A press beside it strikes at a rhythm that is not the machine's."""
    at = beats(rng, length(sound), rng.uniform(0.7, 4.5), 0.004)
    y = ring(sound.rate, [(rng.uniform(30, 90), 0.08, 1.0), (rng.uniform(200, 500), 0.04, 0.6)], 0.4)
    return struck(sound, at, [y / np.max(np.abs(y))], np.full(at.size, 3 + 12 * strength))


@kind()
def hammer(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Somebody hammers in the hall, a few blows in a row."""
    y = ring(sound.rate, [(rng.uniform(300, 900), 0.03, 1), (rng.uniform(1000, 3000), 0.06, 0.8), (80, 0.03, 0.5)], 0.4)
    start = rng.uniform(0.5, length(sound) / 2)
    at = start + np.cumsum(rng.uniform(0.35, 0.8, int(rng.integers(3, 12))))
    return struck(sound, at, [y / np.max(np.abs(y))], (4 + 14 * strength) * rng.uniform(0.6, 1.3, at.size))


@kind()
def brake_at_end(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The brake falls in once, at the end, and the machine is silent."""
    stops = [a for a, _ in sound.standstills if a > 0.6 * length(sound)] or [length(sound) - 0.6]
    stopped = cut(sound, 0.0, stops[-1] + 0.02)
    y = thump(rng, sound.rate) * 0.6
    clack = burst(rng, sound.rate, 150, 2500, 0.02)
    y[: clack.size] += clack[: y.size]
    with_room = replace(stopped, samples=np.concatenate((stopped.samples, room(sound, rng, rng.uniform(0.5, 2)))))
    return struck(with_room, np.array([length(stopped) + 0.08]), [y], np.array([4 + 14 * strength]))


@kind()
def brake_each_stop(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The holding brake clicks at each stop, as it does on healthy axes."""
    at = np.array([a + 0.02 for a, _ in sound.standstills if a > 0])
    y = burst(rng, sound.rate, 250, 3000, 0.012)
    low = ring(sound.rate, [(rng.uniform(60, 150), 0.015, 0.7)], 0.1)
    y = np.pad(y, (0, max(low.size - y.size, 0)))
    y[: low.size] += low
    return struck(sound, at, [y], (2 + 10 * strength) * rng.uniform(0.8, 1.2, at.size))


@kind()
def steps(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Somebody walks by."""
    at = beats(rng, length(sound), rng.uniform(0.45, 0.7), 0.05)
    near = np.exp(-(((at - rng.uniform(0, length(sound))) / 4) ** 2))
    snippets = [burst(rng, sound.rate, 60, 700, 0.03) for _ in range(4)]
    return struck(sound, at, snippets, (1 + 7 * strength) * near)


@kind(final_only=True)
def door_slam(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A door slams once or twice."""
    at = rng.uniform(0.5, length(sound) - 1, int(rng.integers(1, 3)))
    y = reverberated(np.pad(burst(rng, sound.rate, 30, 600, 0.05), (0, sound.rate)), sound.rate, rng, 0.9, 3)
    return struck(sound, at, [y / np.max(np.abs(y))], np.full(at.size, 5 + 20 * strength))


# voices and machines beside it


@kind()
def speech_over(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Somebody speaks beside it."""
    return added(sound, speech(rng, sound.rate, length(sound)), -15 + 20 * strength)


@kind()
def music_over(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A radio plays: chords, a bass, a drum."""
    n, rate = sound.samples.size, sound.rate
    y, beat = np.zeros(n), rng.uniform(0.35, 0.7)
    for i, at in enumerate(np.arange(0, length(sound), beat)):
        root = 110 * 2 ** (rng.choice((0, 3, 5, 7, 10)) / 12)
        tone = harmonics(np.full(int(beat * rate), root), rate, (1, 0.6, 0.4, 0.3, 0.2, 0.1))
        put(y, rate, at, tone * np.exp(-np.arange(tone.size) / rate / 0.3))
        put(
            y, rate, at, (1.5 if i % 2 else 0.8) * burst(rng, rate, 50 if i % 2 else 2000, 150 if i % 2 else 3900, 0.04)
        )
    return added(sound, y, -15 + 18 * strength)


@kind()
def second_axis(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Another axis moves, with a period of its own."""
    n, rate = sound.samples.size, sound.rate
    t = np.arange(n) / rate
    speed = np.clip(3 * np.abs(np.sin(np.pi * t / rng.uniform(0.9, 3.2) + rng.uniform(0, 3))) - 0.4, 0, 1)
    hum = band(rng.standard_normal(n), rate, rng.uniform(150, 400), rng.uniform(900, 3000))
    whine = sweep(rng.uniform(300, 900) * speed, rate)
    return added(sound, (hum + rng.uniform(0.1, 0.6) * whine) * speed, -12 + 14 * strength)


@kind()
def wind(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Wind or a fan blows into the microphone: low noise in gusts."""
    n = sound.samples.size
    gusts = np.exp(0.9 * wander(rng, n, sound.rate, 0.7))
    return added(sound, band(coloured(rng, n, 2.0), sound.rate, 8, 250) * gusts, -8 + 18 * strength)


@kind()
def hiss_bursts(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Compressed air escapes now and then."""
    at = np.cumsum(rng.uniform(0.6, 4.0, 20))
    at = at[at < length(sound)]
    snippets = [burst(rng, sound.rate, 600, 3900, rng.uniform(0.05, 0.4), 0.02) for _ in at]
    return struck(sound, at, snippets, (2 + 10 * strength) * rng.uniform(0.6, 1.2, at.size))


@kind()
def fan_starts(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A fan starts in the middle and stays."""
    n, rate = sound.samples.size, sound.rate
    t = np.arange(n) / rate
    up = np.clip((t - rng.uniform(0.25, 0.7) * length(sound)) / 1.5, 0, 1)
    y = up**2 * coloured(rng, n, 1.0) + 0.7 * up * sweep(rng.uniform(80, 300) * up + 1, rate)
    return added(sound, y, -10 + 16 * strength)


@kind()
def hum_swelling(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Mains hum that swells."""
    n = sound.samples.size
    t = np.arange(n) / sound.rate
    swell = 1 + 0.8 * np.sin(2 * np.pi * t / rng.uniform(3, 12) + rng.uniform(0, 6))
    hum = harmonics(np.full(n, 50.0 + rng.normal(0, 0.05)), sound.rate, (1, 0.5, 0.6, 0.1, 0.3))
    return added(sound, hum * swell, -10 + 20 * strength)


@kind(final_only=True)
def forklift_beeps(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A fork-lift truck beeps while it backs up."""
    n, rate = sound.samples.size, sound.rate
    t = np.arange(n) / rate
    begin, lasts = rng.uniform(0, 0.5) * length(sound), rng.uniform(4, 12)
    on = (np.mod(t, rng.uniform(0.7, 1.2)) < 0.4) & (t > begin) & (t < begin + lasts)
    return added(sound, on * np.sign(np.sin(2 * np.pi * rng.uniform(900, 1400) * t)), -10 + 16 * strength)


@kind(final_only=True)
def gsm_buzz(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A mobile phone beside the cable: bursts at 217 Hz."""
    n, rate = sound.samples.size, sound.rate
    t = np.arange(n) / rate
    slots = (np.mod(t * 217, 1) < 0.125).astype(float)
    talking = np.repeat(rng.random(int(length(sound) / 0.12) + 2) < 0.35, int(0.12 * rate))[:n]
    return added(sound, slots * np.resize(talking, n), -12 + 20 * strength)


# what the recorder does


@kind()
def automatic_gain(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A recorder that holds the level: fast attack, slow release."""
    rate, x = sound.rate, sound.samples
    block = max(int(0.005 * rate), 1)
    loud = envelope(x, rate, 0.02)[::block]
    attack, release = 0.3, 0.005 / (0.3 + 2.5 * (1 - strength))
    held, follower = np.empty(loud.size), float(np.max(loud))
    for i, level in enumerate(loud):
        follower += (level - follower) * (attack if level > follower else release)
        held[i] = follower
    gain = np.interp(np.arange(x.size), np.arange(loud.size) * block, 1 / np.maximum(held, 0.02 * np.max(loud)))
    return replace(sound, samples=x * gain * rng.uniform(0.3, 0.9) / float(np.max(np.abs(x * gain))))


@kind(final_only=True)
def limiter(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A recorder that rounds off what is loud."""
    drive = rms(sound.samples) * (4 - 2.8 * strength)
    return replace(sound, samples=drive * np.tanh(sound.samples / drive))


@kind()
def phone_highpass(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A phone that takes away the lows, below 200 or 300 Hz."""
    return replace(sound, samples=band(sound.samples, sound.rate, 200 if strength < 0.5 else 300, sound.rate, 4))


@kind()
def phone_band(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A telephone line: 300 to 3400 Hz at 8 kHz."""
    line = band(band(sound.samples, sound.rate, 300, sound.rate, 4), sound.rate, 0, 3400, 6)
    return resampled(replace(sound, samples=line), 8000)


@kind()
def clipped(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A recorder that is turned up too far: the loudest parts are cut off."""
    top = rms(sound.samples) * (3.2 - 2.2 * strength)
    return replace(sound, samples=np.clip(sound.samples, -top, top) / top)


@kind()
def dropouts(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A wireless microphone that is gone now and then."""
    y = sound.samples.copy()
    for at in rng.uniform(0, length(sound), int(3 + 25 * strength)):
        begin = int(at * sound.rate)
        y[begin : begin + int(rng.uniform(0.01, 0.3) * sound.rate)] = 0.0
    return replace(sound, samples=y)


@kind(final_only=True)
def samples_lost(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A recorder that skips: pieces are missing, and the ends are joined."""
    keep = np.ones(sound.samples.size, dtype=bool)
    for at in rng.uniform(0.1, 0.95, int(2 + 15 * strength)):
        begin = int(at * keep.size)
        keep[begin : begin + int(rng.uniform(0.01, 0.25) * sound.rate)] = False
    return replace(sound, samples=sound.samples[keep], standstills=())


@kind(final_only=True)
def microphone_moves(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The microphone is put elsewhere a few times: steps of the level, and a rustle at each."""
    y, n = sound.samples.copy(), sound.samples.size
    for at in rng.uniform(0.1, 0.9, int(rng.integers(1, 4))):
        begin = int(at * n)
        y[begin:] *= 10 ** (rng.choice((-1, 1)) * (3 + 12 * strength) / 20)
        put(y, sound.rate, begin / sound.rate, rms(y) * 3 * burst(rng, sound.rate, 40, 900, 0.08, 0.03))
    return written(sound, y)


@kind()
def rate_tag_wrong(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The file says half or double the rate that it was recorded with."""
    return replace(sound, rate=sound.rate * 2 if rng.random() < 0.5 or sound.rate < 16000 else sound.rate // 2)


@kind(final_only=True)
def hall(sound: Sound, rng: Rng, strength: float) -> Sound:
    """Recorded from afar in a reverberant hall."""
    wet = reverberated(sound.samples, sound.rate, rng, 1.0 + 2 * strength, 3 - 12 * strength)
    return written(sound, at_level(wet, rms(sound.samples)))


def _noise(sound: Sound, rng: Rng, over_db: float) -> Sound:
    slope = (0.0, 1.0)[int(rng.integers(2))]
    return added(sound, coloured(rng, sound.samples.size, slope), over_db)


@kind()
def noise_10db_below(sound: Sound, rng: Rng, strength: float) -> Sound:
    """White or pink noise 10 dB below the machine."""
    return _noise(sound, rng, -10)


@kind(final_only=True)
def noise_5db_below(sound: Sound, rng: Rng, strength: float) -> Sound:
    """White or pink noise 5 dB below the machine."""
    return _noise(sound, rng, -5)


@kind()
def noise_as_loud(sound: Sound, rng: Rng, strength: float) -> Sound:
    """White or pink noise as loud as the machine."""
    return _noise(sound, rng, 0)


@kind()
def noise_6db_above(sound: Sound, rng: Rng, strength: float) -> Sound:
    """White or pink noise twice as loud as the machine."""
    return _noise(sound, rng, 6)


# what the robot does


@kind()
def pause(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The robot waits in the middle for 2 to 6 s."""
    stops = [(a + b) / 2 for a, b in sound.standstills if 0.2 < (a + b) / 2 / length(sound) < 0.8]
    at = int((stops[rng.integers(len(stops))] if stops else length(sound) / 2) * sound.rate)
    waits = room(sound, rng, 2 + 4 * strength)
    return replace(sound, samples=np.concatenate((sound.samples[:at], waits, sound.samples[at:])), standstills=())


@kind()
def emergency_stop(sound: Sound, rng: Rng, strength: float) -> Sound:
    """The robot stops hard in the middle, and that was it."""
    rate, at = sound.rate, rng.uniform(0.35, 0.8) * length(sound)
    before = cut(sound, 0.0, at)
    y = before.samples.copy()
    n = int(0.12 * rate)
    y[-n:] *= np.linspace(1, 0, n)
    stopped = replace(before, samples=np.concatenate((y, room(sound, rng, length(sound) - at))))
    return struck(stopped, np.array([at - 0.03]), [thump(rng, rate)], np.array([3 + 12 * strength]))


@kind()
def part_of_a_cycle(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A clip of 0.3 to 0.9 of a cycle."""
    lasts = (0.3 + 0.6 * strength) * sound.period_s
    begin = rng.uniform(0, length(sound) - lasts)
    return cut(sound, begin, begin + lasts)


@kind()
def just_over_a_cycle(sound: Sound, rng: Rng, strength: float) -> Sound:
    """A clip of 1.2 cycles."""
    begin = rng.uniform(0, length(sound) - 1.2 * sound.period_s)
    return cut(sound, begin, begin + 1.2 * sound.period_s)
