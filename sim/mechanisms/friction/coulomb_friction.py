"""Dry friction that the description lacks."""

from dataclasses import replace

from sim.mechanisms.locations import ENDS, axis_of, friction_at, with_friction
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature, Traits, only
from sim.rotational.drive_train import DriveTrain


class CoulombFriction(Mechanics):
    """Torque against the motion, felt at the motor whichever bearing it sits in.

    Equations: tau = torque sign(w)
    Source: Coulomb friction with stick: BearingFriction of the Modelica Standard Library 4.1
    """

    name = "coulomb_friction"
    parameters = (Parameter("torque_n_m", "N m", 0.0, 1e4, 0.2),)
    size = "torque_n_m"
    locations = only(*ENDS)
    needs = frozenset({Need.BOTH_DIRECTIONS, Need.SEVERAL_SPEEDS})
    signature = Signature("speed", direction="opposite")
    sentence = "Dry friction of {torque_n_m:.3g} N m as felt at the motor is missing from the description."
    action = (
        "Nothing to repair: enter the dry friction in the axis description. If it was lower when the axis was new, "
        "check seals, brake and lubrication."
    )
    check = (
        "Move at three even speeds in both directions: dry friction stays the same, viscous friction grows with the "
        "speed."
    )
    traits = Traits(
        own_hypothesis=True,
        least_gain=13.0,
        in_every_axis=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        old = friction_at(train, place)
        more = self["torque_n_m"] * axis_of(train).ratio_from("motor") / axis_of(train).ratio_from(place)
        back = None if old.coulomb_backward is None else old.coulomb_backward + more
        return with_friction(train, place, replace(old, coulomb=old.coulomb + more, coulomb_backward=back))
