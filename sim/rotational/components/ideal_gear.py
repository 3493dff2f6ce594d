"""Gears without inertia, loss or play: IdealGear, IdealPlanetary; from rotation to translation IdealGearR2T and
IdealRollingWheel, where a flange has a position s [m] and a force f [N] in place of an angle and a torque."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import ParameterError
from sim.rotational.component import Branch, Component, Range, Row, Variables


class Gear(Component):
    """A component with a transmission ratio phi_a/phi_b, negative where it reverses."""

    ratio: float

    ranges: ClassVar[Mapping[str, Range]] = {"ratio": Range()}
    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.ratio == 0:
            raise ParameterError(f"{type(self).__name__}.ratio: must not be 0 (it is phi_a/phi_b), got {self.ratio}")

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.motion("flange_a")[0] - self.ratio * v.motion("flange_b")[0],)


@dataclass(frozen=True)
class IdealGear(Gear):
    """phi_a - phi_support = ratio (phi_b - phi_support), 0 = ratio tau_a + tau_b."""

    ratio: float

    unknowns: ClassVar[int] = 1

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau_a = v.unknown(0)
        tau_b = -self.ratio * tau_a
        angles = {"phi_a": v.motion("flange_a")[0], "phi_b": v.motion("flange_b")[0]}
        return (
            Branch(
                torques={"flange_a": tau_a, "flange_b": tau_b, "support": -tau_a - tau_b},
                channels={**angles, "flange_a.tau": tau_a, "flange_b.tau": tau_b},
            ),
        )


@dataclass(frozen=True)
class IdealPlanetary(Component):
    """(1 + ratio) phi_carrier = phi_sun + ratio phi_ring; ratio is teeth of the ring over teeth of the sun."""

    ratio: float

    flanges: ClassVar[tuple[str, ...]] = ("sun", "carrier", "ring")
    ranges: ClassVar[Mapping[str, Range]] = {"ratio": Range(above=0)}
    unknowns: ClassVar[int] = 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return ((1 + self.ratio) * v.phi("carrier") - v.phi("sun") - self.ratio * v.phi("ring"),)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        sun = v.unknown(0)
        torques = {"sun": sun, "carrier": -(1 + self.ratio) * sun, "ring": self.ratio * sun}
        return (Branch(torques=torques, channels={f"{name}.tau": tau for name, tau in torques.items()}),)


class RotationToTranslation(Component):
    """phi against supportR = ratio (s against supportT), 0 = ratio tau_R + f_T."""

    flanges: ClassVar[tuple[str, ...]] = ("flangeR", "flangeT", "supportR", "supportT")
    grounded: ClassVar[tuple[str, ...]] = ("supportR", "supportT")
    unknowns: ClassVar[int] = 1

    @property
    @abstractmethod
    def radians_per_metre(self) -> float:
        """Angle over way [rad/m]."""

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.motion("flangeR", "supportR")[0] - self.radians_per_metre * v.motion("flangeT", "supportT")[0],)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.unknown(0)
        f = -self.radians_per_metre * tau
        motion = {"phi": v.motion("flangeR", "supportR")[0], "s": v.motion("flangeT", "supportT")[0]}
        return (
            Branch(
                torques={"flangeR": tau, "flangeT": f, "supportR": -tau, "supportT": -f},
                channels={**motion, "flangeR.tau": tau, "flangeT.f": f},
            ),
        )


@dataclass(frozen=True)
class IdealGearR2T(RotationToTranslation, Gear):
    """Rack and pinion, or a spindle; ratio = phi/s [rad/m]."""

    ratio: float

    @property
    def radians_per_metre(self) -> float:
        return self.ratio


@dataclass(frozen=True)
class IdealRollingWheel(RotationToTranslation):
    """A wheel without inertia that rolls and does not slip; radius [m]."""

    radius: float

    ranges: ClassVar[Mapping[str, Range]] = {"radius": Range("m", above=0)}

    @property
    def radians_per_metre(self) -> float:
        return 1 / self.radius
