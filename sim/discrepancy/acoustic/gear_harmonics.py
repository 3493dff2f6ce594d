"""A damaged tooth of a gear that turns round several times in a stroke: all multiples of its turns in the envelope.

Its impacts come once per turn, so that the envelope of the sound has lines at every multiple of the shaft's order, far
more of them than a gear that runs out of true (Randall and Antoni, Mech. Syst. Signal Process. 25 (2011) 485).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.description.axis import Axis
from sim.discrepancy.acoustic.harmonic_comb import usual_height
from sim.discrepancy.acoustic.impacts import Tail
from sim.discrepancy.acoustic.operating_states import Course
from sim.discrepancy.acoustic.order_spectrum import STEP, bands_of, on_orders
from sim.discrepancy.acoustic.spectral_lines import mesh_orders
from sim.torsional.model import Array

HIGHEST_ORDER = 12.0
MULTIPLES = range(2, 24)  # runout makes the first
LEAST_MULTIPLES = 5
TURNS = 4.5  # of the gear in a cruise, so that the multiples stand apart
OF_OTHERS = 0.6  # of the resolution: as near a multiple may be a line of the motor or of teeth
LARGEST_POWER = 50.0  # of one cruise
# Scores of simulated gearboxes without such a tooth: of 262 in good order one reaches 3.3; with one it is 5 to 7.
TURNS_TAIL = Tail(start=1.9, share=0.05, scale=0.5)


@dataclass(frozen=True)
class Turns:
    """Lines at multiples of a gear's turns: the gear, its turns per revolution of the motor, score [nats], how many."""

    stage: str
    order: float
    score: float
    count: int


def hits_of_turns(axis: Axis, course: Course) -> Turns | None:
    """The gear between motor and load whose multiples stand out most, together; None where none can be looked for."""
    known = [(index, c) for index, c in enumerate(course.cruises) if c.turns_per_s is not None]
    best: Turns | None = None
    order = 1.0
    for stage in axis.stages[:-1]:
        order /= stage.ratio
        long = [(index, c) for index, c in known if c.turned * order > TURNS]
        if not long:
            continue
        resolution = 2.0 / min(c.turned for _, c in long)
        places = np.array([k * order for k in MULTIPLES if k * order < HIGHEST_ORDER - 1.0])
        places = places[_apart(axis, places) > OF_OTHERS * resolution]
        if places.size < LEAST_MULTIPLES:
            continue
        grid: Array = np.arange(STEP, HIGHEST_ORDER, STEP, dtype=np.float64)
        for band in bands_of(course):
            rows = [on_orders(grid, course.envelope(index, band), c.turns_per_s or 1.0) for index, c in long]
            power = np.asarray(np.minimum(rows, LARGEST_POWER).mean(axis=0))
            score, count = usual_height(grid, power, len(long), resolution, places)
            if best is None or score > best.score:
                best = Turns(stage.name, order, score, count)
    return best


def _apart(axis: Axis, orders: Array) -> Array:
    """How far orders are from the nearest of the motor's own and of the teeth."""
    teeth = np.array([k * mesh for mesh in mesh_orders(axis) for k in (1, 2, 3)] or [np.inf])
    of_teeth = np.abs(orders[:, None] - teeth).min(axis=1)
    return np.asarray(np.minimum(np.abs(orders - np.rint(orders)), of_teeth))
