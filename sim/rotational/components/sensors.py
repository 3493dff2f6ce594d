"""Ideal sensors of Modelica.Mechanics.Rotational.Sensors: what they show is a channel; they change nothing.

RelativeStates makes the relative motion of two flanges states, with start values; it carries no torque.
"""

from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Branch, Component, Row, Variables, WithStarts


class _AtFlange(Component):
    flanges: ClassVar[tuple[str, ...]] = ("flange",)
    shown: ClassVar[tuple[str, ...]]

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (Branch(torques={}, channels={name: getattr(v, name)("flange") for name in self.shown}),)


@dataclass(frozen=True)
class AngleSensor(_AtFlange):
    """Absolute angle phi [rad]."""

    shown: ClassVar[tuple[str, ...]] = ("phi",)


@dataclass(frozen=True)
class SpeedSensor(_AtFlange):
    """Absolute speed w [rad/s]."""

    shown: ClassVar[tuple[str, ...]] = ("w",)


@dataclass(frozen=True)
class AccSensor(_AtFlange):
    """Absolute acceleration a [rad/s2]."""

    shown: ClassVar[tuple[str, ...]] = ("a",)


class _Between(Component):
    shown: ClassVar[tuple[str, ...]]

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (Branch(torques={}, channels={name: getattr(v, name) for name in self.shown}),)


@dataclass(frozen=True)
class RelAngleSensor(_Between):
    """phi_rel [rad], flange_b's angle minus flange_a's."""

    shown: ClassVar[tuple[str, ...]] = ("phi_rel",)


@dataclass(frozen=True)
class RelSpeedSensor(_Between):
    """w_rel [rad/s], flange_b's speed minus flange_a's."""

    shown: ClassVar[tuple[str, ...]] = ("w_rel",)


@dataclass(frozen=True)
class RelAccSensor(_Between):
    """a_rel [rad/s2], flange_b's acceleration minus flange_a's."""

    shown: ClassVar[tuple[str, ...]] = ("a_rel",)


@dataclass(frozen=True)
class RelativeStates(_Between, WithStarts):
    """phi_rel = phi_b - phi_a [rad] and w_rel [rad/s] are states; start values, None: not given; a_rel is refused."""

    phi_rel: float | None = None
    w_rel: float | None = None
    a_rel: float | None = None

    shown: ClassVar[tuple[str, ...]] = WithStarts.start_names


class _Within(Component):
    """Both flanges turn alike; tau [N.m] goes through from flange_a to flange_b."""

    shown: ClassVar[tuple[str, ...]]
    unknowns: ClassVar[int] = 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau, w = v.unknown(0), v.w("flange_a")
        channels = {name: row for name, row in (("tau", tau), ("w", w)) if name in self.shown}
        powers = {"power": (tau, w)} if "power" in self.shown else {}
        return (Branch(torques={"flange_a": tau, "flange_b": -tau}, channels=channels, powers=powers),)


@dataclass(frozen=True)
class TorqueSensor(_Within):
    """Torque tau into flange_a [N.m]."""

    shown: ClassVar[tuple[str, ...]] = ("tau",)


@dataclass(frozen=True)
class PowerSensor(_Within):
    """Power tau w into flange_a [W]."""

    shown: ClassVar[tuple[str, ...]] = ("power",)


@dataclass(frozen=True)
class MultiSensor(_Within):
    """Speed, torque and power at flange_a."""

    shown: ClassVar[tuple[str, ...]] = ("w", "tau", "power")
