"""Recordings like the paper's: one configuration and one definition for its figures 5 to 9 and its measured rows.

What the paper says is taken from it (`sim.experiment.paper_axis`); the motion is one whose notch is met where figure 6
shows it. Every number that it leaves open stands in the middle of the range from which cases of any axis are drawn
(`sim.experiment.design_of_experiments`), but one: full speed is reached in 0.6 s, the slow end, because the paper's
normal recording has no more than noise has, and with a quicker start an as-new gear is heard to click at every
reversal. Nothing is fitted to play or notch.

Crest factor, for all: `signals.crest.crest_trace`. Its trace is figures 8 and 9; the largest value is the
crest factor of the record, and the mean of that over draws the row of the table.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signals.crest import CrestTrace, crest_trace
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import MechanismEntry, Motion
from sim.experiment.design_of_experiments import (
    DEPTH_RAD,
    GAP_RAD,
    LOWEST_MODE_HZ,
    MICROPHONE,
    MODE_DAMPING,
    OPERATION,
    SPECIMEN,
    Range,
    scaled,
)
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.scenario import SETTLING_S, Scenario
from sim.experiment.specimen import Specimen
from sim.experiment.virtual_measurement import DEFAULT_MICROPHONE
from sim.mechanisms import Backlash, ToothDamage

Sound = NDArray[np.float32]
PAPER = {"normal": 3.43, "play": 9.35, "notch": 14.6}
"""Mean crest factor that the paper measured, by label."""

DRAWS = 20
SPEED_RAD_S = 2.7
REVOLUTION_S = math.tau / SPEED_RAD_S
STROKE_S, REVERSAL_S, NOTCH_S = 4.4, 2.6, 3.93
"""A stroke longer than a revolution; when the one begins that meets the notch, and when it is met first [s]."""

RECORD_S = 2 * STROKE_S
NAMES = {
    *("acceleration_time_s", "speed_bandwidth_rad_s", "error_factor", "friction_factor", "damping_factor"),
    *("rubbing_n_m", "rubbing_exponent", "ambient_share", "ambient_slope"),
}
OPEN: tuple[Range, ...] = (
    GAP_RAD,
    DEPTH_RAD,
    *(each for each in (*OPERATION, *SPECIMEN, *MICROPHONE) if each.name in NAMES),
    Range("lowest_mode_hz", *LOWEST_MODE_HZ),
    replace(MODE_DAMPING, name="lowest_mode_damping_ratio"),
    Range("payload_kg_m2", 20.0, 50.0),
)
"""What the paper leaves open; the payload is the range of its table 1."""

MIDDLE: Mapping[str, float] = {each.name: each.at(0.5) for each in OPEN}
USUAL: Mapping[str, float] = {**MIDDLE, "acceleration_time_s": 0.6}
"""The one configuration."""


def scenario(label: str, seed: int, values: Mapping[str, float] = USUAL) -> Scenario:
    """One draw of tooth errors and noise at given open numbers; the second stroke meets the notch."""
    ramp = values["acceleration_time_s"]
    motion = Motion(2 * STROKE_S, SPEED_RAD_S, ramp)
    angle = SPEED_RAD_S * (NOTCH_S - REVERSAL_S - ramp / 2)
    stroke = SPEED_RAD_S * (STROKE_S - ramp)
    faults = {
        "play": MechanismEntry(Backlash.name, "output", {"gap_rad": values["gap_rad"]}),
        "notch": MechanismEntry(ToothDamage.name, "output", {"angle_rad": angle, "depth_rad": values["depth_rad"]}),
    }
    axis = replace(
        PAPER_AXIS,
        motion=motion,
        servo=replace(PAPER_AXIS.servo, speed_bandwidth_rad_s=values["speed_bandwidth_rad_s"]),
        mechanisms=(faults[label],) if label in faults else (),
    )
    first, *others = DEFAULT_MICROPHONE.modes
    lowest = replace(first, frequency_hz=values["lowest_mode_hz"], damping_ratio=values["lowest_mode_damping_ratio"])
    microphone = replace(
        DEFAULT_MICROPHONE,
        modes=(lowest, *others),
        rubbing_n_m=values["rubbing_n_m"],
        rubbing_exponent=values["rubbing_exponent"],
    )
    return Scenario(
        axis=axis,
        payload_kg_m2=values["payload_kg_m2"],
        specimen=Specimen(seed, values["error_factor"], values["friction_factor"], values["damping_factor"]),
        microphone=scaled(
            microphone, ambient_share=values["ambient_share"], ambient_slope=values["ambient_slope"], level=0.05
        ),
        duration_s=RECORD_S,
        start_phase=(2 * STROKE_S - REVERSAL_S - SETTLING_S) / (2 * STROKE_S),
        middle_rad=stroke / 2,
        noise_seed=seed,
    )


def behind_the_play(each: Scenario) -> Scenario:
    """The same with the paper's 0.9 N m of bearing friction at the load, not the motor: there times the ratio."""
    motor, load = each.axis.motor, each.axis.load
    moved = load.coulomb_friction_n_m + motor.coulomb_friction_n_m * each.axis.ratio
    axis = replace(
        each.axis,
        motor=replace(motor, coulomb_friction_n_m=0.0),
        load=replace(load, coulomb_friction_n_m=moved),
    )
    return replace(each, axis=axis)


def trace_of(each: Scenario) -> CrestTrace:
    """The crest factor over time of what is heard."""
    return crest_trace(each.perform(), SAMPLE_RATE_HZ)


@functools.cache
def usual_traces(label: str) -> tuple[CrestTrace, ...]:
    """The traces of `DRAWS` draws of the one configuration."""
    return tuple(trace_of(scenario(label, seed)) for seed in range(DRAWS))
