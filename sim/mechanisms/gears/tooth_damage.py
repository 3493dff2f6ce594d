"""A notch, a broken or chipped tooth: material is missing on one flank of one tooth (the paper's notch)."""

import math
from dataclasses import replace

from sim.chain.components import MeshDent, Wheel
from sim.mechanisms.locations import axis_of, gear_mesh, teeth, wheels
from sim.mechanisms.mechanism import (
    SECURED,
    Discriminating,
    Law,
    Mechanics,
    Need,
    Parameter,
    Signature,
    SoundReport,
    Traits,
)
from sim.rotational.drive_train import DriveTrain


class ToothDamage(Mechanics):
    """Contact on the damaged flank comes later by the depth while that tooth is in mesh.

    Flank 1 carries positive torque to the driven gear. So the damage is felt when the contact force is on that flank,
    whatever the direction of motion. Width 0 means one pitch of the teeth on either side. Form 2 is a worn
    hollow, 10 a piece broken out.

    Equations: contact at x = gap / 2 + depth (1 - |u|^form)^4, u = (theta - angle) / width, |u| < 1
    Source: local loss of flank as a displacement: Liang, Zuo and Feng, Mech. Syst. Signal Process. 98 (2018)
    """

    name = "tooth_damage"
    parameters = (
        Parameter("angle_rad", "rad", 0.0, 2 * math.pi, 1.1, periodic=True),
        Parameter("depth_rad", "rad", 0.0, 0.05, 1e-3),
        Parameter("flank", "1", -1.0, 1.0, 1.0, choices=(-1.0, 1.0)),
        Parameter("width_rad", "rad", 0.0, math.pi, 0.0),
        Parameter("form", "1", 1.2, 40.0, 2.0, shown=False),
    )
    size = "depth_rad"
    locations = wheels
    shown_by = frozenset({Need.TWO_ROWS_PER_TOOTH})
    signature = Signature("angle", order=1, per_cycle=1, flank="one", direction="one")
    damage = "tooth breakage; pitting or spalling of one tooth (surface fatigue)"
    sentence = (
        "A flank of the {where} gear lacks material near {angle_rad:.3f} rad ({angle_rad_shown}), {depth_rad:.2g} rad "
        "({depth_rad_shown}) deep: once per revolution the torque drops there, in one direction of torque."
    )
    action = (
        f"{SECURED} open the {{where}} gear or look into it with an endoscope {{place}}, and look for steel in the "
        "oil. {urgency}"
    )
    check = (
        "Turn the {where} gear slowly through {at} under load in both directions of torque: a damaged tooth makes"
        " the torque drop at that angle and in one direction only, an error of all teeth changes it everywhere."
    )
    discriminated_by = frozenset({Discriminating.BY_LOOK})
    sound = SoundReport(
        "tooth damage",
        "Record motor torque and angle of motor and load of the same motion, slowly through a whole turn in both "
        "directions: they give the tooth, its depth and its flank.",
        rejected=("Impacts, and lines at the turns of a gear, are no stronger than in good gearboxes."),
    )
    traits = Traits(
        urgent=True,
        behind_the_motor=True,
        own_hypothesis=True,
        unseen_at=frozenset({"motor"}),
        least_share=0.004,  # it bends to much
        laws=frozenset({Law.SPRING, Law.FLANKS, Law.RUNOUT_OR_DENT}),
        form_left=0.06,  # teeth that hit
        size_open=0.3,  # the same torques come from a hollow and from a shallower piece broken out
        dent=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name, mesh = gear_mesh(train, place)
        width = self["width_rad"] or 2 * math.pi / teeth(axis_of(train), place)
        wheel: Wheel = "driver" if place == "motor" else "driven"
        dent = MeshDent(self["angle_rad"], width, self["depth_rad"], int(self["flank"]), wheel, self["form"])
        return train.replace(name, replace(mesh, dents=(*mesh.dents, dent)))
