"""What is hidden in one joint: how it acts, how it is named, and what change of torque it makes along a course."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.robot_bank.multibody import Array
from tests.robot_bank.second.servo import Drive


@dataclass(frozen=True, eq=False)
class Course:
    """What one joint's motor did (m,): time [s], angle [rad], speed, acceleration, torque carried [N m], and the state
    of its dry friction."""

    time: Array
    angle: Array
    speed: Array
    acceleration: Array
    carried: Array
    side: Array

    @property
    def moving(self) -> Array:
        """Where the joint moves (m,): at rest dry friction holds whatever there is, and no torque tells of anything."""
        return np.asarray(np.abs(self.speed) > 2e-3 * np.max(np.abs(self.speed)))

    def friction(self, drive: Drive) -> Array:
        """Return what friction takes (m,) [N m], without what is wrong with it."""
        f = drive.friction
        power = f.viscous * np.sign(self.speed) * np.abs(self.speed) ** f.power
        return (f.dry + f.loss * np.abs(self.carried)) * self.side + power

    def straight(self, drive: Drive) -> tuple[float, float]:
        """Return the dry and viscous friction of the straight line that is nearest to the true friction here."""
        matrix = np.column_stack([self.side, self.speed])
        moving = self.moving
        if not np.any(moving):
            return drive.friction.dry, drive.friction.viscous
        dry, viscous = np.linalg.lstsq(matrix[moving], self.friction(drive)[moving], rcond=None)[0]
        return float(dry), float(viscous)


@dataclass(frozen=True)
class Effect:
    """One effect.

    `act` puts it into a drive with an amplitude, `change` is the torque (m,) [N m] that it makes along a course per
    unit of it, `sizes` are its parameters as felt at the joint. rivals: what may stand for it besides the rotor; cap,
    amplitude, beyond_masses, may_be_missed: as in the first bank. late, offset: it is in the log alone. shown: the
    share of it (m,) that a log shows.
    """

    mechanism: str
    act: Callable[[Drive, float], Drive]
    change: Callable[[Course], Array]
    sizes: Callable[[float], Mapping[str, float]]
    cap: float = np.inf
    amplitude: float | None = None
    rivals: tuple[str, ...] = ("dry", "viscous")
    beyond_masses: bool = False
    may_be_missed: bool = False
    offset: float = 0.0
    late: bool = False
    shown: Callable[[Course], Array] = lambda course: np.ones_like(course.time)


@dataclass(frozen=True, eq=False)
class Draw:
    """What an effect is drawn from: a joint's drive and course, the inertia felt there with its rotor [kg m2], the
    noise of its torque [N m], and what logs it: its rate, the errors of its angles [rad] and of its stamps [s], rms."""

    rng: np.random.Generator
    drive: Drive
    course: Course
    geared: bool
    sliding: bool
    inertia: float
    noise: float
    rate_hz: float
    angle_error: float
    stamp_error: float

    def shown(self, course: Course, frequency: Array) -> Array:
        """Return the share (m,) of a torque of a frequency [rad/s] that stands out of noise as that of slow ones does.

        What the motor does not follow has to be seen in its acceleration, which is as uncertain as its angles are.
        """
        error = np.hypot(self.angle_error, self.stamp_error * course.speed)
        return np.asarray(1 / np.hypot(1.0, self.inertia * frequency**2 * error / self.noise))


def coulomb_friction(draw: Draw) -> Effect:
    dry, _ = draw.course.straight(draw.drive)
    return Effect(
        "coulomb_friction", lambda d, a: d, lambda c: dry * c.side, lambda a: {"torque_n_m": dry},
        amplitude=1.0, rivals=("viscous",),
    )  # fmt: skip


def viscous_friction(draw: Draw) -> Effect:
    _, viscous = draw.course.straight(draw.drive)
    return Effect(
        "viscous_friction", lambda d, a: d, lambda c: viscous * c.speed,
        lambda a: {"coefficient_n_m_s_per_rad": viscous}, amplitude=1.0, rivals=("dry",),
    )  # fmt: skip


def stribeck_friction(draw: Draw) -> Effect:
    brisk = float(np.sqrt(np.mean(draw.course.speed**2)))
    slow = float(draw.rng.uniform(0.1, 0.3) * brisk)

    def act(d: Drive, a: float) -> Drive:
        return replace(d, friction=replace(d.friction, stribeck=a, stribeck_speed=slow))

    return Effect(
        "stribeck_friction", act, lambda c: c.side * np.exp(-((c.speed / slow) ** 2)),
        lambda a: {"torque_n_m": a, "speed_rad_s": slow}, cap=2.0 * draw.drive.friction.dry,
    )  # fmt: skip


def friction_asymmetry(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    dry, viscous = draw.course.straight(draw.drive)

    def act(d: Drive, a: float) -> Drive:
        return replace(d, friction=replace(d.friction, asymmetry=sign * a))

    return Effect(
        "friction_asymmetry", act, lambda c: sign * c.side * c.friction(draw.drive),
        lambda a: {"torque_n_m": sign * a * dry, "coefficient_n_m_s_per_rad": sign * a * viscous},
        cap=0.6, rivals=("dry", "viscous", "offset"),
    )  # fmt: skip


def friction_drift(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    seconds = float(draw.course.time[-1])
    usual = draw.drive.friction.warming / seconds

    def act(d: Drive, a: float) -> Drive:
        return replace(d, friction=replace(d.friction, drift=sign * a))

    return Effect(
        "friction_drift", act, lambda c: sign * c.time * c.friction(draw.drive),
        lambda a: {"rate_per_s": sign * a + usual}, cap=0.7 / seconds,
    )  # fmt: skip


def gravity_imbalance(draw: Draw) -> Effect:
    phase = float(draw.rng.uniform(-np.pi, np.pi))
    return Effect(
        "gravity_imbalance", lambda d, a: replace(d, imbalance=a, imbalance_phase=phase),
        lambda c: np.sin(c.angle + phase), lambda a: {"torque_n_m": a, "phase_rad": phase},
        cap=0.0 if draw.sliding else 0.5 * draw.drive.rated, rivals=("dry", "viscous", "offset"), beyond_masses=True,
    )  # fmt: skip


def torque_ripple(draw: Draw) -> Effect:
    order, gear = float(draw.rng.choice([1, 2])), draw.drive.gear
    if not draw.geared and draw.rng.random() < 0.4:
        order = float(draw.rng.integers(4, 13)) / gear
    phase = float(draw.rng.uniform(-np.pi, np.pi))
    seen = order if draw.geared else order * gear
    brisk = float(np.sqrt(np.mean(draw.course.speed**2)))
    # a ripple that the log is too slow for at usual speeds is no ripple in it
    fast = order * gear * brisk / (2 * np.pi) > 0.3 * draw.rate_hz
    return Effect(
        "torque_ripple", lambda d, a: replace(d, ripple=a, ripple_order=order * gear, ripple_phase=phase),
        lambda c: -np.sin(order * gear * c.angle + phase), lambda a: {"torque_n_m": a, "order": seen},
        cap=0.0 if fast else 0.1 * draw.drive.rated, rivals=("dry", "viscous", "offset"),
        shown=lambda c: draw.shown(c, order * gear * np.abs(c.speed)),
    )  # fmt: skip


def torque_offset(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    return Effect(
        "torque_offset", lambda d, a: d, lambda c: np.full_like(c.time, sign), lambda a: {"torque_n_m": sign * a},
        cap=0.2 * draw.drive.rated, beyond_masses=True, offset=sign,
    )  # fmt: skip


def time_delay(draw: Draw) -> Effect:
    def change(c: Course) -> Array:
        torque = c.carried + draw.drive.rotor * c.acceleration + c.friction(draw.drive)
        return np.asarray(-np.gradient(torque, c.time))

    return Effect("time_delay", lambda d, a: d, change, lambda a: {"delay_s": a}, cap=0.04, late=True)


def backlash(draw: Draw) -> Effect:
    gap = float(draw.rng.uniform(1e-3, 4e-3))
    if draw.drive.stiffness <= 0 or draw.sliding:
        gap = 0.0

    def change(c: Course) -> Array:
        # the motor's way through its gap that the load does not go, felt as the rotor's and the gear's torque
        return np.asarray(0.5 * draw.drive.stiffness * np.sign(c.carried))

    return Effect(
        "backlash", lambda d, a: replace(d, gap=a), change, lambda a: {"gap_rad": a},
        amplitude=gap, may_be_missed=True,
    )  # fmt: skip


EFFECTS: dict[str, Callable[[Draw], Effect]] = {
    function.__name__: function
    for function in (
        coulomb_friction,
        viscous_friction,
        stribeck_friction,
        friction_asymmetry,
        friction_drift,
        gravity_imbalance,
        torque_ripple,
        torque_offset,
        time_delay,
        backlash,
    )
}
