"""Friction that differs by direction."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import axis_of, ends, friction_at, with_friction
from sim.mechanisms.traits import UNLIKE, Law, Traits
from sim.rotational.drive_train import DriveTrain


class FrictionAsymmetry(Mechanics):
    """Half the difference forward minus backward, of Coulomb and of viscous friction, at the shaft of its location.

    Without a location: as felt at the motor, motor and load having each its share of it, as of the friction there.
    """

    name: ClassVar[str] = "friction_asymmetry"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("torque_n_m", "N m", -1e4, 1e4, 0.1),
        Parameter("coefficient_n_m_s_per_rad", "N m s/rad", -1e4, 1e4, 0.0),
    )
    size: ClassVar[str] = "torque_n_m"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.BOTH_DIRECTIONS})
    signature: ClassVar[Signature] = Signature("speed", direction="one")
    equations: ClassVar[str] = "tau = (tau_C +- torque) sign(w) + (d +- coefficient) w, + forward, - backward"
    source: ClassVar[str] = (
        "EMPS benchmark: Janot, Gautier and Brunot, Workshop on Nonlinear System Identification Benchmarks (2019)"
    )
    sentence: ClassVar[str] = "Friction differs between the two directions of motion: the axis runs harder one way."
    action: ClassVar[str] = (
        "Zero the torque channel at standstill, because an offset looks nearly the same. Then look for what drags one "
        "way only: a brake that rubs, a preloaded screw or seal, a cable or hose that pulls."
    )
    check: ClassVar[str] = Differing.AT_REST.value
    own_hypothesis: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_gain=18.0,
        laws=frozenset({Law.FRICTION, Law.DISSIPATION, Law.OFFSET}),
        like_an_offset=True,
        in_good_order=UNLIKE,
        over_strokes=True,
    )

    @classmethod
    def sizes(cls) -> tuple[str, ...]:
        return ("torque_n_m", "coefficient_n_m_s_per_rad")

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return (None, *ends(axis))

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        axis = axis_of(train)
        if place:
            return _with(train, place, self["torque_n_m"], self["coefficient_n_m_s_per_rad"])
        present = [friction_at(train, end) for end in ends(axis)]
        felt = [axis.ratio_from(end) / axis.ratio for end in ends(axis)]
        halves = shared_halves(
            self["torque_n_m"], self["coefficient_n_m_s_per_rad"],
            [(old.coulomb, old.viscous) for old in present], felt,
        )  # fmt: skip
        for end, (torque, slope) in zip(ends(axis), halves, strict=True):
            train = _with(train, end, torque, slope)
        return train


def shared_halves(
    torque: float, slope: float, present: Sequence[tuple[float, float]], felt: Sequence[float]
) -> list[tuple[float, float]]:
    """Half differences of dry and viscous friction at each shaft, motor first, that are `torque` and `slope` together.

    Each has its share of it, as it has of the friction `present` (dry, viscous) that the motor feels; the motor has all
    where there is none. `felt`: speed of each shaft over the motor's.
    """
    dry = _shares([coulomb * k for (coulomb, _), k in zip(present, felt, strict=True)])
    viscous = _shares([d * k**2 for (_, d), k in zip(present, felt, strict=True)])
    return [(torque * c / k, slope * d / k**2) for c, d, k in zip(dry, viscous, felt, strict=True)]


def _shares(parts: Sequence[float]) -> list[float]:
    whole = sum(parts)
    return [part / whole if whole > 0.0 else float(k == 0) for k, part in enumerate(parts)]


def _with(train: DriveTrain, place: str, torque: float, slope: float) -> DriveTrain:
    if torque == slope == 0.0:
        return train
    old = friction_at(train, place)
    new = replace(
        old,
        coulomb=old.coulomb + torque,
        coulomb_backward=old.backward("coulomb") - torque,
        viscous=old.viscous + slope,
        viscous_backward=old.backward("viscous") - slope,
    )
    return with_friction(train, place, new)
