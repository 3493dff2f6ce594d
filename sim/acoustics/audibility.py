"""How well a fault is heard: its own part of the sound over all the rest of it.

A fault that nobody could hear teaches a library nothing but its label, so a planned fault that would drown is heard
from nearer: rubbing and ambient noise are lowered until it stands out. Its size stays what the plan says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone
from sim.experiment.scenario import Scenario
from sim.experiment.virtual_measurement import heard_forces
from sim.rotational.trajectory import Trajectory

BAND_HZ = (12.0, 200.0)  # the paper's low-pass, and above what a microphone turns into sound
JUST_HEARD = 3.0  # over the RMS of the rest; noise of this band itself peaks at 4.4 in 10 s, but not at one place
WELL_HEARD = 6.0  # what would drown is brought between the two
QUIETEST = 1 / 30  # how far noise is lowered at most


@dataclass(frozen=True)
class AudibleFault:
    """A recording of a fault.

    Parameters
    ----------
    scenario
        As it was performed, noise lowered where that was needed.
    ratio
        Largest value of the fault's part over the RMS of the rest, both within `BAND_HZ`.
    """

    sound: NDArray[np.float32]
    scenario: Scenario
    ratio: float


@dataclass(frozen=True)
class FaultRun:
    """A scenario whose last mechanism is a fault, run with and without it; any microphone may then listen."""

    scenario: Scenario
    run: Trajectory
    rest: Trajectory

    @classmethod
    def of(cls, scenario: Scenario) -> FaultRun:
        """Run it."""
        return cls(scenario, scenario.simulate(), _healthy(scenario).simulate())

    def heard_by(self, microphone: Microphone, noise_seed: int) -> AudibleFault:
        """What a microphone hears, brought nearer where the fault would drown."""
        scenario = replace(self.scenario, microphone=microphone, noise_seed=noise_seed)
        peak = _peak(scenario, self.run, self.rest)
        ratio = peak * microphone.gain / _rest(scenario, self.rest)
        if ratio < JUST_HEARD:
            random = np.random.default_rng(noise_seed)
            wanted = JUST_HEARD * (WELL_HEARD / JUST_HEARD) ** random.random()
            microphone = _nearer(microphone, max(ratio / wanted, QUIETEST))
            scenario = replace(scenario, microphone=microphone)
            ratio = peak * microphone.gain / _rest(scenario, self.rest)
        return AudibleFault(scenario.hear(self.run), scenario, ratio)


def perform_fault(scenario: Scenario) -> AudibleFault:
    """Perform a scenario whose last mechanism is a fault, so that it can be heard."""
    return FaultRun.of(scenario).heard_by(scenario.microphone, scenario.noise_seed)


def _healthy(scenario: Scenario) -> Scenario:
    return replace(scenario, axis=replace(scenario.axis, mechanisms=scenario.axis.mechanisms[:-1]))


def _peak(scenario: Scenario, run: Trajectory, rest: Trajectory) -> float:
    """Largest value within the band of what the fault adds, at gain 1: without noise, sound is linear in the force."""
    added, speed = heard_forces(run, scenario.axis)
    without, _ = heard_forces(rest, scenario.axis)
    added[:, : without.shape[1]] -= without
    silent = replace(scenario.microphone, rubbing_n_m=0.0, ambient_n_m=0.0, gain=1.0)
    edge = round(0.1 * SAMPLE_RATE_HZ)
    return float(np.abs(_in_band(replace(scenario, microphone=silent).hear_forces(added, speed))[edge:-edge]).max())


def _rest(scenario: Scenario, rest: Trajectory) -> float:
    return math.sqrt(float(np.mean(_in_band(_healthy(scenario).hear(rest)) ** 2)))


def _in_band(sound: NDArray[np.float32]) -> NDArray[np.float64]:
    from scipy import signal  # slow to import

    sections = signal.butter(4, BAND_HZ, "bandpass", fs=SAMPLE_RATE_HZ, output="sos")
    return np.asarray(signal.sosfilt(sections, sound.astype(np.float64)))


def _nearer(microphone: Microphone, factor: float) -> Microphone:
    """Less noise at the same loudness of the noise in the recording, so that the gain rises."""
    return replace(
        microphone,
        rubbing_n_m=microphone.rubbing_n_m * factor,
        ambient_n_m=microphone.ambient_n_m * factor,
        gain=microphone.gain / math.sqrt(factor),
    )
