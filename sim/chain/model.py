"""Shafts in series with everything that is not affine inside, motor side first.

    J_k w_k' = F_(k-1) - T_k(F_k / i_k) - friction_k - gravity_k + offset_k + ripple_k (+ motor on shaft 0)
    x_k = theta_k / i_k - theta_(k+1) - e_k(angles)                twist of link k, at its driven gear [rad]
    F_k = contact law of x_k, x_k' (with gap, dents, stiffness) + hysteresis      torque on shaft k+1 [N m]

T_k is LossyGear of Modelica.Mechanics.Rotational 4.1, F_k its ElastoBacklash.
Friction at zero speed is exact stick. Order 4 in the step between located events.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim.errors import ParameterError
from sim.residual import Residual

Array = NDArray[np.float64]
CLOCK = -1
"""In the place of a shaft: the time."""


class ChainError(ParameterError):
    """A chain or its drive is described wrongly; the text names the parameter and what would be right."""


@dataclass(frozen=True)
class Line:
    """amplitude * sin(order * theta_shaft + phase); amplitude in rad, N m or 1, as its owner says.

    Of the shaft `CLOCK` the angle is the time [s], and the order an angular frequency [rad/s]: for ripples alone.
    """

    shaft: int
    order: float
    amplitude: float
    phase_rad: float = 0.0


@dataclass(frozen=True)
class Dent:
    """Missing material on one flank of one wheel: depth (1 - |u|^form)^4, u = (theta_shaft - angle) / half width.

    `form` 2 is a worn hollow, 10 a piece broken out with a flat bottom.
    """

    shaft: int
    angle_rad: float
    half_width_rad: float
    depth_rad: float  # at the driven gear of the link
    flank: int = 1  # 1: flank that carries positive torque to the driven gear; -1: the other one
    form: float = 2.0


@dataclass(frozen=True)
class Shaft:
    """One inertia and every torque on it. `_backward` values of None are those of the forward direction."""

    inertia_kg_m2: float
    coulomb_n_m: float = 0.0
    viscous_n_m_s: float = 0.0
    coulomb_backward_n_m: float | None = None
    viscous_backward_n_m_s: float | None = None
    stribeck_n_m: float = 0.0  # on top of Coulomb at standstill
    stribeck_speed_rad_s: float = 1.0
    stribeck_exponent: float = 2.0
    drift_per_s: float = 0.0  # all friction of the shaft times (1 + drift * t)
    gravity_n_m: float = 0.0  # the load pulls with -gravity * sin(theta + phase)
    gravity_phase_rad: float = 0.0
    offset_n_m: float = 0.0
    ripples: tuple[Line, ...] = ()  # torque on this shaft [N m] over the angle of any shaft, or time


@dataclass(frozen=True)
class Link:
    """Gear pair and its elasticity between two neighbouring shafts; all values at the driven gear unless said."""

    ratio: float
    stiffness_n_m_per_rad: float
    damping_n_m_s_per_rad: float = 0.0
    gap_rad: float = 0.0  # total
    law: str = "elasto"
    efficiency: tuple[float, float] = (1.0, 1.0)  # driver drives, driven gear drives
    bearing_n_m: tuple[float, float] = (0.0, 0.0)  # at the driver, as LossyGear's tau_bf1, tau_bf2
    loss_fraction: float = 0.0  # of the transmitted torque, both directions of power
    errors: tuple[Line, ...] = ()  # transmission error [rad]
    dents: tuple[Dent, ...] = ()
    cubic_per_rad2: float = 0.0  # torque c x (1 + cubic x^2)
    hysteresis_n_m: float = 0.0  # Dahl's operator beside the spring: half height of its loop
    hysteresis_rad: float = 1e-4  # twist over which it builds up


@dataclass(frozen=True)
class Chain:
    """One to four shafts, and one link fewer."""

    shafts: tuple[Shaft, ...]
    links: tuple[Link, ...] = ()

    @property
    def ratio(self) -> float:
        """Motor turns per turn of the last shaft."""
        return math.prod(link.ratio for link in self.links)


@dataclass(frozen=True)
class Torque:
    """Torque on the first shaft: offset + amplitude sin(2 pi f t + phase) + samples (straight lines between them)."""

    samples_n_m: Array | None = None
    amplitude_n_m: float = 0.0
    frequency_hz: float = 0.0
    phase_rad: float = 0.0
    offset_n_m: float = 0.0


@dataclass(frozen=True)
class Servo:
    """Digital cascade: position P, speed PI, both limited. Rows of `reference`: angle, speed, torque feed-forward."""

    reference: Array
    position_gain_per_s: float
    speed_gain_n_m_s: float
    integral_time_s: float
    speed_limit_rad_s: float
    torque_limit_n_m: float
    feed_forward: float = 1.0


Drive = Torque | Servo


@dataclass(frozen=True)
class ChainResult:
    """Columns are shafts or, of the force, links (torque on the driven shaft).

    Rows of the log: time [s]; 0 contact, 1 stick, 2 direction of hysteresis, 3 who drives; link or shaft; from; to.
    """

    time_s: Array
    angle_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    force_n_m: Array
    motor_torque_n_m: Array
    log: Array = field(repr=False)
    residual: Residual = field(default_factory=Residual)


def with_loss(efficiency: tuple[float, float], fraction: float) -> tuple[float, float]:
    """Efficiencies of a mesh, driver and driven gear driving, that loses a fraction of the torque it carries besides.

    The driver gives 1 + fraction of what is asked, or takes 1 - fraction of what comes back.
    """
    return efficiency[0] / (1 + fraction), efficiency[1] * (1 - fraction)


def with_link(chain: Chain, index: int, **changes: object) -> Chain:
    """The chain with some parameters of one link replaced."""
    links = list(chain.links)
    links[index] = replace(links[index], **changes)  # type: ignore[arg-type]
    return replace(chain, links=tuple(links))


def with_shaft(chain: Chain, index: int, **changes: object) -> Chain:
    """The chain with some parameters of one shaft replaced."""
    shafts = list(chain.shafts)
    shafts[index] = replace(shafts[index], **changes)  # type: ignore[arg-type]
    return replace(chain, shafts=tuple(shafts))
