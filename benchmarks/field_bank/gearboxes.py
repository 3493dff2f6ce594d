"""Recordings of a robot axis that moves back and forth, with known faults.

Motion and torque at the output decide everything. Rolling noise grows with speed and load, tooth meshes follow the
angle, a change of acceleration shakes the arm. A notch strikes once per cycle, at one angle in one direction. Play
strikes when the torque changes sign as braking begins, and when a start closes a gap that floated at standstill. All
of that passes the modes of one housing, a room, a microphone and a converter.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from benchmarks.field_bank.sounds import Floats, Rng, Sound, at_level, band, coloured, put, reverberated, ring, rms

LABELS = ("normal", "notch", "play")
UNSEEN = "bearing"
SMALLEST_RAD = 0.3e-3
"""Size of a fault that is barely audible: depth of a notch or gap of a play; the largest is ten times that."""

RATIO = 118.0
MESHES = ((11.0 * RATIO, 0.30), (22.0 * RATIO, 0.12), (145.0, 0.10), (290.0, 0.05), (40.0 * RATIO / 3, 0.08))
"""Order per output revolution and amplitude, referred to the rolling noise."""


@dataclass(frozen=True)
class Unit:
    """One gearbox with its housing, place and microphone. Frequencies in Hz, gains dimensionless."""

    name: str
    modes: tuple[tuple[float, float, float], ...]
    arm: tuple[tuple[float, float, float], ...]
    mesh_gain: float
    tilt: float
    jerk_gain: float
    fan_gain: float
    room_gain: float
    rt60_s: float
    close_db: float
    mic_low_hz: float
    level: float
    friction_n_m: float
    imbalance_n_m: float
    flank: int


@dataclass(frozen=True)
class Motion:
    """A cycle: out, dwell, back, dwell. Seconds, rad, rad/s; `smooth` for an S-curve, else a trapezoid."""

    period_s: float
    dwell_s: float
    ramp_s: float
    speed_rad_s: float
    smooth: bool
    start_s: float

    @property
    def move_s(self) -> float:
        """Return the time of one stroke, in s."""
        return self.period_s / 2 - self.dwell_s

    @property
    def stroke_rad(self) -> float:
        """Return the angle of one stroke, in rad."""
        return self.speed_rad_s * (self.move_s - self.ramp_s)

    def speed(self, t: Floats) -> Floats:
        """Return the speed of the output in rad/s at times in s, same shape; positive on the way out."""
        in_cycle = np.mod(t + self.start_s, self.period_s)
        back = in_cycle >= self.period_s / 2
        u = in_cycle - np.where(back, self.period_s / 2, 0.0)
        rise = np.clip(np.minimum(u, self.move_s - u) / self.ramp_s, 0.0, 1.0)
        if self.smooth:
            rise = (1 - np.cos(np.pi * rise)) / 2
        return np.asarray(np.where(back, -1.0, 1.0) * self.speed_rad_s * rise)


@dataclass(frozen=True)
class Recording:
    """A sound and its truth. `size_rad` is 0 for normal; `events_s` are the times at which the fault strikes."""

    sound: Sound
    label: str
    gearbox: str
    size_rad: float
    speed_rad_s: float
    payload_kg_m2: float
    period_s: float
    events_s: tuple[float, ...]


def make_units(rng: Rng, count: int = 16) -> tuple[Unit, ...]:
    """Return gearboxes of one axis type: common modes, moved and weighted anew for each."""
    common = np.sort(rng.uniform((230, 380, 640, 950, 1400, 2100, 3100), (330, 560, 860, 1300, 1900, 2900, 3800)))
    gains = np.array((1.0, 0.8, 0.8, 0.9, 0.9, 0.9, 0.9)) * 10 ** rng.uniform(-0.15, 0.15, 7)
    units = []
    for i in range(count):
        f = common * (1 + 0.05 * rng.standard_normal(7))
        a = gains * 10 ** (0.2 * rng.standard_normal(7))
        q = rng.uniform(7, 25, 7)
        arm_hz = np.array((46.0, 83.0)) * (1 + 0.08 * rng.standard_normal(2))
        units.append(
            Unit(
                name=f"u{i:02d}",
                modes=tuple(zip(f.tolist(), (q / np.pi / f).tolist(), a.tolist(), strict=True)),
                arm=((float(arm_hz[0]), 0.045, 1.0), (float(arm_hz[1]), 0.025, float(rng.uniform(0.2, 0.6)))),
                mesh_gain=float(rng.uniform(0.4, 1.6)),
                tilt=float(rng.uniform(0.0, 0.5)),
                jerk_gain=float(rng.uniform(0.2, 1.6)),
                fan_gain=float(10 ** rng.uniform(-1.7, -0.9)),
                room_gain=float(10 ** rng.uniform(-1.7, -0.9)),
                rt60_s=float(rng.uniform(0.15, 0.6)),
                close_db=float(rng.uniform(8, 18)),
                mic_low_hz=float(rng.uniform(12, 30)),
                level=float(10 ** rng.uniform(-2.1, -1.15)),
                friction_n_m=float(rng.uniform(8, 25)),
                imbalance_n_m=float(rng.uniform(0, 12)),
                flank=1 if rng.random() < 0.5 else -1,
            )
        )
    return tuple(units)


def draw_motion(rng: Rng) -> Motion:
    """Return a motion that robots make: cycles of 3 to 8 s, strokes up to 5.5 rad."""
    period, dwell, ramp = float(3.0 * (8 / 3) ** rng.random()), rng.uniform(0.05, 0.6), rng.uniform(0.15, 0.6)
    ramp = min(ramp, (period / 2 - dwell) / 2.5)
    speed = min(rng.uniform(1.4, 2.9), 5.5 / (period / 2 - dwell - ramp))
    return Motion(period, float(dwell), float(ramp), float(speed), bool(rng.random() < 0.5), rng.uniform(0, period))


def _crossings(x: Floats) -> NDArray[np.intp]:
    return np.flatnonzero(np.diff(np.signbit(x)))


def record(
    unit: Unit,
    label: str,
    rng: Rng,
    *,
    rate: int = 8000,
    seconds: float = 20.0,
    motion: Motion | None = None,
    payload: float | None = None,
    size_rad: float | None = None,
) -> Recording:
    """Return a recording of a gearbox with a fault.

    What is not given is drawn: a motion, a payload [kg m2] and a size from barely to plainly audible.
    Raises ValueError for a label that is none of LABELS nor UNSEEN.
    """
    if label not in (*LABELS, UNSEEN):
        raise ValueError(f"no such label: {label}")
    motion = motion or draw_motion(rng)
    payload = float(rng.uniform(20, 50)) if payload is None else payload
    t = np.arange(int(seconds * rate)) / rate
    speed = motion.speed(t)
    angle = np.cumsum(speed) / rate + rng.uniform(0, 2 * np.pi)
    acceleration = np.gradient(speed, 1 / rate)
    fast = np.abs(speed) / 2.2
    torque = payload * acceleration + unit.friction_n_m * np.tanh(speed / 0.02) + unit.imbalance_n_m * np.sin(angle)
    load = np.abs(torque) / 150.0

    # running noise, rms about 1 while the axis moves
    rolling = coloured(rng, t.size, unit.tilt) * fast**0.9 * (0.85 + 0.15 * load)
    for order, amplitude in MESHES:
        wobble = 1 + 0.3 * np.sin(angle * RATIO / 3 + rng.uniform(0, 6)) + 0.2 * np.sin(angle + rng.uniform(0, 6))
        shown = order * np.max(np.abs(speed)) / 2 / np.pi < 0.48 * rate
        if shown:
            tone = np.sin(order * angle + rng.uniform(0, 6)) * wobble
            rolling += unit.mesh_gain * amplitude * tone * fast**1.2 * (0.8 + 0.2 * load)
    # the arm shakes a little at every change of acceleration
    jerk = np.gradient(acceleration, 1 / rate) / rate * (0.4 * unit.jerk_gain / 10.0)

    # strikes of the fault: (time, strength in multiples of the low-frequency running noise, sharpness)
    size = 0.0
    if label != "normal":
        size = float(SMALLEST_RAD * 10 ** rng.random()) if size_rad is None else size_rad
    strikes: list[tuple[float, float, float]] = []
    strokes = np.flatnonzero(np.diff((np.abs(speed) > 1e-9).astype(int)) > 0)
    if label == "notch":
        relative = motion_angle(motion, t)
        at = float(rng.uniform(0.15, 0.85)) * motion.stroke_rad
        for i in _crossings(relative - at):
            if np.sign(speed[i]) == unit.flank:
                hit = 5.5 * (size / SMALLEST_RAD) ** 0.6 * fast[i] ** 0.7 * rng.uniform(0.85, 1.15)
                strikes.append((float(t[i]), float(hit), 0.25))
    if label == "play":
        for i in _crossings(torque):
            if np.abs(speed[i]) > 0.3 * motion.speed_rad_s and acceleration[min(i + 8, t.size - 1)] * speed[i] < 0:
                sudden = 0.75 if motion.smooth else 1.0
                hit = 4.2 * (size / SMALLEST_RAD) ** 0.45 * sudden * (payload / 35) ** 0.3 * rng.uniform(0.7, 1.3)
                strikes.append((float(t[i]), float(hit), 1.0))
        for i in strokes:
            hit = 2.8 * (size / SMALLEST_RAD) ** 0.45 * rng.uniform(0.4, 1.4)
            strikes.append((float(t[i]) + rng.uniform(0.0, 0.02), float(hit), 0.8))

    n_ring = 0.4
    housing = ring(rate, unit.modes, 0.08)
    housing /= np.sqrt(np.sum(housing**2))
    arm = ring(rate, unit.arm, n_ring)
    arm /= np.max(np.abs(arm))
    moving = np.abs(speed) > 0.5 * motion.speed_rad_s
    running = signal.fftconvolve(rolling, housing)[: t.size]
    running = running + 0.25 * rolling * rms(running[moving]) / rms(rolling[moving])
    running = running / rms(running[moving])
    low = rms(band(running[moving], rate, 0, 200))
    low = max(low, 0.12)
    running = running + at_level(band(coloured(rng, t.size, 0.5) * fast, rate, 15, 200), 0.12)

    struck = np.zeros(t.size)
    for at_s, hit, sharp in strikes:
        put(struck, rate, at_s, hit * low * arm * (1 - 0.55 * sharp))
        click = ring(rate, [(f, 0.6 * tau, a) for f, tau, a in unit.modes], 0.06)
        put(struck, rate, at_s, hit * low * (0.35 + 0.9 * sharp) * click / (np.max(np.abs(click)) + 1e-12))
        if sharp > 0.5:
            thud = np.hanning(max(int(0.009 * rate), 4))
            wait = 0.0
            for bounce in range(int(rng.integers(1, 4))):
                put(struck, rate, at_s + wait, hit * low * 0.45**bounce * thud * (1 if rng.random() < 0.5 else -1))
                wait += 0.012 + 0.03 * (size / SMALLEST_RAD / 10) * 0.6**bounce
    events = [at_s for at_s, _, _ in strikes]
    if label == UNSEEN:
        # a ball rolls over a flaw of the middle shaft's outer ring
        passes = _crossings(np.sin(angle * 5.4 * RATIO / 9 / 2))
        clicks = np.zeros(t.size)
        clicks[passes] = fast[passes] * (1 + 0.3 * rng.standard_normal(passes.size))
        high = ring(rate, [(f, 0.4 * tau, a) for f, tau, a in unit.modes if f > 800], 0.03)
        high /= np.max(np.abs(high)) + 1e-12
        struck += 1.0 * (size / SMALLEST_RAD) ** 0.6 * signal.fftconvolve(clicks, high)[: t.size]
        events = [float(t[i]) for i in passes]
    shaken = signal.fftconvolve(jerk, arm)[: t.size] * low

    fan = coloured(rng, t.size, 1.0) + 0.4 * np.sin(2 * np.pi * rng.uniform(90, 160) * t)
    room = coloured(rng, t.size, 1.0)
    heard = reverberated(running + struck + shaken, rate, rng, unit.rt60_s, unit.close_db)
    heard = heard + unit.fan_gain * fan + unit.room_gain * room
    heard = band(heard, rate, unit.mic_low_hz, rate)
    level = unit.level * 10 ** rng.uniform(-0.1, 0.1)
    heard = np.clip(heard * level + rng.standard_normal(t.size) * 3e-5, -0.999, 0.999)
    still = np.concatenate(([False], np.abs(speed) < 1e-9, [False]))
    edges = np.flatnonzero(np.diff(still.astype(int)))
    standstills = tuple((float(a) / rate, float(b) / rate) for a, b in zip(edges[::2], edges[1::2], strict=True))
    sound = Sound(heard, rate, standstills=standstills, period_s=motion.period_s)
    return Recording(sound, label, unit.name, size, motion.speed_rad_s, payload, motion.period_s, tuple(sorted(events)))


def motion_angle(motion: Motion, t: Floats) -> Floats:
    """Return the angle in rad from the inner end of the stroke, at times in s, same shape."""
    step = 1e-3
    grid = np.asarray(np.arange(0.0, motion.period_s + step, step), dtype=np.float64)
    at_zero = Motion(motion.period_s, motion.dwell_s, motion.ramp_s, motion.speed_rad_s, motion.smooth, 0.0)
    speed = at_zero.speed(grid)
    angle = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2) * step))
    return np.asarray(np.interp(np.mod(t + motion.start_s, motion.period_s), grid, angle))
