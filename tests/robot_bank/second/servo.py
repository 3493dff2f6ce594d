"""What happens when servos drive a robot along a program: torques, friction and motion, step by step.

A joint's motor is held by a position loop over a speed loop with an integral, both on its own encoder, with the torques
that the nominal rigid robot would take as feed-forward or without. Friction is that of C. Canudas de Wit et al. (A new
model for control of systems with friction, 1995), whose steady value grows with the torque carried and whose viscous
part is a power of the speed. All numbers are felt at the joint; a sliding joint has m and N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import mujoco
import numba
import numpy as np

from tests.robot_bank.multibody import Array
from tests.robot_bank.second.dynamics import STEP_S


@dataclass(frozen=True)
class Friction:
    """Friction of one joint.

    dry [N m]; loss: friction per torque carried; viscous [N m] at 1 rad/s and its power of the speed; way: over which
    dry friction builds up [rad]; inner: damping of the bristles [N m s/rad]; warming: growth of all of it over the log.
    Of what is wrong: stribeck [N m] is gone above stribeck_speed [rad/s]; asymmetry and drift [1/s] are shares of all.
    """

    dry: float
    loss: float
    viscous: float
    power: float
    way: float
    inner: float = 0.0
    warming: float = 0.0
    stribeck: float = 0.0
    stribeck_speed: float = 0.1
    asymmetry: float = 0.0
    drift: float = 0.0

    def steady(self, speed: Array, carried: Array | float = 0.0) -> Array:
        """Return the friction (n,) [N m] of speeds kept long [rad/s] under a torque carried [N m], at the start."""
        side = np.sign(speed)
        dry = self.dry + self.loss * np.abs(carried) + self.stribeck * np.exp(-((speed / self.stribeck_speed) ** 2))
        whole = side * dry + self.viscous * side * np.abs(speed) ** self.power
        return np.asarray(whole * (1 + self.asymmetry * side))


@dataclass(frozen=True)
class Servo:
    """Servo of one joint: gains of position [1/s], speed [N m s/rad] and its integral [N m/rad], how much of the torque
    and speed of the program is fed forward, its encoder's step [rad], its filter of speeds [Hz], its largest torque."""

    position: float
    speed: float
    integral: float
    torque_forward: float
    speed_forward: float
    step: float
    filter_hz: float
    limit: float


@dataclass(frozen=True)
class Drive:
    """A joint's drive. rotor [kg m2]; stiffness [N m/rad] and damping [N m s/rad] of its gear, 0 where it is rigid.

    constant: torque that the motor makes over what its drive counts. Of what is wrong: gap [rad] of the gear at its
    output; a missing counterweight asks imbalance sin(angle + imbalance_phase) [N m]; ripple [N m] has an order of the
    joint's angle.
    """

    friction: Friction
    servo: Servo
    rotor: float
    rated: float
    gear: float
    constant: float = 1.0
    stiffness: float = 0.0
    damping: float = 0.0
    gap: float = 0.0
    imbalance: float = 0.0
    imbalance_phase: float = 0.0
    ripple: float = 0.0
    ripple_order: float = 1.0
    ripple_phase: float = 0.0


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, at every step (m,): motors' angles, speeds, accelerations (m, n) over their gears, what the servos
    measured of angles and speeds, the torques that the drives count [N m], those that the gears carry, and the state of
    dry friction, -1 to 1."""

    time: Array
    angles: Array
    speeds: Array
    accelerations: Array
    measured: Array
    measured_speeds: Array
    torques: Array
    carried: Array
    side: Array


_FRICTION = [field.name for field in fields(Friction)]
_SERVO = [field.name for field in fields(Servo)]
_DRIVE = [field.name for field in fields(Drive)][2:]
(_DRY, _LOSS, _VISCOUS, _POWER, _WAY, _INNER, _WARMING, _STRIBECK, _STRIBECK_SPEED, _ASYMMETRY, _DRIFT) = range(11)
(_KP, _KV, _KI, _FORWARD, _SPEED_FORWARD, _STEP, _FILTER, _LIMIT) = range(11, 19)
(_ROTOR, _RATED, _GEAR, _CONSTANT, _STIFFNESS, _DAMPING, _GAP) = range(19, 26)
(_IMBALANCE, _IMBALANCE_PHASE, _RIPPLE, _RIPPLE_ORDER, _RIPPLE_PHASE) = range(26, 31)
(_BRISTLE, _SEEN, _SPEED, _SUM, _APPLIED) = range(5)
(_AT, _VELOCITY, _RATE, _MEASURED, _MEASURED_SPEED, _TORQUE, _CARRIED, _SIDE) = range(8)


def _row(drive: Drive) -> list[float]:
    parts = [(drive.friction, _FRICTION), (drive.servo, _SERVO), (drive, _DRIVE)]
    return [float(getattr(one, name)) for one, names in parts for name in names]


@numba.njit(cache=True)  # type: ignore[misc]
def _step(
    k: int, time: float, share: float, elastic: bool, angle: Array, speed: Array, rate: Array, applied: Array,
    wanted: Array, wanted_speed: Array, forward: Array, shaken: Array, numbers: Array, state: Array, out: Array,
) -> None:  # fmt: skip
    """Set the torques `applied` of one step; the arrays are those of the engine, `out` is what is kept of the step."""
    for j in range(numbers.shape[0]):
        p, s = numbers[j], state[j]
        i = 2 * j if elastic else j
        at, w = angle[i], speed[i]
        seen = np.round(at / p[_STEP]) * p[_STEP]
        s[_SPEED] += p[_FILTER] * ((seen - s[_SEEN]) / STEP_S - s[_SPEED])
        s[_SEEN] = seen
        slow = p[_KP] * (wanted[k, j] - seen) + p[_SPEED_FORWARD] * wanted_speed[k, j] - s[_SPEED]
        asked = p[_KV] * slow + s[_SUM] + p[_FORWARD] * forward[k, j]
        torque = min(max(asked, -p[_LIMIT]), p[_LIMIT])
        if asked == torque:
            s[_SUM] += p[_KI] * slow * STEP_S
        link = at
        if elastic:
            twist = angle[i + 1]
            link = at + twist
            half = 0.5 * p[_GAP]
            pressed = min(twist + half, 0.0) + max(twist - half, 0.0)
            spring = -p[_STIFFNESS] * pressed
            if pressed != 0.0 or half == 0.0:
                damped = -p[_DAMPING] * speed[i + 1]
                # flanks do not pull
                spring += damped if half == 0.0 else min(max(damped, -abs(spring)), abs(spring))
            carried = spring
        else:
            carried = s[_APPLIED] - p[_ROTOR] * rate[i]
        loaded = p[_DRY] + p[_LOSS] * abs(carried) + p[_STRIBECK] * np.exp(-((w / p[_STRIBECK_SPEED]) ** 2))
        rubbing = 0.0
        side = 0.0
        if loaded > 0.0:
            stiffness = loaded / p[_WAY] if p[_DRY] <= 0.0 else p[_DRY] / p[_WAY]
            most = loaded / stiffness
            end = most * np.sign(w)
            before = s[_BRISTLE]
            s[_BRISTLE] = end + (before - end) * np.exp(-abs(w) * STEP_S / most)
            side = s[_BRISTLE] / most
            rubbing = stiffness * s[_BRISTLE] + p[_INNER] * (s[_BRISTLE] - before) / STEP_S
        rubbing += p[_VISCOUS] * np.sign(w) * abs(w) ** p[_POWER]
        rubbing *= (1.0 + p[_ASYMMETRY] * side) * (1.0 + p[_DRIFT] * time + p[_WARMING] * share)
        turning = p[_CONSTANT] * torque + shaken[k, j] - rubbing
        turning += p[_RIPPLE] * np.sin(p[_RIPPLE_ORDER] * at + p[_RIPPLE_PHASE])
        weight = -p[_IMBALANCE] * np.sin(link + p[_IMBALANCE_PHASE])
        s[_APPLIED] = turning
        applied[i] = turning + weight
        if elastic:
            applied[i + 1] = spring + weight
        kept = out[k, j]
        kept[_AT], kept[_VELOCITY], kept[_MEASURED], kept[_MEASURED_SPEED] = at, w, seen, s[_SPEED]
        kept[_TORQUE], kept[_CARRIED], kept[_SIDE] = torque, carried, side


def run(
    moving: mujoco.MjModel,
    drives: Sequence[Drive],
    program: tuple[Array, Array],
    forward: Array,
    shaken: Array,
    lead_s: float,
    hold: Array,
) -> Run:
    """Let the servos follow a program.

    program: angles and speeds wanted (m, n), one every step; forward: torques of the nominal robot (m, n); shaken:
    torques (m, n) [N m] that disturb the motors; the log begins lead_s after the first step and ends as long before the
    last. hold: torques (n,) that carry the robot in the first pose, its springs and integrals being there before.
    """
    wanted, wanted_speed = (np.ascontiguousarray(part) for part in program)
    steps, n = wanted.shape
    elastic = moving.nv == 2 * n
    data = mujoco.MjData(moving)
    numbers = np.array([_row(drive) for drive in drives])
    numbers[:, _FILTER] = 1 - np.exp(-2 * np.pi * numbers[:, _FILTER] * STEP_S)
    state = np.zeros((n, 5))
    if elastic:
        data.qpos[::2] = wanted[0]
        pressed = -hold / numbers[:, _STIFFNESS]
        data.qpos[1::2] = pressed + 0.5 * numbers[:, _GAP] * np.sign(pressed)
    else:
        data.qpos[:] = wanted[0]
    state[:, _SEEN] = np.round(wanted[0] / numbers[:, _STEP]) * numbers[:, _STEP]
    state[:, _SUM] = hold / numbers[:, _CONSTANT] - numbers[:, _FORWARD] * forward[0]
    state[:, _APPLIED] = hold
    out = np.zeros((steps, n, 8))
    mujoco.mj_forward(moving, data)
    angle, speed, rate, applied = data.qpos, data.qvel, data.qacc, data.qfrc_applied
    forward, shaken = np.ascontiguousarray(forward), np.ascontiguousarray(shaken)
    seconds = steps * STEP_S - 2 * lead_s
    advance, kept = mujoco.mj_step, out[:, :, _RATE]
    motors = slice(None, None, 2 if elastic else 1)
    for k in range(steps):
        time = k * STEP_S - lead_s
        _step(
            k, time, time / seconds, elastic, angle, speed, rate, applied,
            wanted, wanted_speed, forward, shaken, numbers, state, out,
        )  # fmt: skip
        advance(moving, data)
        kept[k] = rate[motors]
    if not np.all(np.isfinite(out)) or any(one.number for one in data.warning):
        raise ArithmeticError("the simulation has come to no finite end")
    parts = {name: np.ascontiguousarray(out[:, :, column]) for name, column in _KEPT.items()}
    return Run(np.arange(steps) * STEP_S - lead_s, **parts)


_KEPT = {
    "angles": _AT,
    "speeds": _VELOCITY,
    "accelerations": _RATE,
    "measured": _MEASURED,
    "measured_speeds": _MEASURED_SPEED,
    "torques": _TORQUE,
    "carried": _CARRIED,
    "side": _SIDE,
}
