"""A notch, a broken or chipped tooth: material is missing on one flank of one tooth (the paper's notch)."""

import math
from dataclasses import replace
from typing import ClassVar

from sim.chain.components import MeshDent, Wheel
from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.heard import Heard
from sim.mechanisms.mechanism import SECURED, Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import axis_of, gear_mesh, teeth, wheels
from sim.mechanisms.traits import Law, Traits
from sim.rotational.drive_train import DriveTrain


class ToothDamage(Mechanics):
    """Contact on the damaged flank comes later by the depth while that tooth is in mesh.

    Flank 1 carries positive torque to the driven gear. So the damage is felt when the contact force is on that flank,
    whatever the direction of motion. Width 0 means one pitch of the teeth on either side. Form 2 is a worn
    hollow, 10 a piece broken out.
    """

    name: ClassVar[str] = "tooth_damage"
    workshop_name: ClassVar[str] = "notch"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("angle_rad", "rad", 0.0, 2 * math.pi, 1.1, periodic=True),
        Parameter("depth_rad", "rad", 0.0, 0.05, 1e-3),
        Parameter("flank", "1", -1.0, 1.0, 1.0, choices=(-1.0, 1.0)),
        Parameter("width_rad", "rad", 0.0, math.pi, 0.0),
        Parameter("form", "1", 1.2, 40.0, 2.0, shown=False),
    )
    size: ClassVar[str] = "depth_rad"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.TWO_ROWS_PER_TOOTH})
    signature: ClassVar[Signature] = Signature(
        "angle", order=1, per_cycle=1, flank="one", direction="one", grows_with="load"
    )
    damage: ClassVar[str] = "tooth breakage; pitting or spalling of one tooth (surface fatigue)"
    equations: ClassVar[str] = "contact at x = gap / 2 + depth (1 - |u|^form)^4, u = (theta - angle) / width, |u| < 1"
    source: ClassVar[str] = (
        "local loss of flank as a displacement: Liang, Zuo and Feng, Mech. Syst. Signal Process. 98 (2018)"
    )
    sentence: ClassVar[str] = (
        "A flank of the {where} gear lacks material near {angle_rad:.3f} rad ({angle_rad_shown}), {depth_rad:.2g} rad "
        "({depth_rad_shown}) deep: once per revolution the torque drops there, in one direction of torque."
    )
    urgent: ClassVar[bool] = True
    action: ClassVar[str] = (
        f"{SECURED} open the {{where}} gear or look into it with an endoscope {{place}}, and look for steel in the "
        "oil. {urgency}"
    )
    check: ClassVar[str] = (
        "Turn the {where} gear slowly through {at} under load in both directions of torque: a damaged tooth makes"
        " the torque drop at that angle and in one direction only, an error of all teeth changes it everywhere."
    )
    behind_the_motor: ClassVar[bool] = True
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.BY_LOOK})
    unseen_at: ClassVar[frozenset[str]] = frozenset({"motor"})
    own_hypothesis: ClassVar[bool] = True
    heard: ClassVar[Heard | None] = Heard(
        "tooth damage",
        "Record motor torque and angle of motor and load of the same motion, slowly through a whole turn in both "
        "directions: they give the tooth, its depth and its flank.",
        left_out=("Impacts, and lines at the turns of a gear, are no stronger than in good gearboxes."),
    )
    traits: ClassVar[Traits] = Traits(
        least_share=0.004,  # it bends to much
        over_bending=1.1,
        needs_no_trial=0.2,
        laws=frozenset({Law.SPRING, Law.FLANKS, Law.RUNOUT_OR_DENT}),
        form_left=0.06,  # teeth that hit
        size_open=0.3,  # the same torques come from a hollow and from a shallower piece broken out
        dent=True,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return wheels(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name, mesh = gear_mesh(train, place)
        width = self["width_rad"] or 2 * math.pi / teeth(axis_of(train), place)
        wheel: Wheel = "driver" if place == "motor" else "driven"
        dent = MeshDent(self["angle_rad"], width, self["depth_rad"], int(self["flank"]), wheel, self["form"])
        return train.replace(name, replace(mesh, dents=(*mesh.dents, dent)))
