"""Components with no counterpart in Modelica.Mechanics.Rotational; their equations: `sim.chain.model`.

They stand in a `DriveTrain` like any other component, in shafts in series: motor, gears and load.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from sim.errors import CompositionError, ParameterError, number
from sim.rotational.component import Branch, Component, Range, Variables
from sim.rotational.components import ElastoBacklash

Wheel = Literal["driver", "driven"]


@dataclass(frozen=True)
class MeshLine:
    """amplitude sin(order theta + phase), theta the angle of one wheel of the mesh [rad]; phase [rad]."""

    order: float
    amplitude: float
    phase: float = 0.0
    wheel: Wheel = "driven"


@dataclass(frozen=True)
class MeshDent:
    """Missing material on one flank of one wheel: depth (1 - |u|^form)^4, u = (theta - angle) / half_width; in rad.

    `depth` is felt at the driven gear. flank 1 carries positive torque to the driven gear, flank -1 the other.
    """

    angle: float
    half_width: float
    depth: float
    flank: int = 1
    wheel: Wheel = "driven"
    form: float = 2.0


class SeriesOnly(Component):
    """A component that shafts in series alone can have."""

    affine: ClassVar[bool] = False

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        raise CompositionError(
            f"{type(self).__name__}: can be simulated in shafts in series only (motor, gears, load, no branches)"
        )


@dataclass(frozen=True)
class GearMesh(SeriesOnly, ElastoBacklash):
    """ElastoBacklash whose flanks are not perfect; angles and torques at the driven gear (flange_b).

    With twist x(theta_a, theta_b) and force f the torques are f dx/dtheta (virtual work): errors and dents vary the
    ratio of the torques as that of the speeds, and a mesh without losses makes no energy.

    Parameters
    ----------
    errors
        Transmission error: the driven gear is held back by their sum [rad].
    dents
        Damage of single teeth.
    cubic
        Hardening: torque c x (1 + cubic x^2) [1/rad2].
    hysteresis, hysteresis_width
        Half height of the loop [N.m] and the twist over which it builds up [rad] (Dahl 1968).
    """

    errors: tuple[MeshLine, ...] = ()
    dents: tuple[MeshDent, ...] = ()
    cubic: float = 0.0
    hysteresis: float = 0.0
    hysteresis_width: float = 1e-4

    ranges: ClassVar[Mapping[str, Range]] = dict(
        ElastoBacklash.ranges,
        cubic=Range("1/rad2", at_least=0),
        hysteresis=Range("N.m", at_least=0),
        hysteresis_width=Range("rad", above=0),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for dent in self.dents:
            number("GearMesh.dents.depth", dent.depth, "rad", at_least=0)
            number("GearMesh.dents.half_width", dent.half_width, "rad", above=0)
            number("GearMesh.dents.form", dent.form, "1", above=1)
            if dent.flank not in (-1, 1):
                raise ParameterError(f"GearMesh.dents.flank: must be 1 or -1, got {dent.flank}")


@dataclass(frozen=True)
class ShaftFriction(SeriesOnly):
    """Friction of a shaft against its support, stuck at standstill as long as the torque is within its limits.

    tau = [(coulomb + stribeck exp(-(|w| / stribeck_speed)^stribeck_exponent)) sign w + viscous w] (1 + drift t),
    with the `_backward` values for w < 0; None means that they are those of w > 0.
    """

    coulomb: float = 0.0
    viscous: float = 0.0
    coulomb_backward: float | None = None
    viscous_backward: float | None = None
    stribeck: float = 0.0
    stribeck_speed: float = 1.0
    stribeck_exponent: float = 2.0
    drift: float = 0.0

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    ranges: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(("coulomb", "viscous", "coulomb_backward", "viscous_backward"), Range("N.m", at_least=0)),
        "stribeck_speed": Range("rad/s", above=0), "stribeck_exponent": Range(above=0), "drift": Range("1/s"),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        number("ShaftFriction.stribeck", self.stribeck, "N.m", at_least=-self.coulomb)

    def backward(self, name: str) -> float:
        """`coulomb` or `viscous` for w < 0."""
        value = getattr(self, f"{name}_backward")
        return float(getattr(self, name) if value is None else value)


@dataclass(frozen=True)
class OneFlange(SeriesOnly):
    """A torque between a shaft and the ground."""

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)


@dataclass(frozen=True)
class Gravity(OneFlange):
    """An arm of which gravity pulls the shaft with -torque sin(phi + phase) [N.m], [rad]."""

    torque: float
    phase: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {"torque": Range("N.m"), "phase": Range("rad")}


@dataclass(frozen=True)
class TorqueRipple(OneFlange):
    """Drives its shaft with the sum of torque sin(order phi + phase) [N.m] over its own angle."""

    lines: tuple[MeshLine, ...]


@dataclass(frozen=True)
class TorqueWave(OneFlange):
    """Drives its shaft with torque sin(2 pi frequency t + phase) [N.m], [Hz], [rad], whatever the motion."""

    torque: float
    frequency: float
    phase: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {**Gravity.ranges, "frequency": Range("Hz", above=0)}


@dataclass(frozen=True)
class ServoDrive(OneFlange):
    """A motor torque by cascaded digital control: position P, speed PI, both limited, along a motion back and forth.

    Parameters
    ----------
    period, top_speed, ramp, dwell
        Of the motion: period [s], largest speed of the motor [rad/s], time to reach it [s], rest at each end [s].
    begin, offset
        Where in its period the motion begins [s], and the angle of the motor at its near end [rad].
    position_gain, speed_gain, integral_time
        Of the controllers: [1/s], [N.m.s/rad], [s].
    feed_forward_inertia
        Inertia felt at the motor [kg.m2] that the feed-forward torque accelerates.
    torque_limit, speed_limit
        [N.m], [rad/s].
    """

    period: float
    top_speed: float
    ramp: float
    dwell: float
    position_gain: float
    speed_gain: float
    integral_time: float
    feed_forward_inertia: float
    torque_limit: float
    speed_limit: float
    begin: float = 0.0
    offset: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(
            ("period", "top_speed", "ramp", "position_gain", "speed_gain", "integral_time"), Range(above=0)
        ),
        **dict.fromkeys(("dwell", "feed_forward_inertia"), Range(at_least=0)),
        **dict.fromkeys(("begin", "offset"), Range()),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("torque_limit", "speed_limit"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"ServoDrive.{name}: must be > 0, got {getattr(self, name)}")
