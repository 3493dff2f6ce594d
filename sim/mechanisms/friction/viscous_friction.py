"""Friction that grows with the speed and that the description lacks."""

from dataclasses import replace

from sim.mechanisms.locations import ENDS, axis_of, friction_at, with_friction
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature, Traits, only
from sim.rotational.drive_train import DriveTrain


class ViscousFriction(Mechanics):
    """Torque against the motion in proportion to its speed, felt at the motor whichever bearing it sits in.

    Equations: tau = coefficient w
    Source: laminar lubrication: Damper of the Modelica Standard Library 4.1
    """

    name = "viscous_friction"
    parameters = (Parameter("coefficient_n_m_s_per_rad", "N m s/rad", 0.0, 1e4, 1e-3),)
    size = "coefficient_n_m_s_per_rad"
    locations = only(*ENDS)
    needs = frozenset({Need.SEVERAL_SPEEDS})
    signature = Signature("speed", direction="opposite")
    sentence = (
        "Viscous friction of {coefficient_n_m_s_per_rad:.3g} N m s/rad as felt at the motor is missing from the "
        "description."
    )
    action = (
        "Nothing to repair: enter the viscous friction in the axis description. If it was lower when the axis was "
        "new, check grade and amount of grease and its temperature."
    )
    check = (
        "Move at three even speeds in both directions: viscous friction grows with the speed, dry friction stays the "
        "same."
    )
    traits = Traits(
        own_hypothesis=True,
        least_gain=13.0,
        in_every_axis=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        old = friction_at(train, place)
        ratio = axis_of(train).ratio_from("motor") / axis_of(train).ratio_from(place)
        more = self["coefficient_n_m_s_per_rad"] * ratio**2
        back = None if old.viscous_backward is None else old.viscous_backward + more
        return with_friction(train, place, replace(old, viscous=old.viscous + more, viscous_backward=back))
