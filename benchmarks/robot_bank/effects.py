"""What is hidden in one joint, and how large it has to be to be seen.

An effect has one amplitude. Its strength is the rms of its change of the joint's torque, beyond what another rotor and
other friction could do, over the rms of the noise there: the least that any method must leave to its rivals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.robot_bank.arm import Arm
from benchmarks.robot_bank.drive import Drive
from benchmarks.robot_bank.motion import Motion
from benchmarks.robot_bank.multibody import Array, Body

LEVELS = {"strong": 3.0, "full": 1.0, "half": 0.5}
"""Strengths."""
BEYOND = 3.0
"""What a tolerance of the description could also be has to exceed its rms by this factor: three standard deviations."""


@dataclass(frozen=True)
class Effect:
    """One effect in a joint's drive.

    `act` puts it into a drive with an amplitude; `sizes` gives its parameters as felt at the joint. `as_parameter`: by
    the contract no finding but another value of a number that the description has. `rivals`: columns that may stand for
    it besides the rotor's; `described_without` are the numbers that the description has as 0. amplitude: of an effect
    whose size is that of nature, not a level. beyond_masses: links of other masses make torques of its kind.
    """

    kind: str
    mechanism: str
    act: Callable[[Drive, float], Drive]
    sizes: Callable[[float], Mapping[str, float]]
    cap: float = np.inf
    least: float = 0.0
    amplitude: float | None = None
    rivals: tuple[str, ...] = ("dry", "viscous")
    described_without: tuple[str, ...] = ()
    as_parameter: bool = False
    beyond_masses: bool = False
    may_be_missed: bool = False
    offset: bool = False
    delay: bool = False


@dataclass(frozen=True)
class Draw:
    """What an effect is drawn from: the joint's number, its true drive and motion, whether its gear is in the log."""

    rng: np.random.Generator
    joint: int
    drive: Drive
    motion: Motion
    geared: bool
    rate_hz: float

    @property
    def brisk(self) -> float:
        """Speed of the joint [rad/s], rms."""
        return float(np.sqrt(np.mean(self.motion.speeds[:, self.joint] ** 2)))


def coulomb_friction(draw: Draw) -> Effect:
    dry = draw.drive.dry
    return Effect(
        "coulomb_friction", "coulomb_friction", lambda d, a: replace(d, dry=a * dry), lambda a: {"torque_n_m": a * dry},
        amplitude=1.0, rivals=("viscous",), described_without=("dry",),
    )  # fmt: skip


def viscous_friction(draw: Draw) -> Effect:
    viscous = draw.drive.viscous
    return Effect(
        "viscous_friction", "viscous_friction", lambda d, a: replace(d, viscous=a * viscous),
        lambda a: {"coefficient_n_m_s_per_rad": a * viscous},
        amplitude=1.0, rivals=("dry",), described_without=("viscous",),
    )  # fmt: skip


def friction_raised(draw: Draw) -> Effect:
    dry = draw.drive.dry
    return Effect(
        "friction_raised", "coulomb_friction", lambda d, a: replace(d, raised=1 + a),
        lambda a: {"coulomb_friction_n_m": (1 + a) * dry},
        cap=2.0, least=BEYOND * 0.1, rivals=("viscous",), as_parameter=True,
    )  # fmt: skip


def stribeck_friction(draw: Draw) -> Effect:
    speed = float(draw.rng.uniform(0.1, 0.3) * draw.brisk)
    return Effect(
        "stribeck_friction", "stribeck_friction", lambda d, a: replace(d, stribeck=a, stribeck_speed=speed),
        lambda a: {"torque_n_m": a, "speed_rad_s": speed}, cap=2.0 * draw.drive.dry,
    )  # fmt: skip


def friction_asymmetry(draw: Draw) -> Effect:
    sign, drive = float(draw.rng.choice([-1, 1])), draw.drive
    return Effect(
        "friction_asymmetry", "friction_asymmetry", lambda d, a: replace(d, asymmetry=sign * a),
        lambda a: {"torque_n_m": sign * a * drive.dry, "coefficient_n_m_s_per_rad": sign * a * drive.viscous},
        cap=0.6, rivals=("dry", "viscous", "offset"),
    )  # fmt: skip


def friction_drift(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    seconds = float(draw.motion.time[-1])
    # cooling friction cannot fall below nothing, warming has doubled it in no log
    return Effect(
        "friction_drift", "friction_drift", lambda d, a: replace(d, drift=sign * a),
        lambda a: {"rate_per_s": sign * a}, cap=0.7 / seconds,
    )  # fmt: skip


def gravity_imbalance(draw: Draw) -> Effect:
    phase = float(draw.rng.uniform(-np.pi, np.pi))
    return Effect(
        "gravity_imbalance", "gravity_imbalance", lambda d, a: replace(d, imbalance=a, imbalance_phase=phase),
        lambda a: {"torque_n_m": a, "phase_rad": phase}, cap=0.5 * draw.drive.rated,
        rivals=("dry", "viscous", "offset"), beyond_masses=True,
    )  # fmt: skip


def torque_ripple(draw: Draw) -> Effect:
    # once and twice per motor turn (eccentric rotor, strain wave), or, where the gear is not in the log, of the joint
    order = float(draw.rng.choice([1, 2]))
    if not draw.geared and draw.rng.random() < 0.5:
        order = float(draw.rng.integers(4, 13)) / draw.drive.gear
    phase = float(draw.rng.uniform(-np.pi, np.pi))
    seen = order if draw.geared else order * draw.drive.gear
    # a ripple that the log is too slow for at usual speeds is no ripple in it
    fast = order * draw.drive.gear * draw.brisk / (2 * np.pi) > 0.3 * draw.rate_hz
    return Effect(
        "torque_ripple", "torque_ripple",
        lambda d, a: replace(d, ripple=a, ripple_order=order, ripple_phase=phase),
        lambda a: {"torque_n_m": a, "order": seen}, cap=0.0 if fast else 0.1 * draw.drive.rated,
    )  # fmt: skip


def torque_offset(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    return Effect(
        "torque_offset", "torque_offset", lambda d, a: d, lambda a: {"torque_n_m": sign * a},
        cap=0.2 * draw.drive.rated, offset=True, beyond_masses=True,
    )  # fmt: skip


def time_delay(draw: Draw) -> Effect:
    return Effect(
        "time_delay", "time_delay", lambda d, a: d, lambda a: {"delay_s": a}, cap=0.04, delay=True
    )  # fmt: skip


def backlash(draw: Draw) -> Effect:
    gap = float(draw.rng.uniform(1e-3, 4e-3))
    return Effect(
        "backlash", "backlash", lambda d, a: replace(d, gap=a), lambda a: {"gap_rad": a},
        amplitude=gap, may_be_missed=True,
    )  # fmt: skip


EFFECTS: dict[str, Callable[[Draw], Effect]] = {
    function.__name__: function
    for function in (
        coulomb_friction,
        viscous_friction,
        friction_raised,
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
DESCRIBED = ("coulomb_friction", "viscous_friction", "friction_raised")
"""Those that ask for joints whose friction is described."""


def draw_payload(rng: np.random.Generator, arm: Arm) -> Body:
    """Draw what may hang at the flange: a fifth to nine tenths of what the arm carries, close in front of it."""
    mass = float(rng.uniform(0.2, 0.9) * arm.class_kg)
    frame, origin = arm.flange
    size = float((mass / 4000) ** (1 / 3))
    offset = np.array([*rng.uniform(-0.04, 0.04, 2), rng.uniform(0.02, 0.1) + size / 2])
    sides = size * rng.uniform(0.7, 1.4, 3)
    inertia = mass / 12 * np.diag(np.sum(sides**2) - sides**2)
    return Body(mass, origin + frame @ offset, frame @ inertia @ frame.T)


def beyond(change: Array, columns: list[Array]) -> float:
    """Return the rms of what no combination of the columns explains; all (n,)."""
    matrix = np.column_stack(columns)
    matrix = matrix / (np.linalg.norm(matrix, axis=0) + 1e-300)
    left = change - matrix @ np.linalg.lstsq(matrix, change, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))
