"""A transmission that becomes stiffer as it is twisted."""

from dataclasses import replace

from sim.mechanisms.locations import gear_mesh, meshes
from sim.mechanisms.mechanism import Discriminating, Law, Mechanics, Need, Parameter, Signature, Traits
from sim.rotational.drive_train import DriveTrain


class StiffnessHardening(Mechanics):
    """Cubic spring: at the twist x the torque is 1 + cubic x^2 times that of the straight one.

    Equations: F = c x (1 + cubic x^2) + d x'
    Source: stiffness in steps K1 < K2 < K3 of strain wave gears, as a smooth curve
    """

    name = "stiffness_hardening"
    parameters = (Parameter("cubic_per_rad2", "1/rad2", 0.0, 1e9, 1e4),)
    size = "cubic_per_rad2"
    locations = meshes
    shown_by = frozenset({Need.LOAD_ENCODER})
    signature = Signature("twist")
    sentence = "The {where} gear pair is stiffer at large twist than at small."
    action = (
        "Nothing to repair: update the description, as the {where} gear pair stiffens. If the axis was linear "
        "before, check preload and end stops of that stage."
    )
    check = (
        "Block the load, let the motor push slowly up to its torque limit both ways: hardening bends torque over "
        "angle at its ends, backlash in the middle."
    )
    discriminated_by = frozenset({Discriminating.BLOCKED})
    traits = Traits(
        behind_the_motor=True,
        of_links=True,
        own_hypothesis=True,
        least_share=0.0007,  # it bends to much
        laws=frozenset({Law.SPRING}),
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name, mesh = gear_mesh(train, place)
        return train.replace(name, replace(mesh, cubic=mesh.cubic + self["cubic_per_rad2"]))
