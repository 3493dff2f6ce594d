"""The motion of a robot axis back and forth, and the servo that follows it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim.chain.components import ServoDrive
from sim.description.axis import Axis
from sim.description.transmission import compliance
from sim.rotational.drive_train import DriveTrain

Array = NDArray[np.float64]


def back_and_forth(time_s: Array, period_s: float, top_speed: float, ramp_s: float, dwell_s: float = 0.0) -> Array:
    """Angle, speed and acceleration of a motion from 0 to its far end and back, shape (3, n).

    Speed rises and falls as sin^2 within `ramp_s` (jerk without jumps); the stroke follows from the other values:
    top_speed (period / 2 - dwell - ramp).
    """
    half = 0.5 * period_s
    cruise = half - dwell_s - 2 * ramp_s
    cycle = np.floor(time_s / half)
    backward = cycle % 2 == 1
    t = time_s - cycle * half
    falling = np.clip(t - ramp_s - cruise, 0, ramp_s)
    speed = np.where(falling < ramp_s, 1.0, 0.0)
    travel = np.clip(t - 0.5 * ramp_s, 0, cruise + ramp_s)
    bend = np.zeros_like(t)
    turn = math.pi / ramp_s
    for within, since, sign in ((t < ramp_s, t, 1.0), ((falling > 0) & (falling < ramp_s), falling, -1.0)):
        x = turn * since[within]
        sine = np.sin(x)
        speed[within] = 0.5 * (1 - sign * np.cos(x))
        bend[within] = sign * 0.5 * turn * sine
        start = 0.0 if sign > 0 else 0.5 * ramp_s + cruise
        travel[within] = start + 0.5 * (since[within] - sign * sine / turn)
    travel[backward] = ramp_s + cruise - travel[backward]
    speed[backward] *= -1
    bend[backward] *= -1
    return top_speed * np.stack([travel, speed, bend])


def servo_drive(axis: Axis) -> ServoDrive:
    """The servo of an axis along its `motion`; what the description leaves open is chosen from inertias and stiffness.

    The speed loop's bandwidth is a third of the lowest torsional frequency with the motor locked, but at least 60 rad/s
    (a servo that is tuned to suppress, not to excite); the position loop is a sixth of it, integral time 4 / bandwidth.
    """
    ratio = axis.ratio
    load = axis.load.inertia_kg_m2 + (axis.stages[-1].inertia_kg_m2 if axis.stages else 0.0)
    inertia = axis.motor.inertia_kg_m2 + load / ratio**2
    inertia += sum(s.inertia_kg_m2 * (axis.ratio_from(s.name) / ratio) ** 2 for s in axis.stages[:-1])
    lowest = 1 / math.sqrt(compliance(axis) * load) if axis.stages else 300.0
    bandwidth = axis.servo.speed_bandwidth_rad_s or max(60.0, lowest / 3)
    motion = axis.motion
    top = motion.load_speed_rad_s * ratio
    friction = axis.motor.coulomb_friction_n_m + axis.motor.viscous_friction_n_m_s_per_rad * top
    friction += (
        axis.load.coulomb_friction_n_m + axis.load.viscous_friction_n_m_s_per_rad * motion.load_speed_rad_s
    ) / ratio
    needed = inertia * top * math.pi / 2 / motion.acceleration_time_s + friction
    return ServoDrive(
        period=motion.period_s,
        top_speed=top,
        ramp=motion.acceleration_time_s,
        dwell=motion.dwell_s,
        position_gain=axis.servo.position_gain_per_s or bandwidth / 6,
        speed_gain=inertia * bandwidth,
        integral_time=axis.servo.integral_time_s or 4 / bandwidth,
        feed_forward_inertia=inertia,
        torque_limit=min(axis.motor.torque_limit_n_m, 4 * needed),
        speed_limit=min(axis.motor.speed_limit_rad_s, 2 * top),
    )


def moving(train: DriveTrain, axis: Axis) -> DriveTrain:
    """The train of `axis`, driven back and forth by its servo."""
    return train.add("drive", servo_drive(axis), flange="motor.flange_a")
