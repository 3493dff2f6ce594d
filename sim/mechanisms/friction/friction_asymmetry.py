"""Friction that differs by direction."""

from collections.abc import Sequence
from dataclasses import replace

from sim.description.axis import Axis
from sim.mechanisms.locations import ENDS, axis_of, friction_at, with_friction
from sim.mechanisms.mechanism import UNLIKE, Discriminating, Law, Mechanics, Need, Parameter, Signature, Traits, only
from sim.rotational.drive_train import DriveTrain


class FrictionAsymmetry(Mechanics):
    """Half the difference forward minus backward, of Coulomb and of viscous friction, at the shaft of its location.

    Without a location: as felt at the motor, motor and load having each its share of it, as of the friction there.

    Equations: tau = (tau_C +- torque) sign(w) + (d +- coefficient) w, + forward, - backward
    Source: EMPS benchmark: Janot, Gautier and Brunot, Workshop on Nonlinear System Identification Benchmarks (2019)
    """

    name = "friction_asymmetry"
    parameters = (
        Parameter("torque_n_m", "N m", -1e4, 1e4, 0.1),
        Parameter("coefficient_n_m_s_per_rad", "N m s/rad", -1e4, 1e4, 0.0),
    )
    size = "torque_n_m"
    locations = only(None, *ENDS)
    needs = frozenset({Need.BOTH_DIRECTIONS})
    signature = Signature("speed", direction="one")
    sentence = "Friction differs between the two directions of motion: the axis runs harder one way."
    action = (
        "Look for what drags one way only: a brake that rubs, a preloaded screw or seal, a cable or hose that pulls."
    )
    check = Discriminating.AT_REST.value
    traits = Traits(
        own_hypothesis=True,
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
    def largest(cls, axis: Axis) -> float:
        """All dry friction that the motor feels: with more, friction would drive one way."""
        return axis.motor.coulomb_friction_n_m + axis.load.coulomb_friction_n_m / axis.ratio

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        axis = axis_of(train)
        if place:
            return _with(train, place, self["torque_n_m"], self["coefficient_n_m_s_per_rad"])
        present = [friction_at(train, end) for end in ENDS]
        felt = [axis.ratio_from(end) / axis.ratio for end in ENDS]
        halves = shared_halves(
            self["torque_n_m"], self["coefficient_n_m_s_per_rad"],
            [(old.coulomb, old.viscous) for old in present], felt,
        )  # fmt: skip
        for end, (torque, slope) in zip(ENDS, halves, strict=True):
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
