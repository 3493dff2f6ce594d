"""The axis, its gearboxes, their faults, and how they move: angles, torques at the meshes, impacts across the play."""

import tomllib
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter, lfilter_zi

Array = NDArray[np.float64]
Kind = Literal["trapezoid", "s_curve", "sine"]
Label = Literal["normal", "play", "notch", "bearing", "rub"]

AXIS_TOML = """\
schema = "gearcase-axis/1"
name = "axis-points"
motor = { inertia_kg_m2 = 0.0055, coulomb_friction_n_m = 0.35, viscous_friction_n_m_s_per_rad = 0.002 }
load = { inertia_kg_m2 = 36, coulomb_friction_n_m = 10, viscous_friction_n_m_s_per_rad = 6 }
load_encoder = { error_rad = 1.5e-5 }

[[stages]]
name = "transfer"
driver_teeth = 14
driven_teeth = 98
inertia_kg_m2 = 0.025
stiffness_n_m_per_rad = 2100
damping_n_m_s_per_rad = 0.2
backlash_rad = 6e-5
transmission_error_rad = 2e-5

[[stages]]
name = "output"
driver_teeth = 13
driven_teeth = 182
stiffness_n_m_per_rad = 140000
damping_n_m_s_per_rad = 55
mesh_efficiency = 0.97
backlash_rad = 2.2e-5
transmission_error_rad = 2e-6
"""
AXIS: dict[str, Any] = tomllib.loads(AXIS_TOML)
MOTOR, (TRANSFER, OUTPUT), LOAD = AXIS["motor"], AXIS["stages"], AXIS["load"]
STIFFNESS = (TRANSFER["stiffness_n_m_per_rad"], OUTPUT["stiffness_n_m_per_rad"])
SHAFT_RATIO: float = OUTPUT["driven_teeth"] / OUTPUT["driver_teeth"]  # turns of the transfer shaft per turn of the load
MOTOR_RATIO: float = TRANSFER["driven_teeth"] / TRANSFER["driver_teeth"]  # of the motor per turn of the transfer shaft
RATIO = MOTOR_RATIO * SHAFT_RATIO
# of each gear: turns per turn of the load, and its mesh (0 transfer, 1 output)
GEARS = {
    "motor_pinion": (RATIO, 0),
    "transfer": (SHAFT_RATIO, 0),
    "output_pinion": (SHAFT_RATIO, 1),
    "output": (1.0, 1),
}
MOTION_RATE = 4000.0  # Hz, of angles and torques
REFERENCE_SPEED, REFERENCE_TORQUE = 2.55, (18.0, 240.0)  # rad/s of the load, N m at the driven gear of each mesh


@dataclass(frozen=True)
class Specimen:
    """One gearbox.

    Attributes
    ----------
    error : complex array (2, 8), transmission error by mesh and harmonic of tooth passing; absolute value 1: usual
    pitch_error : two arrays, one value per tooth of each driven gear, as a share of a usual transmission error
    eccentricity : complex array (2, 2), by mesh and gear (driver, driven), share by which a mesh swells per turn
    friction, stiffness, damping : factors on what the data sheet says; share of critical damping of the torsional mode
    backlash_rad, contact_s, impact : arrays (2,) by mesh: play as new, lasting of an impact, loudness of impacts
    mode_hz, mode_q, mode_gain : arrays (m,), (m,), (5, m), 5 to 12 resonances of the housing, and how much each force
        (transfer mesh, output mesh, motor, bearings, mount) drives them
    rolling, rolling_power : loudness of rolling, and the power of speed with which it rises
    """

    error: NDArray[np.complex128]
    pitch_error: tuple[Array, Array]
    eccentricity: NDArray[np.complex128]
    friction: float
    stiffness: float
    damping: float
    backlash_rad: Array
    contact_s: Array
    impact: Array
    mode_hz: Array
    mode_q: Array
    mode_gain: Array
    rolling: float
    rolling_power: float

    @classmethod
    def draw(cls, seed: int) -> "Specimen":
        """Draw a gearbox; the same seed gives the same one."""
        rng = np.random.default_rng([seed, 71])
        low = rng.uniform(55, 130, rng.integers(1, 3))
        high = np.exp(rng.uniform(np.log(450), np.log(3700), rng.integers(3, 10)))
        hz = np.concatenate([low, rng.uniform(230, 400, 1), high])
        size = np.concatenate([np.full(len(low), 0.26), [3.4], 1.6 * (450 / high) ** 0.4])
        phase = np.exp(1j * rng.uniform(0, 2 * np.pi, (2, 10)))
        return cls(
            error=rng.lognormal(0, 0.35, (2, 8)) / np.arange(1, 9) ** 1.1 * phase[:, :8],
            pitch_error=(rng.normal(0, 0.3, TRANSFER["driven_teeth"]), rng.normal(0, 0.3, OUTPUT["driven_teeth"])),
            eccentricity=rng.uniform(0.02, 0.25, (2, 2)) * phase[:, 8:],
            friction=rng.lognormal(0, 0.2),
            stiffness=rng.lognormal(0, 0.12),
            damping=rng.uniform(0.07, 0.18),
            backlash_rad=rng.uniform(0.3, 1.0, 2) * [TRANSFER["backlash_rad"], OUTPUT["backlash_rad"]],
            contact_s=rng.uniform([0.0025, 0.004], [0.005, 0.008]),
            impact=rng.lognormal(0, 0.25, 2),
            mode_hz=hz,
            mode_q=np.where(hz < 200, rng.uniform(2.5, 6, len(hz)), rng.uniform(8, 30, len(hz))),
            mode_gain=size * rng.lognormal(0, 0.3, (5, len(hz))) * rng.choice([-1.0, 1.0], (5, len(hz))),
            rolling=rng.lognormal(0, 0.2),
            rolling_power=rng.uniform(0.6, 1.1),
        )


@dataclass(frozen=True)
class Fault:
    """One fault; what a kind does not use is ignored.

    Attributes
    ----------
    place : gear of a notch, driven gear of the mesh with play, gear on the bearing's shaft, ``turn`` or ``stick_slip``
    size : play [rad] at the driven gear; depth of a notch, strength of a bearing defect or a rub (1: middling)
    width : of a notch in tooth pitches; of a rub, or from one stick-slip to the next, in rad of the load
    angle_rad : where on its gear the notch lies, or on the load's turn the rub
    flank : 1 or -1, the sign of torque that loads the damaged flank
    order : passings of balls over the defect of the outer race per turn of the shaft
    """

    label: Label
    place: str = "output"
    size: float = 0.0
    width: float = 1.0
    angle_rad: float = 0.0
    flank: int = 1
    order: float = 0.0

    @classmethod
    def draw(cls, rng: np.random.Generator, label: Label, place: str | None = None) -> "Fault":
        """Draw a fault of a kind; a notch is on the output gear unless another place is named."""
        size, width, order = float(rng.lognormal(0, 0.5)), float(rng.uniform(0.4, 1.3)), 0.0
        angle, flank = float(rng.uniform(0, 2 * np.pi)), int(rng.choice([-1, 1]))
        if label == "play":
            place = place or ("transfer", "output")[rng.integers(2)]
            size *= 1.5e-3 if place == "transfer" else 5e-4
        elif label == "bearing":  # balls / 2 * (1 - ball / pitch diameter * cos of the contact angle)
            place = place or ("motor_pinion", "transfer", "output")[rng.integers(3)]
            balls, ball = (rng.integers(18, 31), 0.11) if place == "output" else (rng.integers(7, 13), 0.23)
            order = float(balls / 2 * (1 - ball * rng.uniform(0.8, 1.2) * np.cos(rng.uniform(0, 0.5))))
        elif label == "rub":
            place = place or ("turn", "stick_slip")[rng.integers(2)]
            width = float(rng.uniform(0.15, 0.6) if place == "turn" else rng.uniform(0.004, 0.015))
        return cls(label, place or "output", size, width, angle, flank, order)


@dataclass(frozen=True)
class OperatingPoint:
    """How the axis is driven: back and forth over ``stroke_rad`` from ``start_rad``.

    ``speed_rad_s`` is the highest speed of the load, ``accel_s`` the time to reach it (an s-curve limits the jerk: its
    acceleration peaks at twice the mean); a sine uses neither ``accel_s`` nor ``dwell_s``. ``payload_kg_m2`` is the
    whole inertia at the load, ``jitter_s`` the standard deviation of the time at which a half cycle begins.
    """

    kind: Kind = "trapezoid"
    speed_rad_s: float = REFERENCE_SPEED
    stroke_rad: float = 7.2
    start_rad: float = 0.0
    accel_s: float = 0.32
    dwell_s: float = 0.12
    payload_kg_m2: float = 36.0
    jitter_s: float = 0.004

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        kind: Kind = "trapezoid",
        spread: float = 0.1,
        base: "OperatingPoint | None" = None,
    ) -> "OperatingPoint":
        """Draw a point around ``base``: values times exp(N(0, spread)), the start angle shifted by N(0, spread) rad."""
        base = base or cls()
        names = ("speed_rad_s", "stroke_rad", "accel_s", "dwell_s", "payload_kg_m2")
        drawn = {name: float(getattr(base, name) * np.exp(rng.normal(0, spread))) for name in names}
        return replace(base, kind=kind, start_rad=float(base.start_rad + rng.normal(0, spread)), **drawn)

    def half_cycle(self) -> Array:
        """Give the share of the stroke done, 0 to 1, from start to end of one move, at MOTION_RATE."""
        speed, accel, moving = self.speed_rad_s, self.accel_s, np.pi / 2 * self.stroke_rad / self.speed_rad_s
        if self.kind != "sine":
            slower = min(1.0, float(np.sqrt(self.stroke_rad / (speed * accel))))  # of a stroke too short for its speed
            speed, accel = speed * slower, accel * slower
            moving = self.stroke_rad / speed + accel
        time = np.arange(round(moving * MOTION_RATE) + 1) / MOTION_RATE
        pace = np.clip(np.minimum(time, moving - time) / accel, 0, 1)
        if self.kind == "sine":
            pace = np.sin(np.pi * np.clip(time / moving, 0, 1))
        elif self.kind == "s_curve":
            pace = np.where(pace < 0.5, 2 * pace**2, 1 - 2 * (1 - pace) ** 2)
        return np.asarray(np.cumsum(pace) / np.sum(pace))


@dataclass(frozen=True)
class Motion:
    """Angle [rad], speed, acceleration of the load, torque [N m] at each driven gear: arrays (n,) at MOTION_RATE."""

    angle: Array
    speed: Array
    acceleration: Array
    torque: tuple[Array, Array]


def _follow(signal: Array, hz: float, damping: float) -> Array:
    """Let a mass on a spring follow ``signal``, from rest at its first value."""
    omega = 2 * np.pi * hz
    b, a = bilinear([omega**2], [1, 2 * damping * omega, omega**2], MOTION_RATE)
    return np.asarray(lfilter(b, a, signal, zi=lfilter_zi(b, a) * signal[0])[0])


def move(specimen: Specimen, point: OperatingPoint, rng: np.random.Generator, duration_s: float) -> Motion:
    """Move the axis, and begin at a random moment of its cycle."""
    way, dwell = point.half_cycle(), 0.0 if point.kind == "sine" else point.dwell_s
    before = round(rng.uniform(1, 2 + 2 * len(way) / MOTION_RATE + 2 * dwell) * MOTION_RATE)
    n, pieces = round(duration_s * MOTION_RATE), [way[:1]]
    while sum(map(len, pieces)) <= before + n:
        pause = max(0, round((dwell + rng.normal(0, point.jitter_s)) * MOTION_RATE))
        pieces += [way, np.full(pause, way[-1])]
        way = 1 - way
    angle = _follow(point.start_rad + point.stroke_rad * np.concatenate(pieces), 11.0, 0.8)  # the servo
    speed = np.gradient(angle) * MOTION_RATE
    acceleration = np.gradient(speed) * MOTION_RATE
    sliding = np.tanh(speed / 0.02) * LOAD["coulomb_friction_n_m"] * (1 + 0.25 * np.exp(-np.abs(speed) / 0.1))
    drag = sliding + LOAD["viscous_friction_n_m_s_per_rad"] * speed
    spring = specimen.stiffness / (1 / (STIFFNESS[0] * SHAFT_RATIO**2) + 1 / STIFFNESS[1])
    omega = np.sqrt(spring * (1 / point.payload_kg_m2 + 1 / (MOTOR["inertia_kg_m2"] * RATIO**2)))
    output = _follow(
        point.payload_kg_m2 * acceleration + specimen.friction * drag, omega / (2 * np.pi), specimen.damping
    )
    transfer = TRANSFER["inertia_kg_m2"] * acceleration * SHAFT_RATIO + output / SHAFT_RATIO / OUTPUT["mesh_efficiency"]
    angle, speed, acceleration, transfer, output = (
        x[before : before + n] for x in (angle, speed, acceleration, transfer, output)
    )
    return Motion(angle, speed, acceleration, (transfer, output))


def free_inertia(payload_kg_m2: float) -> tuple[float, float]:
    """Give the inertia [kg m2] at the driven gear of each mesh that two parts have against each other while apart."""
    motor, shaft = MOTOR["inertia_kg_m2"] * MOTOR_RATIO**2, TRANSFER["inertia_kg_m2"]
    load = shaft + payload_kg_m2 / SHAFT_RATIO**2
    upper = (motor + shaft) * SHAFT_RATIO**2
    return motor * load / (motor + load), upper * payload_kg_m2 / (upper + payload_kg_m2)


def impacts(torque: Array, inertia: float, gap: float, restitution: float = 0.35) -> tuple[Array, Array, Array]:
    """Fly across the gap at each change of sign of the torque, and bounce.

    ``torque`` [N m], array (n,) at MOTION_RATE, ``inertia`` [kg m2] and ``gap`` [rad] are at the driven gear. Gives
    arrays (k,): times [s], speeds of impact [rad/s], and the flank hit (1 or -1).
    """
    step, window = 1 / MOTION_RATE, round(0.6 * MOTION_RATE)
    side, i, speed = 1 if torque[0] >= 0 else -1, 0, 0.0
    found: list[tuple[float, float, int]] = []
    while i < len(torque):
        if 2 * speed * inertia < 0.003 * side * torque[i]:  # a rebound shorter than 3 ms is contact
            apart = np.flatnonzero(torque[i:] * side < 0)
            if not len(apart):
                break
            i, speed = i + int(apart[0]), 0.0
        speeds = speed - side * np.cumsum(torque[i : i + window]) * step / inertia
        way = np.cumsum(speeds) * step
        ends = np.flatnonzero((way >= gap) | (way < 0))
        if not len(ends):
            i, speed = i + window, 0.0
            continue
        end = int(ends[0])
        across = bool(way[end] >= gap)
        side = -side if across else side
        late = (way[end] - gap * across) / speeds[end]
        found.append(((i + end + 1) * step - float(np.clip(late, 0, step)), abs(float(speeds[end])), side))
        i, speed = i + end + 1, restitution * found[-1][1]
    table = np.array(found).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]
