"""Measurements in which mechanisms differ that look alike in a record."""

from __future__ import annotations

from enum import Enum


class Differing(Enum):
    """What to do, the most telling first; of a pair the first in which either differs, or both where both must."""

    AT_REST = (
        "Support the load (it may drop when the brake is released), hold the axis at rest with the brake open and log "
        "the torque, then move at two speeds in both directions: an offset stays, friction that differs by direction "
        "does not."
    )
    BY_SECOND_ENCODER = (
        "Put a dial gauge, a second encoder or a laser at the load and turn it slowly once: runout of the gear moves "
        "the load, an error of the encoder does not."
    )
    BY_LOOK = (
        "Look by endoscope at all teeth of the gear, or turn it slowly through a whole turn under load and log the "
        "torque: one damaged tooth makes it drop at one angle, errors of all teeth change it everywhere."
    )
    BLOCKED = (
        "Block the load, let the motor push slowly to and fro up to its torque limit and log torque against angle: "
        "backlash shows a flat middle, hardening a bend, hysteresis a loop."
    )
    OVER_A_TURN = (
        "Turn the load slowly through more than one revolution in both directions: an encoder's error needs no torque, "
        "eccentricity grows with speed squared, weight does not."
    )

    @property
    def of_both(self) -> bool:
        """Whether it is for two mechanisms that both name it, and not for one of them and any other."""
        return self in (Differing.BY_SECOND_ENCODER, Differing.BY_LOOK)
