"""The joint's equations of motion, integrated by the semi-implicit Euler method at a high fixed rate.

Bodies turn about one axis each; a link carries a torque from body `start` to body `end` and is written at its
end: twist x = angle_start / ratio - angle_end - e, where e is the composite tooth error of both gears.  Its
generalised forces are -F dx/d(angle), so the tooth error does no spurious work.  Friction is the LuGre model
(Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40 (1995) 419), its bristle state integrated implicitly.
A hysteretic torque follows Dahl's law in parallel with the link's spring.
"""

from __future__ import annotations

import math

import numba
import numpy as np

STEP_RATE_HZ = 32_000
SERVO_RATE_HZ = 4_000
TELEMETRY_RATE_HZ = 2_000

# columns of `links`
RATIO, STIFFNESS, DAMPING, GAP, SOFTNESS, CUBIC, HYSTERESIS, YIELD_TWIST, LOSS, LOSS_SPEED, LOUDNESS, TEETH = range(12)
# columns of `frictions` (row 0: motor, row 1: load)
(
    COULOMB_FORWARD,
    COULOMB_BACKWARD,
    VISCOUS_FORWARD,
    VISCOUS_BACKWARD,
    STRIBECK,
    STRIBECK_SPEED,
    STRIBECK_EXPONENT,
    BRISTLE_STIFFNESS,
    BRISTLE_DAMPING,
    ANGLE_VISCOUS,
    ANGLE_ORDER,
    ANGLE_PHASE,
    BAND_TORQUE,
    BAND_SPEED,
    BAND_WIDTH,
    QUADRATIC,
) = range(16)
# entries of `servo`
POSITION_GAIN, SPEED_GAIN, INTEGRAL_GAIN, INERTIA_FEEDFORWARD, ENCODER_STEP, CURRENT_LAG, SPEED_FILTER, LIMIT = range(8)
# entries of `loads`
GRAVITY, GRAVITY_PHASE, RIPPLE, RIPPLE_ORDER, RIPPLE_PHASE, DRIFT_RATE, DRIFT_START = range(7)


@numba.njit(cache=True, fastmath=False)
def _friction(row, speed, angle, bristle, scale, step):
    """Return friction torque [N m] and the new bristle deflection [rad]."""
    magnitude = abs(speed)
    level = row[COULOMB_FORWARD] if speed >= 0.0 else row[COULOMB_BACKWARD]
    if row[STRIBECK] != 0.0:
        level += row[STRIBECK] * math.exp(-((magnitude / row[STRIBECK_SPEED]) ** row[STRIBECK_EXPONENT]))
    if row[BAND_TORQUE] != 0.0:
        level += row[BAND_TORQUE] * math.exp(-(((magnitude - row[BAND_SPEED]) / row[BAND_WIDTH]) ** 2))
    viscous = row[VISCOUS_FORWARD] if speed >= 0.0 else row[VISCOUS_BACKWARD]
    if row[ANGLE_VISCOUS] != 0.0:
        viscous *= 1.0 + row[ANGLE_VISCOUS] * math.cos(row[ANGLE_ORDER] * angle + row[ANGLE_PHASE])
    torque = scale * viscous * speed + row[QUADRATIC] * magnitude * speed
    level *= scale
    if level <= 0.0:
        return torque, 0.0
    stiffness = row[BRISTLE_STIFFNESS]
    new = (bristle + step * speed) / (1.0 + step * stiffness * magnitude / level)
    rate = (new - bristle) / step
    return torque + stiffness * new + row[BRISTLE_DAMPING] * rate, new


@numba.njit(cache=True)
def _lookup(values, slopes, table, angle):
    """Interpolate one tooth error table, periodic in 2 pi."""
    cells = values.shape[1] - 1
    turn = angle / (2.0 * math.pi)
    place = (turn - math.floor(turn)) * cells
    cell = min(int(place), cells - 1)
    part = place - cell
    value = values[table, cell] * (1.0 - part) + values[table, cell + 1] * part
    slope = slopes[table, cell] * (1.0 - part) + slopes[table, cell + 1] * part
    return value, slope


@numba.njit(cache=True)
def _contact(row, twist, rate):
    """Return the elastic and the damping torque [N m] of one link."""
    half = 0.5 * row[GAP]
    if half == 0.0:
        return row[STIFFNESS] * twist * (1.0 + row[CUBIC] * twist * twist), row[DAMPING] * rate
    if abs(twist) <= half:
        return 0.0, 0.0
    side = 1.0 if twist > 0.0 else -1.0
    depth = abs(twist) - half
    elastic = row[STIFFNESS] * depth * (1.0 + row[CUBIC] * depth * depth)
    damping = row[DAMPING] * rate * side * depth / (depth + row[SOFTNESS])
    return side * elastic, side * max(damping, -elastic)


@numba.njit(cache=True)
def run(
    inertias, starts, ends, links, frictions, load_body, servo, loads, disturbance, reference, values, slopes, samples
):
    """Integrate `samples` telemetry samples.

    `reference` (3, n) at the servo's rate: position [rad], speed [rad/s], acceleration [rad/s2] of the motor.
    `disturbance` (samples + 1) at the telemetry's rate: torque on the load [N m].
    Returns telemetry (4, samples): motor torque [N m], motor angle [rad], load angle [rad], motor speed [rad/s];
    mesh force (samples * 16) at the step rate; energy (5): work of the motor, work of gravity, ripple and
    disturbance, dissipation in friction, dissipation in links, change of stored energy [J].
    """
    step = 1.0 / STEP_RATE_HZ
    per_sample = STEP_RATE_HZ // TELEMETRY_RATE_HZ
    per_servo = STEP_RATE_HZ // SERVO_RATE_HZ
    bodies = inertias.shape[0]
    angle = np.zeros(bodies)
    speed = np.zeros(bodies)
    angle[0] = reference[0, 0]
    speed[0] = reference[1, 0]
    for link in range(starts.shape[0]):
        angle[ends[link]] = angle[starts[link]] / links[link, RATIO]
        speed[ends[link]] = speed[starts[link]] / links[link, RATIO]
    hysteretic = np.zeros(starts.shape[0])
    bristles = np.zeros(2)
    torques = np.zeros(bodies)
    telemetry = np.empty((4, samples))
    sound = np.empty(samples * per_sample, dtype=np.float32)
    energy = np.zeros(5)
    energy[4] = -_stored(inertias, speed, starts, ends, links, angle, values, slopes, hysteretic)
    integral = 0.0
    seen_before = angle[0]
    seen_speed = speed[0]
    command = 0.0
    waiting = 0.0
    motor_torque = 0.0
    for n in range(samples * per_sample):
        now = n * step
        if n % per_servo == 0:
            k = n // per_servo
            command = waiting
            seen = angle[0]
            if servo[ENCODER_STEP] > 0.0:
                seen = math.floor(seen / servo[ENCODER_STEP] + 0.5) * servo[ENCODER_STEP]
            raw = (seen - seen_before) * SERVO_RATE_HZ
            seen_speed += servo[SPEED_FILTER] * (raw - seen_speed)
            seen_before = seen
            wanted = reference[1, k] + servo[POSITION_GAIN] * (reference[0, k] - seen)
            error = wanted - seen_speed
            integral += servo[INTEGRAL_GAIN] * error / SERVO_RATE_HZ
            waiting = servo[SPEED_GAIN] * error + integral + servo[INERTIA_FEEDFORWARD] * reference[2, k]
            waiting = min(max(waiting, -servo[LIMIT]), servo[LIMIT])
        motor_torque += step / servo[CURRENT_LAG] * (command - motor_torque)
        if n % per_sample == 0:
            k = n // per_sample
            telemetry[0, k] = motor_torque
            telemetry[1, k] = angle[0]
            telemetry[2, k] = angle[load_body]
            telemetry[3, k] = speed[0]
        torques[:] = 0.0
        torques[0] = motor_torque
        lost = 0.0
        heard = 0.0
        for link in range(starts.shape[0]):
            a = starts[link]
            b = ends[link]
            row = links[link]
            twist = angle[a] / row[RATIO] - angle[b]
            rate = speed[a] / row[RATIO] - speed[b]
            slope_a = 0.0
            slope_b = 0.0
            if row[TEETH] >= 0.0:
                table = 3 * int(row[TEETH])
                value_a, slope_a = _lookup(values, slopes, table, angle[a])
                value_b, slope_b = _lookup(values, slopes, table + (1 if twist >= 0.0 else 2), angle[b])
                twist -= value_a + value_b
                rate -= slope_a * speed[a] + slope_b * speed[b]
            elastic, damping = _contact(row, twist, rate)
            if row[HYSTERESIS] > 0.0:
                before = hysteretic[link]
                drive = step * rate * row[HYSTERESIS] / row[YIELD_TWIST]
                hysteretic[link] = (before + drive) / (1.0 + abs(drive) / row[HYSTERESIS])
            carried = elastic + damping + hysteretic[link]
            torques[a] -= carried * (1.0 / row[RATIO] - slope_a)
            torques[b] += carried * (1.0 + slope_b)
            lost += damping * rate
            if row[LOSS] > 0.0:
                drag = row[LOSS] * abs(carried) * speed[b] / math.sqrt(speed[b] ** 2 + row[LOSS_SPEED] ** 2)
                torques[b] -= drag
                lost += drag * speed[b]
            heard += row[LOUDNESS] * carried
        sound[n] = heard
        scale = 1.0 + loads[DRIFT_RATE] * (loads[DRIFT_START] + now)
        drag_motor, bristles[0] = _friction(frictions[0], speed[0], angle[0], bristles[0], scale, step)
        drag_load, bristles[1] = _friction(frictions[1], speed[load_body], angle[load_body], bristles[1], scale, step)
        torques[0] -= drag_motor
        torques[load_body] -= drag_load
        ripple = 0.0
        if loads[RIPPLE] != 0.0:
            ripple = loads[RIPPLE] * math.cos(loads[RIPPLE_ORDER] * angle[0] + loads[RIPPLE_PHASE])
            torques[0] += ripple
        k = n // per_sample
        part = (n - k * per_sample) / per_sample
        outer = disturbance[k] * (1.0 - part) + disturbance[k + 1] * part
        if loads[GRAVITY] != 0.0:
            outer -= loads[GRAVITY] * math.sin(angle[load_body] + loads[GRAVITY_PHASE])
        torques[load_body] += outer
        for body in range(bodies):
            speed[body] += step * torques[body] / inertias[body]
            angle[body] += step * speed[body]
        energy[0] += step * motor_torque * speed[0]
        energy[1] += step * (outer * speed[load_body] + ripple * speed[0])
        energy[2] += step * (drag_motor * speed[0] + drag_load * speed[load_body])
        energy[3] += step * lost
    energy[4] += _stored(inertias, speed, starts, ends, links, angle, values, slopes, hysteretic)
    return telemetry, sound, energy


@numba.njit(cache=True)
def _stored(inertias, speed, starts, ends, links, angle, values, slopes, hysteretic):
    """Return kinetic plus elastic energy [J] (exact for links without gap and hardening: small otherwise)."""
    total = 0.0
    for body in range(inertias.shape[0]):
        total += 0.5 * inertias[body] * speed[body] ** 2
    for link in range(starts.shape[0]):
        row = links[link]
        twist = angle[starts[link]] / row[RATIO] - angle[ends[link]]
        if row[TEETH] >= 0.0:
            table = 3 * int(row[TEETH])
            twist -= _lookup(values, slopes, table, angle[starts[link]])[0]
            twist -= _lookup(values, slopes, table + (1 if twist >= 0.0 else 2), angle[ends[link]])[0]
        depth = max(abs(twist) - 0.5 * row[GAP], 0.0)
        total += row[STIFFNESS] * depth**2 * (0.5 + 0.25 * row[CUBIC] * depth**2)
    return total
