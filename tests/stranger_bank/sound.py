"""From torques to a recording: housing, air and structure, room, microphone, recorder.

Every source is normalised to the gearbox's nominal torque and every housing response to unit gain
for white noise, so the levels of sources can be compared.

The work half's housing is a sum of a dozen single resonances worked out over frequency; the final
half's is a dense time response (some 90 decaying modes with a diffuse tail).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from scipy import fft
from scipy.signal import lfilter

from .axes import unit_of
from .kinds import Floats, Gearbox, Half, rng_of
from .mechanics import RUN_IN_S, Build, Run
from .motions import RATE

IR_LENGTH = 16384
RATES = (8000, 16000, 44100, 48000)


@lru_cache(maxsize=64)
def housing(box: Gearbox) -> Floats:
    """Responses (4, IR_LENGTH) of the housing to output mesh, input mesh, motor, rubbing/blows."""
    kind = rng_of("housing of the type", box.half, box.axis)
    own = rng_of("housing", box.name)
    if box.half == "work":
        bands = [(28, 60), (60, 120), (130, 220), (230, 420), (420, 750), (700, 1200), (1100, 1700)]
        bands += [(1600, 2300), (2200, 3200), (3000, 4200), (4000, 5500), (5500, 7200)]
        f_i = np.array([kind.uniform(*b) for b in bands]) * np.exp(0.06 * own.standard_normal(12))
        zeta = np.exp(kind.uniform(np.log(0.012), np.log(0.05), 12) + 0.2 * own.standard_normal(12))
        zeta[:2] = own.uniform(0.05, 0.12, 2)
        gains = kind.standard_normal((4, 12)) + 0.35 * own.standard_normal((4, 12))
        gains += np.sign(gains) * 0.4
        tilt = np.ones(12)
        tilt[:3] = (0.09, 0.13, 0.35)
        tilt[9:] = (0.7, 0.5, 0.4)
        f = np.arange(IR_LENGTH // 2 + 1) * (RATE / IR_LENGTH)
        out = np.zeros((4, f.size), complex)
        for i in range(12):
            h = f**2 / (f_i[i] ** 2 - f**2 + 2j * zeta[i] * f_i[i] * f)
            # a mode shape above its own resonance cancels: keep the pole, drop the flat rest
            h *= 1.0 / (1.0 + (f / (2.5 * f_i[i])) ** 2)
            out += (gains[:, i] * tilt[i])[:, None] * h
        ir = fft.irfft(out, IR_LENGTH)
    else:
        t = np.arange(IR_LENGTH) / RATE
        n = 90
        step = kind.uniform(55, 75)
        f_i = 32 + step * (np.arange(n) ** 1.03) + kind.uniform(-0.4, 0.4, n) * step
        f_i = np.abs(f_i) * np.exp(0.04 * own.standard_normal() + 0.02 * own.standard_normal(n))
        eta = kind.uniform(0.02, 0.05) * (np.maximum(f_i, 60) / 400) ** -0.45
        gain = np.exp(0.8 * kind.standard_normal(n)) * np.minimum(1.0, (f_i / 500) ** 1.6)
        gain *= np.minimum(1.0, (2600 / f_i) ** 0.8)
        keep = f_i < 7400
        ir = np.zeros((4, IR_LENGTH))
        for i in np.flatnonzero(keep):
            decay = np.exp(-np.pi * eta[i] * f_i[i] * t)
            ph = own.uniform(0, 2 * np.pi)
            a = gain[i] * eta[i] * f_i[i] / 400 * own.standard_normal(4)
            wave = decay * np.sin(2 * np.pi * f_i[i] * t + ph)
            ir += a[:, None] * wave
        tail = own.standard_normal((4, IR_LENGTH)) * np.exp(-t / 0.012)
        ir += tail * (0.15 * np.max(np.abs(ir), axis=1, keepdims=True))
    ir /= np.sqrt(np.sum(ir**2, axis=1, keepdims=True))
    return ir


@dataclass(frozen=True)
class Microphone:
    """A microphone and its place, drawn per recording.

    kind: name. low_hz, high_hz: corners of its response. presence_db: lift near 3.5 kHz.
    distance_m: to the gearbox. structure: weight of the structure-borne path. floor_db: recorder
    noise under the machine [dB]. level_dbfs: recording level. rate_hz: sample rate.
    """

    kind: str
    low_hz: float
    high_hz: float
    presence_db: float
    distance_m: float
    structure: float
    floor_db: float
    level_dbfs: float
    rate_hz: int

    @property
    def name(self) -> str:
        """Kind and distance, for the truth."""
        return f"{self.kind} at {self.distance_m:.2f} m"


def microphone_of(rng: np.random.Generator, half: Half) -> Microphone:
    """Draw a microphone."""
    rate = int(rng.choice(RATES))
    kind = str(rng.choice(["phone", "measurement", "usb", "contact"], p=[0.4, 0.2, 0.3, 0.1]))
    low, high, pres, dist, struct, floor = {
        "phone": ((50, 100), (7000, 14000), (2, 6), (0.2, 1.0), 0.15, (-46, -34)),
        "measurement": ((5, 12), (15000, 20000), (-0.5, 0.5), (0.3, 1.5), 0.2, (-58, -46)),
        "usb": ((20, 45), (9000, 16000), (0, 4), (0.15, 0.8), 0.18, (-50, -38)),
        "contact": ((10, 30), (2500, 6000), (-2, 2), (0.05, 0.1), 0.5, (-50, -40)),
    }[kind]
    wide = 1.0 if half == "work" else 1.3
    return Microphone(
        kind=kind,
        low_hz=rng.uniform(*low),
        high_hz=rng.uniform(*high) / wide,
        presence_db=rng.uniform(*pres),
        distance_m=rng.uniform(*dist) * wide,
        structure=struct * rng.uniform(0.5, 1.6),
        floor_db=rng.uniform(*floor),
        level_dbfs=rng.uniform(-42, -20),
        rate_hz=rate,
    )


def path(mic: Microphone, f: Floats, rng: np.random.Generator, half: Half) -> Floats:
    """Complex response from housing to recorder over frequency f [Hz]."""
    air = np.exp(-2j * np.pi * f * (mic.distance_m / 343.0))
    if mic.kind != "contact":
        for _ in range(5 if half == "work" else 9):
            extra = rng.uniform(0.4, 6.0)
            gain = rng.uniform(0.3, 0.8) * mic.distance_m / (mic.distance_m + extra)
            delay = (mic.distance_m + extra) / 343.0
            air = air + gain * np.exp(-2j * np.pi * f * delay) / (1 + 1j * f / 5000)
        air = air * (f / (f + rng.uniform(120, 280)))
    struct = mic.structure / (1 + 1j * f / rng.uniform(180, 450)) ** 2
    bell = 10 ** (mic.presence_db / 20) - 1
    own = 1 + bell / (1 + ((f - 3500) / 1500) ** 2)
    high = (1j * f / mic.low_hz) ** 2 / (1 + 1.4j * f / mic.low_hz - (f / mic.low_hz) ** 2)
    low = 1 / (1 + 1j * f / mic.high_hz)
    top = 0.5 * mic.rate_hz
    alias = 1 / (1 + (f / (0.94 * top)) ** 40)
    return (air + struct) * own * high * low * alias


@njit(cache=True)
def _blows(shake: np.ndarray, preload: float, dt: float, out: np.ndarray) -> None:
    """A part pressed on by `preload` is thrown off when the housing drops away, and falls back.

    shake: housing acceleration (normalised); out: contact force above preload.
    """
    x = 0.0
    v = 0.0
    w = 2 * np.pi * 2200.0
    free = 2 * np.pi * 22.0
    for n in range(shake.size):
        f = 0.0
        if x < 0.0:
            f = -w * w * x - 0.12 * w * v
            if f < 0.0:
                f = 0.0
        v += dt * (f - preload - shake[n] - 0.2 * free * v)
        x += dt * v
        if x > 1e-3:
            x = 1e-3
            v = -0.3 * v
        out[n] = f - preload


def _impacts(build: Build, run: Run, rng: np.random.Generator) -> Floats:
    """Train of bearing impulses in shares of nominal torque, with slip and load zone."""
    order, amp, zone, slip = build.impacts or (0.0, 0.0, 0.0, 0.0)
    out = np.zeros(run.motor_rad.size)
    turns = np.cumsum(np.abs(np.diff(run.motor_rad, prepend=run.motor_rad[0]))) / (2 * np.pi)
    count = int(turns[-1] * order) + 1
    steps = 1.0 / order * (1 + slip * rng.standard_normal(count) + 0.4 * slip)
    at = np.cumsum(steps)
    at = at[at < turns[-1]]
    n = np.searchsorted(turns, at)
    speed = np.abs(np.gradient(run.motor_rad)) * RATE
    ref = build.unit.design.ratio * build.unit.design.speed[1]
    share = (speed[n] / ref) ** 0.8
    shaft = 0.5 - 0.5 * np.cos(run.motor_rad[n] + 1.0)
    load = np.abs(run.in_nm[n]) / build.unit.nominal_nm
    w = amp * share * (1 - zone + zone * shaft) * (0.5 + 0.5 * np.minimum(load, 2.0))
    np.add.at(out, n, w * rng.uniform(0.6, 1.4, n.size))
    # a ball hits for about 0.3 ms
    k = np.hanning(7)
    return np.convolve(out, k / k.max(), mode="same")


def gentle(torque: Floats) -> Floats:
    """Slow swings of torque deform a housing but make no sound (first order, 25 Hz)."""
    return lfilter([1.0, -1.0], [1.0, -np.exp(-2 * np.pi * 25.0 / RATE)], torque)


def fft_size(samples: int) -> int:
    """FFT length at 16 kHz that is a whole number of samples at every recorder rate."""
    return 160 * fft.next_fast_len(-(-(samples + IR_LENGTH) // 160), real=True)


def spectrum(
    box: Gearbox,
    build: Build,
    run: Run,
    rng_fault: np.random.Generator,
    seed: int,
    irs: Floats,
    size: int,
) -> Floats:
    """Spectrum of the machine's sound at the housing (16 kHz, length `size`)."""
    u = unit_of(box)
    d = u.design
    nominal = u.nominal_nm
    n = run.out_nm.size
    rng = rng_of("rub", box.name, seed)
    speed = np.abs(np.diff(run.output_rad, prepend=run.output_rad[0])) * RATE / d.speed[1]
    smooth = int(0.004 * RATE)
    c = np.cumsum(speed)
    speed[smooth:] = (c[smooth:] - c[:-smooth]) / smooth
    load = np.abs(run.out_nm) / nominal
    turn = run.motor_rad * (d.in_turns / d.ratio)
    mesh = 1 + build.rub_mesh * np.sin(d.z_mid * turn * d.mid_turns / d.in_turns)
    rub = rng.standard_normal(n)
    rub *= u.rub * build.rub_gain * speed**0.8 * (0.6 + 0.4 * np.minimum(load, 3.0)) * mesh
    current = np.abs(run.motor_nm) / nominal
    p = d.poles
    whine = np.sin(2 * p * run.motor_rad) + 1.3 * np.sin(6 * p * run.motor_rad + 0.5)
    whine += 0.6 * np.sin(12 * p * run.motor_rad + 1.0)
    whine *= u.whine * np.minimum(speed * 3, 1.0) * (0.4 + 0.6 * current)
    source_in = 0.5 * gentle(run.in_nm / nominal)
    if build.radial[0] > 0:
        source_in = source_in + speed**1.5 * (
            build.radial[0] * np.sin(run.motor_rad) + build.radial[1] * np.sin(2 * run.motor_rad)
        )
    if build.impacts is not None:
        source_in = source_in + _impacts(build, run, rng_fault)
    source_out = gentle(run.out_nm / nominal)
    # torques start away from zero: fade them in, within the run-in
    fade = np.ones(n)
    k = int(0.3 * RATE)
    fade[:k] = 0.5 - 0.5 * np.cos(np.pi * np.arange(k) / k)
    fade[-160:] *= np.linspace(1, 0, 160)
    total = fft.rfft(source_out * fade, size) * irs[0]
    total += fft.rfft(source_in * fade, size) * irs[1]
    total += fft.rfft((whine + 0.1 * run.motor_nm / nominal) * fade, size) * irs[2]
    total += fft.rfft(rub * fade, size) * irs[3]
    if build.rattle is not None:
        shake = fft.irfft(total, size)[:n]
        shake = shake / np.sqrt(np.mean(shake[RATE:] ** 2))
        out = np.zeros(n)
        unit = 3.0e2  # the part's travel is a fraction of a millimetre at this acceleration
        _blows(shake * unit, build.rattle[0] * 1.6 * unit, 1.0 / RATE, out)
        out -= np.mean(out)
        scale = float(np.sqrt(np.mean(np.abs(total) ** 2)) / np.sqrt(size))
        total += fft.rfft(out * (build.rattle[1] * scale / unit * 0.2) * fade, size) * irs[3]
    return total


def at_rate(spec: Floats, size: int, rate: int, samples_16k: int) -> Floats:
    """Time signal at `rate` from a 16 kHz spectrum, run-in cut off."""
    m = size * rate // RATE
    bins = m // 2 + 1
    if bins <= spec.size:
        s = spec[:bins].copy()
    else:
        s = np.zeros(bins, complex)
        s[: spec.size] = spec
    x = fft.irfft(s, m) * (m / size)
    a = round(RUN_IN_S * rate)
    return x[a : a + round((samples_16k / RATE - RUN_IN_S) * rate)]


def shaped(rng: np.random.Generator, n: int, rate: int, shape: str) -> Floats:
    """Noise of unit RMS: 'pink', 'air' (fans, rolled off above 900 Hz) or 'white'."""
    m = fft.next_fast_len(n, real=True)
    x = fft.rfft(rng.standard_normal(m))
    f = np.maximum(np.arange(x.size) * (rate / m), 1.0)
    if shape == "pink":
        x *= (f / (f + 15)) / np.sqrt(f)
    elif shape == "air":
        x *= (f**2 / (f**2 + 220.0**2)) / (1 + (f / 1200) ** 1.2)
    y = fft.irfft(x, m)[:n]
    return y / np.sqrt(np.mean(y**2))


def surroundings(rng: np.random.Generator, n: int, rate: int, half: Half) -> Floats:
    """Unit RMS noise of the hall (work: pink, slowly swelling; final: a factory with events)."""
    t = np.arange(n) / rate
    if half == "work":
        swell = 1 + 0.25 * np.sin(2 * np.pi * rng.uniform(0.05, 0.2) * t + rng.uniform(0, 6.28))
        y = shaped(rng, n, rate, "pink") * swell
    else:
        knots = np.arange(0, t[-1] + 2, 0.7)
        swell = np.interp(t, knots, rng.uniform(0.5, 1.5, knots.size))
        y = (shaped(rng, n, rate, "air") + 0.7 * shaped(rng, n, rate, "pink")) * swell
        for h in range(1, 9):
            y += 0.35 / h * rng.uniform(0.3, 1.0) * np.sin(2 * np.pi * 49.6 * h * t + rng.uniform(0, 6))
        for _ in range(rng.poisson(n / rate / 5.0)):
            k = int(rng.integers(0, n))
            length = min(n - k, int(rng.uniform(0.05, 0.5) * rate))
            tt = np.arange(length) / rate
            if rng.random() < 0.5:  # something falls or is set down
                f0, d = rng.uniform(150, 2500), rng.uniform(10, 60)
                clank = np.sin(2 * np.pi * f0 * tt) + 0.6 * np.sin(2 * np.pi * 2.31 * f0 * tt)
                y[k : k + length] += rng.uniform(1, 4) * clank * np.exp(-d * tt)
            else:  # compressed air
                env = np.minimum(1, tt / 0.01) * np.minimum(1, (tt[-1] - tt) / 0.02 + 1e-3)
                y[k : k + length] += rng.uniform(0.5, 2) * env * rng.standard_normal(length)
    return y / np.sqrt(np.mean(y**2))


def fan(rng: np.random.Generator, box: Gearbox, n: int, rate: int) -> Floats:
    """Steady sound of fans and cabinet near the machine (levels as the sources')."""
    u = unit_of(box)
    t = np.arange(n) / rate
    y = shaped(rng, n, rate, "air") + 0.2 * shaped(rng, n, rate, "pink")
    drift = u.fan_hz * (1 + 0.01 * rng.uniform(-1, 1))
    for h in (1, 2, 3):
        y += 0.35 / h * np.sin(2 * np.pi * drift * h * t + rng.uniform(0, 6.28))
    return u.fan * y


def pwm(rng: np.random.Generator, n: int, rate: int) -> Floats:
    """Switching tone of the drive at 8 kHz and 16 kHz where the rate can carry it."""
    t = np.arange(n) / rate
    y = np.zeros(n)
    for f0 in (8000.0, 16000.0):
        if f0 < 0.45 * rate:
            y += np.sin(2 * np.pi * f0 * t + rng.uniform(0, 6.28))
    return y
