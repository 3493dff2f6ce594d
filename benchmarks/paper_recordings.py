"""Recordings like the paper's: one configuration and one definition for its figures 5 to 9 and its measured rows.

What the paper says is taken from it (`sim.experiment.paper_axis`); the motion is one whose notch is met where figure 6
shows it. Every number that it leaves open stands in the middle of the range from which cases of any axis are drawn
(`sim.experiment.design_of_experiments`), but one: full speed is reached in 0.6 s, the slow end, because the paper's
normal recording has no more than noise has, and with a quicker start an as-new gear is heard to click at every
reversal. Nothing is fitted to play or notch.

Crest factor, for all: below 200 Hz, peak of every window of 0.1 s over the effective value of the whole record. That
trace is figures 8 and 9; its largest value is the crest factor of the record, and its mean over draws the row of the
table.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from casebase.signals.crest import peak_trace, root_mean_square
from casebase.signals.filters import low_pass
from casebase.signals.spectra import long_spectrum
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
WINDOW_S = 0.1
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


@dataclass(frozen=True, eq=False)
class CrestTrace:
    """Peak of every window of `WINDOW_S` below 200 Hz over the effective value of the record, shape (windows,) [1]."""

    values: Sound

    @classmethod
    def of(cls, sound: NDArray[np.floating], rate_hz: float = SAMPLE_RATE_HZ) -> CrestTrace:
        """Take it of a sound of shape (n,)."""
        samples = np.asarray(sound - sound.mean(), dtype=np.float32)
        heard = low_pass(long_spectrum(samples, rate_hz))
        window = round(WINDOW_S * rate_hz)
        return cls(peak_trace(heard, window, window) / np.float32(root_mean_square(heard)))

    @property
    def crest_factor(self) -> float:
        """Largest magnitude of the record over its effective value."""
        return float(self.values.max())

    @property
    def over_mean(self) -> float:
        """The largest value of the trace over its mean."""
        return float(self.values.max() / self.values.mean())

    def per(self, seconds: float) -> float:
        """Mean of the largest values of pieces of so many seconds."""
        count = round(seconds / WINDOW_S)
        pieces = self.values[: self.values.size // count * count].reshape(-1, count)
        return float(pieces.max(axis=1).mean())


@functools.cache
def usual_traces(label: str) -> tuple[CrestTrace, ...]:
    """The traces of `DRAWS` draws of the one configuration."""
    return tuple(crest_traces(label, DRAWS))


def crest_traces(label: str, draws: int, values: Mapping[str, float] = USUAL) -> list[CrestTrace]:
    """The traces of so many draws."""
    return [CrestTrace.of(scenario(label, seed, values).perform()) for seed in range(draws)]


def mean_crest_factor(label: str, draws: int, values: Mapping[str, float] = USUAL) -> float:
    """Crest factor of the record, mean over draws: what stands beside the paper's row."""
    return float(np.mean([trace.crest_factor for trace in crest_traces(label, draws, values)]))


def all_drawn(seed: int) -> dict[str, float]:
    """All open numbers drawn at once, each evenly over its range."""
    random = np.random.default_rng(seed)
    return {each.name: each.at(random.random()) for each in OPEN}
