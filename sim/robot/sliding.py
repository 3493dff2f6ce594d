"""Words for a joint that slides."""

from __future__ import annotations

SLIDING = (
    ("N m s/rad", "N s/m"), ("N m", "N"), ("rad/s", "m/s"), ("kg m2", "kg"), ("torque", "force"), ("angle", "position"),
    ("[°]", "[m]"),
)  # fmt: skip


def sliding_words(text: str) -> str:
    """Units of a joint that slides, force for torque, position for angle.

    >>> sliding_words("Viscous friction of 1.5 N m s/rad above 0.1 rad/s: torque of 2 N m")
    'Viscous friction of 1.5 N s/m above 0.1 m/s: force of 2 N'
    """
    for turning, along in SLIDING:
        text = text.replace(turning, along)
    return text
