"""An arm or a stand that swings by itself: a part of the load on a spring of its own."""

import math
from dataclasses import replace

from sim.mechanisms.locations import inertia, shaft_name, unused_name
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature, SoundReport, Traits, only
from sim.rotational.components import Inertia, SpringDamper
from sim.rotational.drive_train import DriveTrain


class StructuralResonance(Mechanics):
    """A share of the load's inertia hangs on a spring; its frequency is that with the rest of the load held.

    Equations: share J (a_s) = -c x - d x', c = share J (2 pi f)^2, d = 2 zeta share J 2 pi f
    Source: dynamic vibration absorber: Den Hartog, Mechanical Vibrations (1956), chapter 3
    """

    name = "structural_resonance"
    parameters = (
        Parameter("frequency_hz", "Hz", 0.1, 1000.0, 20.0),
        Parameter("share", "1", 0.0, 0.9, 0.1),
        Parameter("damping_ratio", "1", 0.0, 1.0, 0.02),
    )
    size = "share"
    locations = only("load")
    shown_by = frozenset({Need.LOAD_ENCODER})
    signature = Signature("frequency")
    sentence = (
        "Part of the load, {share:.0%} of its inertia, swings on its own at {frequency_hz:.3g} Hz: an arm, a tool or "
        "the stand is soft or loose."
    )
    action = (
        "Tighten arm, tool, covers and stand, and tap them: find the part that rings at {frequency_hz:.4g} Hz. Until "
        "then avoid motions that excite it."
    )
    check = (
        "Tap the arm at standstill and record the sound or the load encoder: a soft part rings at the same frequency "
        "without any motion."
    )
    sound = SoundReport(
        "resonance",
        "Tap covers, pipes, arm and stand at standstill and record that: the part that is loose rings at the same "
        "pitch without any motion.",
        rejected="No frequency has grown since the axis was new by more than others have fallen.",
    )
    traits = Traits(
        behind_the_motor=True,
        of_links=True,
        own_hypothesis=True,
        beside_the_chain=True,
        least_share=0.003,  # it bends to much
        form_left=0.2,  # it is driven by the load as it was measured, noise and all
        shakes_load=True,
        like_noise=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name = shaft_name(train, "load")
        load = inertia(train, name)
        part = load.J * self["share"]
        omega = 2 * math.pi * self["frequency_hz"]
        spring = SpringDamper(c=part * omega**2, d=2 * self["damping_ratio"] * part * omega)
        train = train.replace(name, replace(load, J=load.J - part))
        hung = {unused_name(train, "structure"): spring, unused_name(train, "structure_mass"): Inertia(J=part)}
        return train.branch(f"{name}.flange_b", **hung)
