"""A gear whose ratio swings about its mean as its input shaft turns."""

import math
from typing import ClassVar

from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.mechanism import Mechanics, Parameter, Signature
from sim.mechanisms.places import stage_at, stage_names, with_error
from sim.mechanisms.traits import Law, Traits
from sim.rotational.drive_train import DriveTrain


class KinematicError(Mechanics):
    """Transmission error some times per turn of the gear's input shaft: of a strain wave gear mostly twice."""

    name: ClassVar[str] = "kinematic_error"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("amplitude_rad", "rad", 0.0, 0.02, 1e-4),
        Parameter("order", "1", 0.5, 200.0, 2.0),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size: ClassVar[str] = "amplitude_rad"
    signature: ClassVar[Signature] = Signature("angle", order="order", grows_with="speed", of_input_shaft=True)
    equations: ClassVar[str] = "x = theta_driver / i - theta_driven - amplitude sin(order theta_driver + phase)"
    source: ClassVar[str] = "Tuttle and Seering, IEEE Trans. Robotics and Automation 12 (1996) 368: harmonic drive"
    sentence: ClassVar[str] = (
        "The output of the {where} gear swings by {amplitude_rad:.3g} rad ({amplitude_rad_shown}) {order:g} times per "
        "turn of its input shaft, as that of a strain wave gear does twice."
    )
    action: ClassVar[str] = (
        "Compare it with what the maker of the {where} gear allows; if it is more, check how input shaft and gear are "
        "centred and fastened. If it was there from the beginning, enter it in the axis description."
    )
    check: ClassVar[str] = (
        "Move slowly in one direction with an encoder at the load: an error of the gear shows between both encoders at "
        "its order of the input shaft, ripple of the motor does not."
    )
    behind_the_motor: ClassVar[bool] = True
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.BY_SECOND_ENCODER})
    of_links: ClassVar[bool] = True
    of_unknown_teeth: ClassVar[bool] = True
    own_hypothesis: ClassVar[bool] = True
    told_by: ClassVar[str | None] = "order"
    traits: ClassVar[Traits] = Traits(
        laws=frozenset({Law.RUNOUT_OR_RIPPLE}),
        erring_teeth=True,
    )

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        return stage_at(axis, location).transmission_error_rad if axis.stages and location else 0.0

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return stage_names(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        return with_error(train, place, self["order"], self["amplitude_rad"], self["phase_rad"], wheel="driver")
