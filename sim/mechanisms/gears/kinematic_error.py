"""A gear whose ratio swings about its mean as its input shaft turns."""

import math

from sim.mechanisms.locations import stage_names, with_error
from sim.mechanisms.mechanism import Discriminating, Law, Mechanics, Parameter, Signature, Traits
from sim.rotational.drive_train import DriveTrain


class KinematicError(Mechanics):
    """Transmission error some times per turn of the gear's input shaft: of a strain wave gear mostly twice.

    Equations: x = theta_driver / i - theta_driven - amplitude sin(order theta_driver + phase)
    Source: Tuttle and Seering, IEEE Trans. Robotics and Automation 12 (1996) 368: harmonic drive
    """

    name = "kinematic_error"
    parameters = (
        Parameter("amplitude_rad", "rad", 0.0, 0.02, 1e-4),
        Parameter("order", "1", 0.5, 200.0, 2.0),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size = "amplitude_rad"
    locations = stage_names
    as_new_key = "transmission_error_rad"
    signature = Signature("angle", order="order", of_input_shaft=True)
    sentence = (
        "The output of the {where} gear swings by {amplitude_rad:.3g} rad ({amplitude_rad_shown}) {order:g} times per "
        "turn of its input shaft, as that of a strain wave gear does twice."
    )
    action = (
        "Compare it with what the maker of the {where} gear allows; if it is more, check how input shaft and gear are "
        "centred and fastened. If it was there from the beginning, enter it in the axis description."
    )
    check = (
        "Move slowly in one direction with an encoder at the load: an error of the gear shows between both encoders at "
        "its order of the input shaft, ripple of the motor does not."
    )
    discriminated_by = frozenset({Discriminating.BY_SECOND_ENCODER})
    traits = Traits(
        behind_the_motor=True,
        of_links=True,
        of_unknown_teeth=True,
        own_hypothesis=True,
        identified_by="order",
        laws=frozenset({Law.RUNOUT_OR_RIPPLE}),
        erring_teeth=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        return with_error(train, place, self["order"], self["amplitude_rad"], self["phase_rad"], wheel="driver")
