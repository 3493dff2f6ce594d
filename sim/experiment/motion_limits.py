"""What a motion of an axis cannot show: teeth that are never met, and a torque that does not turn round on the way.

Without such a turn play is crossed at standstill alone, and each flank carries in one direction alone.
"""

import math
from dataclasses import replace

import numpy as np

from signals.motion_profile import MotionProfile
from sim.description.axis import Axis, Load
from sim.mechanisms import GravityImbalance

NOT_COVERED = "no fault does not cover "
"""Begins each of the sentences."""


def turn_shares(axis: Axis, stroke_rad: float) -> dict[str, float]:
    """Return which share of their turn the gears on each shaft make, where that is less than 99.5 % [1]."""
    shafts = axis.locations[:-1] if axis.stages else ()
    shares = {shaft: stroke_rad * axis.ratio_from(shaft) / math.tau for shaft in shafts}
    return {shaft: share for shaft, share in shares.items() if share < 0.995}


def braking_torques(load: Load, motion: MotionProfile) -> tuple[float, float]:
    """Return what inertia gives and friction takes at the output, where in braking the one outweighs the other most or
    comes nearest to it [N m]."""
    time_s = np.linspace(0, motion.moving_s, 2001)
    speed = motion.speeds(time_s)
    given = -load.inertia_kg_m2 * np.gradient(speed, time_s)
    taken = load.coulomb_friction_n_m + load.viscous_friction_n_m_s_per_rad * speed
    at = int(np.argmax(given - taken))
    return float(given[at]), float(taken[at])


def not_covered(axis: Axis, motion: MotionProfile, payload_kg_m2: float | None = None) -> tuple[str, ...]:
    """Return what "no fault" does not cover, and the smallest motion that would test it, one sentence each."""
    found = [
        f"{NOT_COVERED}{1 - share:.0%} of the turn of {shaft}: the stroke of {motion.stroke_rad:.3g} rad never "
        f"meets its teeth there; one of {motion.stroke_rad / share:.3g} rad would"
        for shaft, share in turn_shares(axis, motion.stroke_rad).items()
    ]
    load = replace(axis.load, inertia_kg_m2=payload_kg_m2 or axis.load.inertia_kg_m2)
    given, taken = braking_torques(load, motion)
    weighed = any(entry.name == GravityImbalance.name for entry in axis.mechanisms)
    if axis.stages and load.inertia_kg_m2 > 0 and given <= taken and not weighed:
        least = load.coulomb_friction_n_m / load.inertia_kg_m2
        found.append(
            f"{NOT_COVERED}a torque that turns round on the way: braking gives {given:.3g} N m at the output and "
            f"friction takes {taken:.3g} N m, so play is crossed at standstill alone and each flank carries in one "
            f"direction alone; braking with more than {least:.3g} rad/s2 until standstill would turn it round"
        )
    return tuple(found)
