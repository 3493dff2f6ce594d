"""Ideal sensors of Modelica.Mechanics.Rotational.Sensors: what they show is a channel; they change nothing."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Branch, Component, Row, Variables


@dataclass(frozen=True)
class _AtFlange(Component):
    flanges: ClassVar[tuple[str, ...]] = ("flange",)

    def shown(self, v: Variables) -> Mapping[str, Row]:
        """What the sensor shows."""
        raise NotImplementedError

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (Branch(torques={}, channels=self.shown(v)),)


@dataclass(frozen=True)
class AngleSensor(_AtFlange):
    """Absolute angle phi [rad]."""

    units: ClassVar[Mapping[str, str]] = {"phi": "rad"}

    def shown(self, v: Variables) -> Mapping[str, Row]:
        return {"phi": v.phi("flange")}


@dataclass(frozen=True)
class SpeedSensor(_AtFlange):
    """Absolute speed w [rad/s]."""

    units: ClassVar[Mapping[str, str]] = {"w": "rad/s"}

    def shown(self, v: Variables) -> Mapping[str, Row]:
        return {"w": v.w("flange")}


@dataclass(frozen=True)
class AccSensor(_AtFlange):
    """Absolute acceleration a [rad/s2]."""

    units: ClassVar[Mapping[str, str]] = {"a": "rad/s2"}

    def shown(self, v: Variables) -> Mapping[str, Row]:
        return {"a": v.a("flange")}


@dataclass(frozen=True)
class _Between(_AtFlange):
    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b")


@dataclass(frozen=True)
class RelAngleSensor(_Between):
    """phi_rel [rad], flange_b's angle minus flange_a's."""

    units: ClassVar[Mapping[str, str]] = {"phi_rel": "rad"}

    def shown(self, v: Variables) -> Mapping[str, Row]:
        return {"phi_rel": v.phi_rel}


@dataclass(frozen=True)
class RelSpeedSensor(_Between):
    """w_rel [rad/s], flange_b's speed minus flange_a's."""

    units: ClassVar[Mapping[str, str]] = {"w_rel": "rad/s"}

    def shown(self, v: Variables) -> Mapping[str, Row]:
        return {"w_rel": v.w_rel}


@dataclass(frozen=True)
class RelAccSensor(_Between):
    """a_rel [rad/s2], flange_b's acceleration minus flange_a's."""

    units: ClassVar[Mapping[str, str]] = {"a_rel": "rad/s2"}

    def shown(self, v: Variables) -> Mapping[str, Row]:
        return {"a_rel": v.a_rel}


@dataclass(frozen=True)
class _Within(Component):
    """Both flanges turn alike; tau [N.m] goes through from flange_a to flange_b."""

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau, w = v.unknown(0), v.w("flange_a")
        channels = {name: row for name, row in (("tau", tau), ("w", w)) if name in self.units}
        powers = {"power": (tau, w)} if "power" in self.units else {}
        return (Branch(torques={"flange_a": tau, "flange_b": -tau}, channels=channels, powers=powers),)


@dataclass(frozen=True)
class TorqueSensor(_Within):
    """Torque tau into flange_a [N.m]."""

    units: ClassVar[Mapping[str, str]] = {"tau": "N.m"}


@dataclass(frozen=True)
class PowerSensor(_Within):
    """Power tau w into flange_a [W]."""

    units: ClassVar[Mapping[str, str]] = {"power": "W"}


@dataclass(frozen=True)
class MultiSensor(_Within):
    """Speed, torque and power at flange_a."""

    units: ClassVar[Mapping[str, str]] = {"w": "rad/s", "tau": "N.m", "power": "W"}
