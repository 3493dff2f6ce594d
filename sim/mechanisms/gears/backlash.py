"""Play between the teeth: more than the gear had as new."""

import math
from dataclasses import replace

from sim.description.axis import Axis
from sim.errors import CompositionError
from sim.mechanisms.locations import axis_of, meshes, stage_at
from sim.mechanisms.mechanism import SECURED, Discriminating, Law, Mechanics, Parameter, Signature, SoundReport, Traits
from sim.rotational.components import ElastoBacklash
from sim.rotational.drive_train import DriveTrain

UNSTATED_RAD = math.radians(1.0 / 60.0)
"""Backlash as new of a gear of which none is stated: no gear is without, and makers of precision gear units for robots
promise one minute of arc or less."""


class Backlash(Mechanics):
    """Total gap of a mesh; the teeth hit each other when the torque changes its sign.

    Equations: F = 0 while |x| < gap / 2, else c (|x| - gap / 2) + d x' on the flank in contact
    Source: Modelica.Mechanics.Rotational.Components.ElastoBacklash, Modelica Standard Library 4.1
    """

    name = "backlash"
    parameters = (Parameter("gap_rad", "rad", 0.0, 0.1, 1e-3),)
    size = "gap_rad"
    locations = meshes
    signature = Signature("reversal", per_cycle=2, direction="reversal")
    sentence = (
        "The {where} gear pair has backlash of {gap_rad:.3g} rad ({gap_rad_shown}) from flank to flank: at every "
        "reversal of torque the load moves freely until the opposite tooth flanks meet."
    )
    action = (
        f"{SECURED} keep the motor locked, move the load by hand to and fro and read the free travel at the {{where}} "
        "gear; compare it with what the maker allows, and check preload, centre distance and fastening of that stage. "
        "Plan it for the next stop; sooner where the axis must hold a position."
    )
    check = (
        "Block the load and let the motor push slowly to and fro: backlash shows as a flat middle of torque over "
        "angle, a soft spring does not."
    )
    discriminated_by = frozenset({Discriminating.BLOCKED})
    sound = SoundReport(
        "backlash",
        "Add an encoder at the load and repeat the motion: the way between the flanks is the gap, and the stage "
        "with the backlash shows in how fast it is crossed.",
        rejected="Impacts where braking begins are no stronger than in good gearboxes.",
    )
    traits = Traits(
        urgent=True,
        behind_the_motor=True,
        of_links=True,
        own_hypothesis=True,
        laws=frozenset({Law.SPRING}),
        form_left=0.06,  # teeth that hit
        gap=True,
    )

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        return (stage_at(axis, location).backlash_rad or UNSTATED_RAD) if axis.stages and location else 0.0

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name = place if place in train.components and axis_of(train).stages else "coupling"
        part = train[name]
        if not isinstance(part, ElastoBacklash):
            raise CompositionError(f"{name}: must be an ElastoBacklash to have backlash")
        return train.replace(name, replace(part, b=max(part.b, self["gap_rad"])))
