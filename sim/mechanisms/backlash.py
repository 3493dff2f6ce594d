"""Play between the teeth: more than the gear had as new."""

import math
from dataclasses import replace
from typing import ClassVar

from sim.description.axis import Axis
from sim.errors import CompositionError
from sim.mechanisms.differing import Differing
from sim.mechanisms.heard import Heard
from sim.mechanisms.mechanism import SECURED, Mechanics, Parameter, Signature
from sim.mechanisms.places import axis_of, meshes, stage_at
from sim.mechanisms.traits import Law, Traits
from sim.rotational.components import ElastoBacklash
from sim.rotational.drive_train import DriveTrain

UNSTATED_RAD = math.radians(1.0 / 60.0)
"""Backlash as new of a gear of which none is stated: no gear is without, and makers of precision gear units for robots
promise one minute of arc or less."""


class Backlash(Mechanics):
    """Total gap of a mesh; the teeth hit each other when the torque changes its sign."""

    name: ClassVar[str] = "backlash"
    workshop_name: ClassVar[str] = "play"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("gap_rad", "rad", 0.0, 0.1, 1e-3),)
    size: ClassVar[str] = "gap_rad"
    signature: ClassVar[Signature] = Signature("reversal", per_cycle=2, direction="reversal", grows_with="speed")
    equations: ClassVar[str] = "F = 0 while |x| < gap / 2, else c (|x| - gap / 2) + d x' on the flank in contact"
    source: ClassVar[str] = "Modelica.Mechanics.Rotational.Components.ElastoBacklash, Modelica Standard Library 4.1"
    sentence: ClassVar[str] = (
        "The {where} gear pair has backlash of {gap_rad:.3g} rad ({gap_rad_shown}) from flank to flank: at every "
        "reversal of torque the load moves freely until the opposite tooth flanks meet."
    )
    urgent: ClassVar[bool] = True
    action: ClassVar[str] = (
        f"{SECURED} lock the motor, move the load by hand to and fro and read the free travel at the {{where}} "
        "gear; compare it with what the maker allows, and check preload, centre distance and fastening of that stage. "
        "Plan it for the next stop; sooner where the axis must hold a position."
    )
    check: ClassVar[str] = (
        "Block the load and let the motor push slowly to and fro: backlash shows as a flat middle of torque over "
        "angle, a soft spring does not."
    )
    behind_the_motor: ClassVar[bool] = True
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.BLOCKED})
    of_links: ClassVar[bool] = True
    own_hypothesis: ClassVar[bool] = True
    heard: ClassVar[Heard | None] = Heard(
        "backlash",
        "Add an encoder at the load and repeat the motion: the way between the flanks is the gap, and the stage "
        "with the backlash shows in how fast it is crossed.",
        left_out="Impacts where braking begins are no stronger than in good gearboxes.",
    )
    traits: ClassVar[Traits] = Traits(
        needs_no_trial=0.02,
        laws=frozenset({Law.SPRING}),
        form_left=0.06,  # teeth that hit
        gap=True,
    )

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        return (stage_at(axis, location).backlash_rad or UNSTATED_RAD) if axis.stages and location else 0.0

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return meshes(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name = place if place in train.components and axis_of(train).stages else "coupling"
        part = train[name]
        if not isinstance(part, ElastoBacklash):
            raise CompositionError(f"{name}: must be an ElastoBacklash to have backlash")
        return train.replace(name, replace(part, b=max(part.b, self["gap_rad"])))
