"""An error that every tooth has: it repeats with the mesh."""

import math

from sim.mechanisms.locations import axis_of, stage_names, teeth, with_error
from sim.mechanisms.mechanism import Discriminating, Law, Mechanics, Need, Parameter, Signature, SoundReport, Traits
from sim.rotational.drive_train import DriveTrain


class MeshError(Mechanics):
    """Transmission error once per tooth, felt at the driven gear, and its second harmonic.

    Equations: x = theta_driver / i - theta_driven - amplitude sin(z theta_driven + phase) - second_amplitude sin(2
    z theta_driven + second_phase)
    Source: static transmission error at tooth frequency: Harris, Proc. IMechE 172 (1958) 87
    """

    name = "mesh_error"
    parameters = (
        Parameter("amplitude_rad", "rad", 0.0, 0.02, 1e-4),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
        Parameter("second_amplitude_rad", "rad", 0.0, 0.02, 0.0),
        Parameter("second_phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size = "amplitude_rad"
    locations = stage_names
    as_new_key = "transmission_error_rad"
    shown_by = frozenset({Need.TWO_ROWS_PER_TOOTH})
    signature = Signature("angle", order="mesh")
    damage = "wear of all teeth alike: sliding wear, scuffing, pitting (surface fatigue)"
    sentence = (
        "The teeth of the {where} gear pair have an error of {amplitude_rad:.3g} rad ({amplitude_rad_shown}) at "
        "tooth frequency, more than a new gear."
    )
    action = (
        "Look at the contact pattern of the {where} gear pair and at its oil: the teeth may be worn, wrongly "
        "spaced or misaligned. Do it at the next stop."
    )
    check = (
        "Repeat the motion at two thirds of the speed: what keeps its order is the teeth; what keeps its "
        "frequency is a structure."
    )
    discriminated_by = frozenset({Discriminating.BY_LOOK, Discriminating.OVER_A_TURN})
    sound = SoundReport(
        "error of teeth",
        "Record motor torque and angle of motor and load of the same motion: they give how much the teeth err, "
        "and tell worn ones from one that is damaged.",
        rejected="No gear's tooth lines have grown since the axis was new by more than those of the other gears.",
    )
    traits = Traits(
        behind_the_motor=True,
        own_hypothesis=True,
        laws=frozenset({Law.RIPPLE_OF_TEETH, Law.FLANKS}),
        erring_teeth=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        order = float(teeth(axis_of(train), place))
        train = with_error(train, place, order, self["amplitude_rad"], self["phase_rad"])
        if self["second_amplitude_rad"] == 0:
            return train
        return with_error(train, place, 2.0 * order, self["second_amplitude_rad"], self["second_phase_rad"])
