"""Axis types of both halves and the scatter of their gearboxes.

All mechanics is referred to the output: a motor inertia is J_motor * ratio**2 [kg m2], a stiffness
[N m/rad] and an angle [rad] are those seen at the output flange. The numbers are of the size that
catalogues give for reducers of robot joints (e.g. 1 to 3 MN m/rad for a heavy cycloidal reducer,
10 to 30 kN m/rad for a small strain wave gear), not those of a particular product.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .kinds import Floats, Gearbox, Half, rng_of


@dataclass(frozen=True)
class Design:
    """Nominal numbers of an axis type.

    ratio: motor turns per output turn. in_turns, mid_turns: turns of the wheel that the input and
    the middle error table repeat with, per output turn. z_in, z_mid, z_out: teeth (mesh cycles) per
    turn of those wheels. poles: motor pole pairs. inertias: motor, gear, arm [kg m2].
    payload: range of added inertia [kg m2]. k_in, k_out: stiffness of input and output stage
    [N m/rad]. accel: range [rad/s2]. speed: range [rad/s]. travel: full range of angle [rad].
    friction: motor side Coulomb share of nominal torque. gravity: share of nominal torque.
    servo_hz: bandwidth of the speed loop. mesh: force of mesh errors over nominal torque.
    balls: rolling elements of the input bearing. play_in: play fault sits in the input stage.
    play, notch: fault sizes as multiples of the wind-up at nominal torque.
    rub: level of rolling/sliding noise, whine: level of motor noise, both over nominal torque.
    notch_width: width of the damage as a share of the tooth pitch.
    """

    axis: str
    ratio: float
    in_turns: float
    z_in: int
    mid_turns: float
    z_mid: int
    z_out: int
    poles: int
    inertias: tuple[float, float, float]
    payload: tuple[float, float]
    k_in: float
    k_out: float
    speed: tuple[float, float]
    accel: tuple[float, float]
    travel: float
    friction: float
    gravity: float
    servo_hz: float
    mesh: tuple[float, float, float]
    balls: int
    play_in: bool
    play: tuple[float, float]
    notch: tuple[float, float]
    rub: float
    whine: float
    notch_width: tuple[float, float] = (0.12, 0.4)


DESIGNS: dict[Half, dict[str, Design]] = {
    "work": {
        "rv": Design(
            "rv",
            121.0,
            121.0,
            15,
            40.0,
            40,
            40,
            5,
            (46.0, 2.2, 60.0),
            (0.0, 70.0),
            6.0e6,
            2.2e6,
            (0.7, 1.7),
            (2.0, 5.0),
            5.8,
            0.10,
            0.0,
            12.0,
            (0.004, 0.008, 0.010),
            9,
            False,
            (2.0, 26.0),
            (1.2, 10.0),
            0.008,
            0.004,
            notch_width=(0.2, 0.55),
        ),
        "harmonic": Design(
            "harmonic",
            100.0,
            100.0,
            19,
            100.0,
            2,
            200,
            6,
            (0.34, 0.012, 0.25),
            (0.0, 0.4),
            4.5e4,
            1.9e4,
            (1.8, 4.2),
            (8.0, 20.0),
            7.5,
            0.18,
            0.5,
            16.0,
            (0.003, 0.020, 0.008),
            8,
            False,
            (2.0, 22.0),
            (1.0, 10.0),
            0.010,
            0.006,
            notch_width=(0.2, 0.55),
        ),
        "planetary": Design(
            "planetary",
            40.0,
            32.0,
            18,
            7.0,
            21,
            63,
            4,
            (0.42, 0.035, 0.8),
            (0.0, 1.6),
            9.0e4,
            5.2e4,
            (1.4, 3.6),
            (5.0, 14.0),
            8.5,
            0.07,
            0.0,
            18.0,
            (0.012, 0.009, 0.012),
            7,
            False,
            (4.0, 40.0),
            (2.0, 16.0),
            0.007,
            0.005,
            notch_width=(0.2, 0.55),
        ),
        "belt": Design(
            "belt",
            60.0,
            60.0,
            28,
            10.0,
            23,
            70,
            3,
            (1.1, 0.14, 2.2),
            (0.0, 3.0),
            2.4e4,
            1.6e5,
            (1.1, 2.8),
            (3.5, 9.0),
            7.0,
            0.09,
            0.35,
            9.0,
            (0.010, 0.014, 0.012),
            10,
            False,
            (3.0, 40.0),
            (1.0, 12.0),
            0.007,
            0.004,
        ),
    },
    "final": {
        "rv": Design(
            "rv",
            153.0,
            153.0,
            12,
            51.0,
            52,
            52,
            4,
            (70.0, 3.6, 110.0),
            (10.0, 160.0),
            4.2e6,
            3.1e6,
            (0.6, 1.5),
            (1.6, 4.0),
            6.1,
            0.12,
            0.0,
            10.0,
            (0.006, 0.006, 0.012),
            8,
            False,
            (2.0, 24.0),
            (0.5, 5.0),
            0.009,
            0.003,
        ),
        "harmonic": Design(
            "harmonic",
            80.0,
            80.0,
            23,
            80.0,
            2,
            160,
            7,
            (0.16, 0.008, 0.16),
            (0.0, 0.2),
            2.0e4,
            1.1e4,
            (2.0, 5.0),
            (10.0, 24.0),
            6.6,
            0.20,
            0.6,
            14.0,
            (0.004, 0.026, 0.010),
            11,
            True,
            (2.5, 26.0),
            (0.5, 5.0),
            0.012,
            0.008,
        ),
        "planetary": Design(
            "planetary",
            28.0,
            21.0,
            24,
            4.9,
            28,
            72,
            4,
            (0.28, 0.03, 0.9),
            (0.1, 1.2),
            7.0e4,
            4.1e4,
            (1.6, 4.4),
            (6.0, 16.0),
            9.5,
            0.06,
            0.3,
            15.0,
            (0.016, 0.012, 0.010),
            9,
            False,
            (2.0, 28.0),
            (0.5, 5.0),
            0.006,
            0.007,
        ),
        "belt": Design(
            "belt",
            48.0,
            48.0,
            32,
            12.0,
            19,
            57,
            5,
            (0.9, 0.10, 1.7),
            (0.2, 2.4),
            3.0e4,
            1.2e5,
            (1.2, 3.2),
            (4.0, 10.0),
            6.8,
            0.10,
            0.0,
            8.0,
            (0.014, 0.010, 0.014),
            8,
            False,
            (3.0, 36.0),
            (0.8, 7.0),
            0.008,
            0.005,
        ),
        "worm": Design(
            "worm",
            50.0,
            50.0,
            20,
            50.0,
            2,
            50,
            3,
            (0.8, 0.09, 1.2),
            (0.0, 1.5),
            1.2e5,
            6.0e4,
            (0.9, 2.2),
            (3.0, 8.0),
            7.4,
            0.30,
            0.2,
            12.0,
            (0.006, 0.022, 0.012),
            9,
            False,
            (2.0, 26.0),
            (0.5, 5.0),
            0.012,
            0.005,
        ),
    },
}

IN_HOUSE = 6
"""Gearboxes of an axis that a library may be made of; the rest are held out."""
PER_AXIS: dict[Half, int] = {"work": 12, "final": 11}
TABLE = 8192
MESH, RUB, WHINE, FAN = 2.0, 4.5, 3.5, 6.0
"""Levels common to all axes, set so that recordings look like those of real axes."""
TABLE_OUT = 65536


@dataclass(frozen=True, eq=False)
class Unit:
    """The numbers of one gearbox, manufacturing scatter applied (units as in `Design`)."""

    design: Design
    j: tuple[float, float, float]
    k_in: float
    k_out: float
    damp: tuple[float, float]
    nominal_nm: float
    windup_rad: float
    play_new_rad: float
    coulomb_nm: float
    stribeck: float
    viscous: float
    out_coulomb_nm: float
    load_friction: float
    gravity_nm: float
    servo_hz: float
    lag_s: float
    feed_forward: float
    te_in: Floats
    te_mid: Floats
    te_out: Floats
    stiff: Floats
    ripple: Floats
    cog: Floats
    rub: float
    whine: float
    fan: float
    fan_hz: float


def scatter(rng: np.random.Generator, half: Half, value: float, share: float) -> float:
    """A drawn value around `value`: log-normal in the work half, uniform in the final half."""
    if half == "work":
        return value * float(np.exp(share * np.clip(rng.standard_normal(), -2.2, 2.2)))
    return value * float(1.0 + 1.6 * share * rng.uniform(-1.0, 1.0))


def error_table(
    rng: np.random.Generator,
    size: int,
    teeth: int,
    mesh: float,
    runout: float,
    pitch: float,
    slope: float,
) -> Floats:
    """Transmission error over one turn of a wheel.

    mesh, runout, pitch: amplitudes [rad at the output] of the tooth mesh (with harmonics falling
    as order**-slope), of the orders 1 to 3, and of tooth to tooth pitch errors.
    """
    x = np.arange(size) * (2.0 * np.pi / size)
    out = np.zeros(size)
    for h in range(1, 8):
        a = mesh * h**-slope * rng.uniform(0.4, 1.4)
        out += a * np.sin(h * teeth * x + rng.uniform(0, 2 * np.pi))
    # eccentricity: slow run-out, and the mesh in its rhythm
    ecc = rng.uniform(0.05, 0.25)
    out *= 1.0 + ecc * np.sin(x + rng.uniform(0, 2 * np.pi))
    for h in (1, 2, 3):
        out += runout * h**-1.5 * rng.uniform(0.3, 1.3) * np.sin(h * x + rng.uniform(0, 2 * np.pi))
    if pitch > 0 and teeth > 3:
        err = pitch * rng.standard_normal(teeth)
        at = x * (teeth / (2 * np.pi))
        k = np.floor(at).astype(int)
        w = 0.5 - 0.5 * np.cos(np.pi * (at - k))
        out += (1 - w) * err[k % teeth] + w * err[(k + 1) % teeth]
    return out


def gearboxes(half: Half) -> list[Gearbox]:
    """All gearboxes of a half; the first `IN_HOUSE` of each axis may be in a library."""
    return [Gearbox(half, axis, n, held_out=n >= IN_HOUSE) for axis in DESIGNS[half] for n in range(PER_AXIS[half])]


@lru_cache(maxsize=256)
def unit_of(box: Gearbox) -> Unit:
    """Draw the numbers of one gearbox."""
    d = DESIGNS[box.half][box.axis]
    half = box.half
    rng = rng_of("gearbox", box.name)

    def s(value: float, share: float) -> float:
        return scatter(rng, half, value, share)

    j0, j1, j2 = (s(v, 0.04) for v in d.inertias)
    k_in, k_out = s(d.k_in, 0.12), s(d.k_out, 0.12)
    load = d.inertias[2] + 0.5 * sum(d.payload)
    nominal = load * 0.5 * sum(d.accel)
    windup = nominal / d.k_out
    zeta = (s(0.035, 0.3), s(0.045, 0.3))
    m_in, m_mid, m_out = (MESH * s(v, 0.35) * windup for v in d.mesh)
    slope = 1.3 if half == "work" else 1.0
    x = np.arange(TABLE) * (2 * np.pi / TABLE)
    ripple = np.zeros(TABLE)
    cog = np.zeros(TABLE)
    for order, level in ((1, 0.004), (2 * d.poles, 0.004), (6 * d.poles, 0.008)):
        ripple += s(level, 0.4) * np.sin(order * x + rng.uniform(0, 2 * np.pi))
    slots = 12 if half == "work" else 9
    cog += s(0.006, 0.4) * nominal * np.sin(np.lcm(slots, 2 * d.poles) * x)
    xo = np.arange(TABLE_OUT) * (2 * np.pi / TABLE_OUT)
    stiff = 1.0 + s(0.03, 0.3) * np.sin(d.z_out * xo) + s(0.01, 0.3) * np.sin(2 * d.z_out * xo + 1)
    return Unit(
        design=d,
        j=(j0, j1, j2),
        k_in=k_in,
        k_out=k_out,
        damp=(2 * zeta[0] * np.sqrt(k_in * j1), 2 * zeta[1] * np.sqrt(k_out * j1)),
        nominal_nm=nominal,
        windup_rad=windup,
        play_new_rad=windup * (rng.uniform(0.1, 0.5) if half == "work" else s(0.3, 0.4)),
        coulomb_nm=s(d.friction * nominal, 0.2),
        stribeck=s(0.35, 0.3),
        viscous=s(0.08, 0.25) * nominal / d.speed[1],
        out_coulomb_nm=s(0.05, 0.3) * nominal,
        load_friction=s(0.03, 0.3),
        gravity_nm=s(d.gravity, 0.1) * nominal,
        servo_hz=s(d.servo_hz, 0.08),
        lag_s=s(0.0012, 0.15),
        feed_forward=min(1.0, s(0.85, 0.08)),
        te_in=error_table(rng, TABLE, d.z_in, m_in, 2.0 * m_in, 0.3 * m_in, slope),
        te_mid=error_table(rng, TABLE, d.z_mid, m_mid, 1.5 * m_mid, 0.5 * m_mid, slope),
        te_out=error_table(rng, TABLE_OUT, d.z_out, m_out, 20.0 * m_out, 1.2 * m_out, slope),
        stiff=stiff,
        ripple=ripple,
        cog=cog,
        rub=RUB * s(d.rub, 0.3),
        whine=WHINE * s(d.whine, 0.4),
        fan=FAN * s(0.0025, 0.5),
        fan_hz=rng.uniform(110, 260) if half == "work" else rng.uniform(150, 420),
    )
