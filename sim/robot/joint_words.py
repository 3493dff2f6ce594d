"""Words for a joint that slides, and for one of which no drive is described."""

from __future__ import annotations

from sim.robot.robot import Robot, slides

SLIDING = (
    ("N m s/rad", "N s/m"), ("N m", "N"), ("rad/s", "m/s"), ("kg m2", "kg"), ("torque", "force"), ("angle", "position"),
    ("[°]", "[m]"),
)  # fmt: skip
WITHOUT_MOTOR = (
    ("of the motor", "of the joint"), ("at the motor", "at the joint"), ("of motor", "of the joint"),
    ("of load", "of the joint"), ("motor torque", "torque of the joint"), ("motor ahead", "joint ahead"),
)  # fmt: skip
"""Where nothing turns otherwise than the joint."""


def joint_words(robot: Robot, place: int, text: str) -> str:
    """A text about an axis as one about a joint: units of one that slides, and no motor where none is described."""
    for before, after in (
        *(() if robot.joints[place].described else WITHOUT_MOTOR),
        *(SLIDING if slides(robot, place) else ()),
    ):
        text = text.replace(before, after)
    return text
