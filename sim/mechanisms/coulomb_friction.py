"""Dry friction that the description lacks."""

from dataclasses import replace
from typing import ClassVar

from sim.description.axis import Axis
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import axis_of, ends, friction_at, with_friction
from sim.mechanisms.traits import Traits
from sim.rotational.drive_train import DriveTrain


class CoulombFriction(Mechanics):
    """Torque against the motion, felt at the motor whichever bearing it sits in."""

    name: ClassVar[str] = "coulomb_friction"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("torque_n_m", "N m", 0.0, 1e4, 0.2),)
    size: ClassVar[str] = "torque_n_m"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.BOTH_DIRECTIONS, Need.SEVERAL_SPEEDS})
    signature: ClassVar[Signature] = Signature("speed", direction="opposite")
    equations: ClassVar[str] = "tau = torque sign(w)"
    source: ClassVar[str] = "Coulomb friction with stick: BearingFriction of the Modelica Standard Library 4.1"
    sentence: ClassVar[str] = (
        "Dry friction of {torque_n_m:.3g} N m as felt at the motor is missing from the description."
    )
    action: ClassVar[str] = (
        "Nothing to repair: enter the dry friction in the axis description. If it was lower when the axis was new, "
        "check seals, brake and lubrication."
    )
    check: ClassVar[str] = (
        "Move at three even speeds in both directions: dry friction stays the same, viscous friction grows with the "
        "speed."
    )
    own_hypothesis: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_gain=13.0,
        in_every_axis=True,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return ends(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        old = friction_at(train, place)
        more = self["torque_n_m"] * axis_of(train).ratio_from("motor") / axis_of(train).ratio_from(place)
        back = None if old.coulomb_backward is None else old.coulomb_backward + more
        return with_friction(train, place, replace(old, coulomb=old.coulomb + more, coulomb_backward=back))
