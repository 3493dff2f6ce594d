"""What an investigation knows of a mechanism beforehand: how much it bends to whatever is missing, what it looks like.

A search reads these and never a name. The numbers were set on simulated axes with and without the mechanism.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

LEAST_GAIN = 20.0  # whitened squares, of a mechanism that says nothing else
LEAST_SHARE = 0.0006  # of the squared residual: what the form of a model differs from any real axis
FORM_SHARE = 0.015  # of another's gain: what any law leaves of its form
SIZE_SHARE = 0.08  # of a size, which the form of its law leaves open


UNLIKE = 0.03  # of a joint's friction, in both directions: published offsets of six joints of one arm are 0.4 to 5.6 %
WARMED = 0.05  # of a joint's friction, within a log: 6 and 10 % at two joints of that arm within 20 s


class Law(Enum):
    """Laws of one part of the machine: of two that follow it, each leaves its errors of form to the other."""

    SPRING = "torque over twist"
    FRICTION = "torque over speed and load"
    DISSIPATION = "torque against the motion"
    OFFSET = "torque that differs at rest alone"
    RIPPLE_OF_TEETH = "torque once per tooth"
    FLANKS = "contact of single teeth or of all"
    RUNOUT_OR_DENT = "once per turn of a gear, in contact"
    RUNOUT_OR_RIPPLE = "once per turn; an error of teeth also varies the ratio of the torques"

    @property
    def share(self) -> float:
        """Of another's gain, below which one is the error of its form."""
        return SHARES[self]


SHARES = {
    Law.SPRING: 0.1,
    Law.FRICTION: 0.35,
    Law.DISSIPATION: 0.1,
    Law.OFFSET: 0.1,
    Law.RIPPLE_OF_TEETH: 0.05,
    Law.FLANKS: 0.05,
    Law.RUNOUT_OR_DENT: 0.05,
    Law.RUNOUT_OR_RIPPLE: 0.1,
}


@dataclass(frozen=True)
class Traits:
    """How an investigation weighs a mechanism; the defaults hold for one of which nothing more is known.

    Parameters
    ----------
    least_gain
        Whitened squares that it must gain to be looked at; less where nothing else bends to it.
    least_share
        Of the squared residual: the least that it must gain, since no model has quite the form of an axis.
    over_bending
        What it must gain over the squares by which the description is bent beyond chance.
    needs_no_trial
        Share of the squared residual from which its gain needs no trial on unseen rows.
    laws
        What it is a law of.
    form_left
        Share of its own gain that its form leaves to others.
    form_of_any
        Share of any other's gain below which it is the error of the other's form.
    damping
        The same of what erring teeth gain: less damps what they shake.
    erring_teeth
        It shakes what is damped.
    size_open
        Share of its size that the form of its law leaves open.
    in_every_axis
        Every axis has it: a description without it leaves it out.
    known_within_a_little
        A number of the description itself: what it gains over that is no error of a form.
    like_an_offset
        The same torque as an offset while anything moves.
    in_good_order
        Share of a robot's joint's friction that a joint in good order has of it, within a log.
    over_strokes
        It acts over whole strokes, so that few rows say something of their own.
    restless
        It never rests: it gains in all blocks of a record.
    torque_over_angle
        It is torque over the angle of its shaft, which on one stiff body others have as well.
    shakes_load
        It is seen by what shakes the load.
    gap
        Its size is the gap of a mesh: the same lost motion may lie in another mesh.
    dent
        A dent of one flank: its place is scanned for along the wheels, and teeth may leave it before its bottom.
    once
        It happens once in a record, at times that the rows around them alone know.
    like_noise
        Noise that is taken from a fit without it holds none of it: it is seen by what noise is.
    """

    least_gain: float = LEAST_GAIN
    least_share: float = LEAST_SHARE
    over_bending: float = 0.0
    needs_no_trial: float = math.inf
    laws: frozenset[Law] = frozenset()
    form_left: float = FORM_SHARE
    form_of_any: float = 0.0
    damping: float = 0.0
    erring_teeth: bool = False
    size_open: float = SIZE_SHARE
    in_every_axis: bool = False
    known_within_a_little: bool = False
    like_an_offset: bool = False
    in_good_order: float = 0.0
    over_strokes: bool = False
    restless: bool = False
    torque_over_angle: bool = False
    shakes_load: bool = False
    gap: bool = False
    dent: bool = False
    once: bool = False
    like_noise: bool = False

    @property
    def loses_contact(self) -> bool:
        """Whether teeth leave each other by it."""
        return self.gap or self.dent
