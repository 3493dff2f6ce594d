"""An error that every tooth has: it repeats with the mesh."""

import math
from typing import ClassVar

from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.heard import Heard
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import axis_of, stage_at, stage_names, teeth, with_error
from sim.mechanisms.traits import Law, Traits
from sim.rotational.drive_train import DriveTrain


class MeshError(Mechanics):
    """Transmission error once per tooth, felt at the driven gear, and its second harmonic."""

    name: ClassVar[str] = "mesh_error"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("amplitude_rad", "rad", 0.0, 0.02, 1e-4),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
        Parameter("second_amplitude_rad", "rad", 0.0, 0.02, 0.0),
        Parameter("second_phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size: ClassVar[str] = "amplitude_rad"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.TWO_ROWS_PER_TOOTH})
    signature: ClassVar[Signature] = Signature("angle", order="mesh", grows_with="speed")
    damage: ClassVar[str] = "wear of all teeth alike: sliding wear, scuffing, pitting (surface fatigue)"
    equations: ClassVar[str] = (
        "x = theta_driver / i - theta_driven - amplitude sin(z theta_driven + phase)"
        " - second_amplitude sin(2 z theta_driven + second_phase)"
    )
    source: ClassVar[str] = "static transmission error at tooth frequency: Harris, Proc. IMechE 172 (1958) 87"
    sentence: ClassVar[str] = (
        "The teeth of the {where} gear pair have an error of {amplitude_rad:.3g} rad ({amplitude_rad_shown}) at "
        "tooth frequency, more than a new gear."
    )
    action: ClassVar[str] = (
        "Look at the contact pattern of the {where} gear pair and at its oil: the teeth may be worn, wrongly "
        "spaced or misaligned. Do it at the next stop."
    )
    check: ClassVar[str] = (
        "Repeat the motion at two thirds of the speed: what keeps its order is the teeth; what keeps its "
        "frequency is a structure."
    )
    behind_the_motor: ClassVar[bool] = True
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.BY_LOOK, Differing.OVER_A_TURN})
    own_hypothesis: ClassVar[bool] = True
    heard: ClassVar[Heard | None] = Heard(
        "error of teeth",
        "Record motor torque and angle of motor and load of the same motion: they give how much the teeth err, "
        "and tell worn ones from one that is damaged.",
        left_out="No gear's tooth lines have grown since the axis was new by more than those of the other gears.",
    )
    traits: ClassVar[Traits] = Traits(
        laws=frozenset({Law.RIPPLE_OF_TEETH, Law.FLANKS}),
        erring_teeth=True,
    )

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        return stage_at(axis, location).transmission_error_rad if axis.stages and location else 0.0

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return stage_names(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        order = float(teeth(axis_of(train), place))
        train = with_error(train, place, order, self["amplitude_rad"], self["phase_rad"])
        if self["second_amplitude_rad"] == 0:
            return train
        return with_error(train, place, 2.0 * order, self["second_amplitude_rad"], self["second_phase_rad"])
