"""Stiffness and damping of every elastic link of an axis: as described, else as gears usually have them.

One law for the simulation and for the model that an investigation starts from: a description is one machine.
"""

from __future__ import annotations

import math

from sim.description.axis import Axis

UNKNOWN_STIFFNESS_HZ = 80.0
"""Frequency of all that a link of unknown stiffness moves on its spring: stiff for a motion of some Hz, and slow enough
to be followed by a measurement at 1 kHz."""
UNKNOWN_DAMPING = 0.02
"""Share of critical damping: gears have some hundredths. By 0.03 an elastic robot with both encoders leaves 0.048
N m on unseen rows instead of 0.008."""


def inertia_behind(axis: Axis, k: int) -> float:
    """Inertia of all that link `k` moves, felt at its driven gear [kg m2]."""
    if not axis.stages:
        return axis.load.inertia_kg_m2
    here = axis.ratio_from(axis.stages[k].name)
    parts = sum(stage.inertia_kg_m2 * axis.ratio_from(stage.name) ** 2 for stage in axis.stages[k:])
    return (parts + axis.load.inertia_kg_m2) / here**2


def link_stiffness(axis: Axis, k: int) -> float:
    """Stiffness of link `k` at its driven gear [N m/rad]."""
    described = axis.stiffness()[k]
    return described or inertia_behind(axis, k) * (2.0 * math.pi * UNKNOWN_STIFFNESS_HZ) ** 2


def link_damping(axis: Axis, k: int) -> float:
    """Damping of link `k` at its driven gear [N m s/rad]; one that is described as 0 is none."""
    described = axis.damping()[k]
    return usual_damping(axis, k) if described is None else described


def usual_damping(axis: Axis, k: int) -> float:
    """Damping of link `k` where nobody knows it [N m s/rad]."""
    return 2.0 * UNKNOWN_DAMPING * math.sqrt(link_stiffness(axis, k) * inertia_behind(axis, k))


def compliance(axis: Axis) -> float:
    """Twist of all links per torque, at the load [rad/(N m)]."""
    after = [axis.ratio_from(stage.name) for stage in axis.stages] or [1.0]
    return sum(1.0 / (link_stiffness(axis, k) * ratio**2) for k, ratio in enumerate(after))
