"""IdealGearR2T and IdealRollingWheel: from rotation to translation; and Mass, what is moved there.

On the side of translation a flange has a position s [m] and a force f [N] where others have an angle and a torque.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import number
from sim.rotational.component import Branch, Component, Row, Variables
from sim.rotational.components.ideal_gear import gear_ratio
from sim.rotational.components.inertia import RigidBody
from sim.rotational.components.start_values import check_starts


@dataclass(frozen=True)
class RotationToTranslation(Component):
    """phi against supportR = ratio (s against supportT), 0 = ratio tau_R + f_T."""

    flanges: ClassVar[tuple[str, ...]] = ("flangeR", "flangeT", "supportR", "supportT")
    grounded: ClassVar[tuple[str, ...]] = ("supportR", "supportT")
    units: ClassVar[Mapping[str, str]] = {"phi": "rad", "s": "m", "flangeR.tau": "N.m", "flangeT.f": "N"}

    @property
    def radians_per_metre(self) -> float:
        """Angle over way [rad/m]."""
        raise NotImplementedError

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (_against(v, "R") - self.radians_per_metre * _against(v, "T"),)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.unknown(0)
        f = -self.radians_per_metre * tau
        return (
            Branch(
                torques={"flangeR": tau, "flangeT": f, "supportR": -tau, "supportT": -f},
                channels={"phi": _against(v, "R"), "s": _against(v, "T"), "flangeR.tau": tau, "flangeT.f": f},
            ),
        )


@dataclass(frozen=True)
class IdealGearR2T(RotationToTranslation):
    """Rack and pinion, or a spindle; ratio = phi/s [rad/m]."""

    ratio: float

    def __post_init__(self) -> None:
        gear_ratio("IdealGearR2T.ratio", self.ratio)

    @property
    def radians_per_metre(self) -> float:
        return self.ratio


@dataclass(frozen=True)
class IdealRollingWheel(RotationToTranslation):
    """A wheel without inertia that rolls and does not slip; radius [m]."""

    radius: float

    def __post_init__(self) -> None:
        number("IdealRollingWheel.radius", self.radius, "m", above=0)

    @property
    def radians_per_metre(self) -> float:
        return 1 / self.radius


@dataclass(frozen=True)
class Mass(RigidBody):
    """m a = f_a + f_b: m [kg]; start values s [m], v [m/s], None: they follow from the rest, or are 0; a is refused."""

    m: float
    s: float | None = None
    v: float | None = None
    a: float | None = None

    motion: ClassVar[tuple[str, str]] = ("s", "v")
    effort: ClassVar[str] = "f"
    units: ClassVar[Mapping[str, str]] = {"s": "m", "v": "m/s", "a": "m/s2", "flange_a.f": "N", "flange_b.f": "N"}

    def __post_init__(self) -> None:
        number("Mass.m", self.m, "kg", above=0)
        check_starts(self, "s", "v", "a")

    @property
    def inertia(self) -> float:
        return self.m


def _against(v: Variables, side: str) -> Row:
    return v.phi(f"flange{side}") - v.phi(f"support{side}")
