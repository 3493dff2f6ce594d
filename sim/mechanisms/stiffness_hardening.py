"""A transmission that becomes stiffer as it is twisted."""

from dataclasses import replace
from typing import ClassVar

from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import gear_mesh, meshes
from sim.mechanisms.traits import Law, Traits
from sim.rotational.drive_train import DriveTrain


class StiffnessHardening(Mechanics):
    """Cubic spring: at the twist x the torque is 1 + cubic x^2 times that of the straight one."""

    name: ClassVar[str] = "stiffness_hardening"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("cubic_per_rad2", "1/rad2", 0.0, 1e9, 1e4),)
    size: ClassVar[str] = "cubic_per_rad2"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.LOAD_ENCODER})
    signature: ClassVar[Signature] = Signature("twist", grows_with="twist")
    equations: ClassVar[str] = "F = c x (1 + cubic x^2) + d x'"
    source: ClassVar[str] = "stiffness in steps K1 < K2 < K3 of strain wave gears, as a smooth curve"
    sentence: ClassVar[str] = "The {where} gear pair is stiffer at large twist than at small."
    action: ClassVar[str] = (
        "Nothing to repair: enter in the description that the {where} gear pair stiffens. If the axis was linear "
        "before, check preload and end stops of that stage."
    )
    check: ClassVar[str] = (
        "Block the load, let the motor push slowly up to its torque limit both ways: hardening bends torque over "
        "angle at its ends, backlash in the middle."
    )
    behind_the_motor: ClassVar[bool] = True
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.BLOCKED})
    of_links: ClassVar[bool] = True
    own_hypothesis: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_share=0.0007,  # it bends to much
        over_bending=1.1,
        laws=frozenset({Law.SPRING}),
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return meshes(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name, mesh = gear_mesh(train, place)
        return train.replace(name, replace(mesh, cubic=mesh.cubic + self["cubic_per_rad2"]))
