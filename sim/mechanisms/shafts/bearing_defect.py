"""A damaged rolling bearing: impulses at an order of its shaft that is no whole number."""

import math

from sim.chain.components import MeshLine, TorqueRipple
from sim.mechanisms.locations import every_shaft, shaft_name, unused_name
from sim.mechanisms.mechanism import Mechanics, Parameter, Signature, SoundReport, Traits
from sim.rotational.drive_train import DriveTrain

HARMONICS = 5


class BearingDefect(Mechanics):
    """Short torque pulses `order` times per revolution of the shaft, as their first five harmonics.

    Order of the outer race n / 2 (1 - d / D cos a), of the inner race n / 2 (1 + d / D cos a).

    Equations: tau on the shaft = torque sum of sin(k (order theta + phase)), k = 1 to 5
    Source: McFadden and Smith, J. Sound Vib. 96 (1984) 69
    """

    name = "bearing_defect"
    parameters = (
        Parameter("order", "1", 0.1, 200.0, 5.21),
        Parameter("torque_n_m", "N m", 0.0, 1e3, 0.05),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size = "torque_n_m"
    locations = every_shaft
    signature = Signature("angle", order="order")
    action = (
        "Find the bearing whose data sheet has this order (it is per turn of the motor; for a bearing on a slower"
        " shaft multiply it by the ratio up to there) and order a new one. Listen to all bearings near the motor "
        "with a stethoscope and look for flakes in the grease. Measure again in a week, and change the bearing "
        "before the level doubles."
    )
    check = (
        "Repeat the motion at two thirds of the speed with the sound: what keeps its order is the bearing; what "
        "keeps its frequency is not."
    )
    sound = SoundReport(
        "bearing defect",
        (
            "Repeat the motion at two thirds of the speed: what keeps its order is the bearing; what keeps its "
            "frequency is not."
        ),
        rejected="There are too few lines that no gear explains; a bearing makes more.",
        absent="The sound has no impacts at an order that no gear has.",
    )
    traits = Traits(
        urgent=True,
        own_hypothesis=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        lines = tuple(
            MeshLine(k * self["order"], self["torque_n_m"], k * self["phase_rad"]) for k in range(1, HARMONICS + 1)
        )
        shaft = shaft_name(train, place)
        return train.add(unused_name(train, f"{place}_bearing"), TorqueRipple(lines), flange=f"{shaft}.flange_a")
