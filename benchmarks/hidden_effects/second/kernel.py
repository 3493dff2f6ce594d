"""Equations of motion of a two-stage servo axis, integrated by the semi-implicit Euler method at a fixed rate.

Three shafts turn about one axis each: motor, transfer shaft, output with the load; a mass may hang on the load by a
spring.  A mesh carries a torque at its driven gear; its twist is driver angle / ratio - driven angle - tooth error.
A servo works on reference position, speed and acceleration, its current follows with a first-order lag.

Coulomb friction is set-valued and integrated implicitly (Moreau's time-stepping: V. Acary, B. Brogliato, Numerical
Methods for Nonsmooth Dynamical Systems, Springer 2008), or smooth in tanh(speed / stick speed).
Stribeck: B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994) 1083.
Hysteresis of the output follows Dahl's law (P. R. Dahl, A solid friction model, Aerospace Corp. 1968).
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

SECOND_HARMONIC = 0.3
"""Amplitude of the tooth error at twice the mesh order, over that at the mesh order."""
LOSS_SPEED = 0.02
"""Speed of the driving shaft [rad/s] at which the loss of a mesh has most of its torque."""


class Mesh(NamedTuple):
    """One pair of gears; a named tuple, which compiled code reads by name.  All values are floats.

    Stiffness [N m/rad], damping [N m s/rad], backlash (total), tooth error and eccentricity [rad] at the driven gear.
    The tooth error has `error` as amplitude at mesh order, with phases of both harmonics; `cubic` [1/rad2] hardens
    the spring.  One tooth gives way by `damage_depth` [rad] about `damage_angle` [rad] of the driven gear, on the
    flank that carries positive torque (`damage_flank` 1) or negative (-1).
    """

    ratio: float
    driver_teeth: float
    stiffness: float
    damping: float
    backlash: float
    error: float
    phase: float
    second_phase: float
    eccentricity: float = 0.0
    eccentricity_phase: float = 0.0
    cubic: float = 0.0
    damage_depth: float = 0.0
    damage_angle: float = 0.0
    damage_flank: float = 1.0


class Axis(NamedTuple):
    """All parameters of an axis; all values but the meshes are floats.

    Inertias [kg m2] (the load's with what is attached to it), Coulomb friction [N m] and viscous friction
    [N m s/rad] of motor and load.  All friction is multiplied by 1 + `friction_asymmetry` sign(speed) and
    1 + `friction_drift` t.  `stribeck_torque` [N m] falls with motor speed over `stribeck_speed` [rad/s] as exp(-x^2)
    (`stribeck_gaussian` 1) or exp(-x) (0).  `stick_speed` [rad/s of the motor] is 0 for true stiction.
    The load feels -`gravity_torque` sin(angle + phase), the motor `ripple_torque` sin(order angle + phase).
    Hysteresis acts beside the output mesh, its torque [N m] grows over `hysteresis_twist` [rad].
    The servo's gains refer to the motor [N m/rad, N m s/rad, N m/(rad s)], its `feedforward` is an inertia [kg m2].
    """

    transfer: Mesh
    output: Mesh
    motor_inertia: float
    transfer_inertia: float
    load_inertia: float
    motor_coulomb: float
    motor_viscous: float
    load_coulomb: float
    load_viscous: float
    output_efficiency: float
    stick_speed: float
    position_gain: float
    speed_gain: float
    integral_gain: float
    feedforward: float
    current_lag: float
    torque_limit: float = 0.0
    friction_asymmetry: float = 0.0
    friction_drift: float = 0.0
    stribeck_torque: float = 0.0
    stribeck_speed: float = 20.0
    stribeck_gaussian: float = 0.0
    gravity_torque: float = 0.0
    gravity_phase: float = 0.0
    ripple_torque: float = 0.0
    ripple_order: float = 0.0
    ripple_phase: float = 0.0
    hysteresis_torque: float = 0.0
    hysteresis_twist: float = 1.0
    attached_inertia: float = 0.0
    attached_stiffness: float = 0.0
    attached_damping: float = 0.0


@numba.njit(cache=True, fastmath=False)
def tooth_profile(angle, middle, pitch):
    """Return which share of a tooth's full depth shows at `angle` [rad], and its slope [1/rad].

    All of it over seven tenths of the pitch, with raised cosines beside.
    """
    away = (angle - middle) % (2 * np.pi)
    if away > np.pi:
        away -= 2 * np.pi
    side = 1.0 if away >= 0 else -1.0
    away = abs(away) / pitch
    if away <= 0.35:
        return 1.0, 0.0
    if away >= 0.65:
        return 0.0, 0.0
    u = (away - 0.35) / 0.3 * np.pi
    return 0.5 * (1 + np.cos(u)), -0.5 * np.sin(u) * np.pi / 0.3 / pitch * side


@numba.njit(cache=True)
def contact_torque(mesh, twist, rate, upper, lower, upper_rate, lower_rate):
    """Return the torque [N m] at the driven gear: none within the play, and teeth do not pull.

    The upper flank gives way by `upper` [rad], the lower one by `lower`, at the rates [rad/s].
    """
    high = 0.5 * mesh.backlash + upper
    low = -0.5 * mesh.backlash - lower
    if twist > high:
        x = twist - high
        return max(0.0, mesh.stiffness * x * (1 + mesh.cubic * x * x) + mesh.damping * (rate - upper_rate))
    if twist < low:
        x = twist - low
        return min(0.0, mesh.stiffness * x * (1 + mesh.cubic * x * x) + mesh.damping * (rate + lower_rate))
    return 0.0


@numba.njit(cache=True)
def _tooth_error(mesh, driver_angle, driver_speed, driven_angle, driven_speed):
    """Return the tooth error [rad] and its rate [rad/s] at the driven gear."""
    first = mesh.driver_teeth * driver_angle + mesh.phase
    second = 2 * mesh.driver_teeth * driver_angle + mesh.second_phase
    turn = driven_angle + mesh.eccentricity_phase
    error = mesh.error * (np.sin(first) + SECOND_HARMONIC * np.sin(second)) + mesh.eccentricity * np.sin(turn)
    waves = np.cos(first) + 2 * SECOND_HARMONIC * np.cos(second)
    rate = mesh.error * mesh.driver_teeth * driver_speed * waves + mesh.eccentricity * driven_speed * np.cos(turn)
    return error, rate


@numba.njit(cache=True)
def _mesh_torque(mesh, driver_angle, driver_speed, driven_angle, driven_speed):
    """Return the torque at the driven gear [N m] and the rate of the twist [rad/s]."""
    error, error_rate = _tooth_error(mesh, driver_angle, driver_speed, driven_angle, driven_speed)
    upper, lower, upper_rate, lower_rate = 0.0, 0.0, 0.0, 0.0
    if mesh.damage_depth > 0.0:
        share, slope = tooth_profile(driven_angle, mesh.damage_angle, 2 * np.pi / (mesh.driver_teeth * mesh.ratio))
        if mesh.damage_flank > 0:
            upper = mesh.damage_depth * share
            upper_rate = mesh.damage_depth * slope * driven_speed
        else:
            lower = mesh.damage_depth * share
            lower_rate = mesh.damage_depth * slope * driven_speed
    twist = driver_angle / mesh.ratio - driven_angle - error
    rate = driver_speed / mesh.ratio - driven_speed - error_rate
    return contact_torque(mesh, twist, rate, upper, lower, upper_rate, lower_rate), rate


@numba.njit(cache=True)
def _lossy(torque, speed, efficiency):
    """Return what a mesh takes from its driver and gives to its driven gear [N m]; the driven side bears the loss."""
    direction = np.tanh(speed / LOSS_SPEED)
    loss = (1 - efficiency) * abs(torque) * direction
    if torque * direction > 0:
        return torque, torque - loss
    return torque + loss, torque


@numba.njit(cache=True)
def _friction(axis, motor_speed, load_speed, time):
    """Return of motor and load the limit of dry friction [N m] and the viscous coefficient [N m s/rad]."""
    drift = 1.0 + axis.friction_drift * max(0.0, time)
    if axis.stribeck_gaussian > 0.5:
        fall = np.exp(-((motor_speed / axis.stribeck_speed) ** 2))
    else:
        fall = np.exp(-abs(motor_speed) / axis.stribeck_speed)
    motor_side = 1 + axis.friction_asymmetry * (1.0 if motor_speed >= 0 else -1.0)
    load_side = 1 + axis.friction_asymmetry * (1.0 if load_speed >= 0 else -1.0)
    motor_dry = (axis.motor_coulomb * drift + axis.stribeck_torque * fall) * motor_side
    load_dry = axis.load_coulomb * drift * load_side
    return motor_dry, axis.motor_viscous * (motor_side * drift), load_dry, axis.load_viscous * (load_side * drift)


@numba.njit(cache=True)
def _next_speed(speed, torque, dry, inertia, step, scale, stick_speed):
    """Return the speed [rad/s] after a step; `scale` refers it to the motor for smooth friction."""
    if stick_speed > 0:
        return speed + step * (torque - dry * np.tanh(speed * scale / stick_speed)) / inertia
    free = speed + step * torque / inertia
    hold = step * dry / inertia
    if free > hold:
        return free - hold
    if free < -hold:
        return free + hold
    return 0.0


@numba.njit(cache=True)
def run(axis, position, speed, acceleration, load_torque, step, steps_per_sample, steps_per_servo, start):
    """Integrate an axis over all given steps of `step` seconds; time starts at `start` [s].

    `position` [rad], `speed` [rad/s], `acceleration` [rad/s2] of the motor as wanted and the disturbing `load_torque`
    [N m] are given at every step.  Returns (samples, 5): motor torque [N m], motor angle, load angle [rad],
    motor speed, load speed [rad/s]; and (servo cycles, 2): mean torques [N m] of both meshes at the driven gear.

    Short names: suffixes m, t, l, a for motor, transfer shaft, load and attached mass.
    """
    transfer, output = axis.transfer, axis.output
    ratio = transfer.ratio * output.ratio
    signals = np.zeros((len(position) // steps_per_sample, 5))
    mesh_torques = np.zeros((len(position) // steps_per_servo, 2))
    angle_m, angle_t, angle_l = position[0], position[0] / transfer.ratio, position[0] / ratio
    speed_m, speed_t, speed_l = speed[0], speed[0] / transfer.ratio, speed[0] / ratio
    angle_a, speed_a = angle_l, speed_l
    torque, command, integral, hysteresis = 0.0, 0.0, 0.0, 0.0
    for j in range(len(position)):
        cycle = j // steps_per_servo
        if j % steps_per_servo == 0:
            error = position[j] - angle_m
            integral += axis.integral_gain * error * step * steps_per_servo
            wanted = axis.position_gain * error + axis.speed_gain * (speed[j] - speed_m) + integral
            wanted += axis.feedforward * acceleration[j]
            command = min(axis.torque_limit, max(-axis.torque_limit, wanted))
        if j % steps_per_sample == 0:
            signals[j // steps_per_sample] = (torque, angle_m, angle_l, speed_m, speed_l)
        torque += (command - torque) * step / axis.current_lag
        torque_t, _ = _mesh_torque(transfer, angle_m, speed_m, angle_t, speed_t)
        torque_l, rate = _mesh_torque(output, angle_t, speed_t, angle_l, speed_l)
        if axis.hysteresis_torque > 0:
            side = 1.0 if rate > 0 else -1.0
            hysteresis += rate / axis.hysteresis_twist * (1 - side * hysteresis) * step
            hysteresis = min(1.0, max(-1.0, hysteresis))
            torque_l += axis.hysteresis_torque * hysteresis
        mesh_torques[cycle, 0] += torque_t / steps_per_servo
        mesh_torques[cycle, 1] += torque_l / steps_per_servo
        taken, given = _lossy(torque_l, speed_t, axis.output_efficiency)
        dry_m, viscous_m, dry_l, viscous_l = _friction(axis, speed_m, speed_l, start + j * step)
        ripple = axis.ripple_torque * np.sin(axis.ripple_order * angle_m + axis.ripple_phase)
        on_m = torque + ripple - torque_t / transfer.ratio - viscous_m * speed_m
        gravity = axis.gravity_torque * np.sin(angle_l + axis.gravity_phase)
        on_l = given - viscous_l * speed_l - gravity + load_torque[j]
        if axis.attached_inertia > 0:
            torque_a = axis.attached_stiffness * (angle_l - angle_a) + axis.attached_damping * (speed_l - speed_a)
            on_l -= torque_a
            speed_a += step * torque_a / axis.attached_inertia
        speed_m = _next_speed(speed_m, on_m, dry_m, axis.motor_inertia, step, 1.0, axis.stick_speed)
        held = axis.load_inertia - axis.attached_inertia
        speed_l = _next_speed(speed_l, on_l, dry_l, held, step, ratio, axis.stick_speed)
        speed_t += step * (torque_t - taken / output.ratio) / axis.transfer_inertia
        angle_m += step * speed_m
        angle_t += step * speed_t
        angle_l += step * speed_l
        angle_a += step * speed_a
    return signals, mesh_torques
