"""How large a fault is, from cases simulated for the recording at hand: its axis, speed, payload and motion.

Cases of the library differ from a recording in motion and payload as much as in the size of their fault, and the
size drowns in that. So the fault is simulated as the recording was taken, with many sizes, specimens and microphones,
and its size is read off what these have in common: the features of the catalogue and `signals.bump_profile`,
whichever predicts left-out specimens best. A recording with the period and the speed of the axis's description has its
acceleration, rest and servo, too. Otherwise what the loudness says of the motion (how long the axis is slow around a
reversal) narrows them, and the servo is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from app.simulated.generation import condition_of, in_parallel
from casebase.reasoning.severity import FEWEST, PARAMETERS, Regression, Scaling, Severity
from signals.analysis import Analysis
from signals.bump_profile import bump_ratios_db, reversal_trace_db
from signals.condition import OperatingCondition
from signals.features import Motion, catalogue, feature_values
from signals.motion import HOP_HZ
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone
from sim.description.axis import Axis, Servo
from sim.description.axis import Motion as Movement
from sim.errors import ParameterError
from sim.experiment.design_of_experiments import Planned, detuned, moved, plan, usual_microphone
from sim.experiment.scenario import Scenario

Floats = NDArray[np.float64]
RUNS, LISTENERS = 160, 3  # simulated specimens, and microphones that hear each
LONGEST_HALF_S = 1.0  # of the trace around a reversal
COMPONENTS = 20  # principal components that stand for a trace
AT_MOST = 0.9  # share of the sizes among unheard cases that lies below what is said
LONGEST_S = 20.0  # of the recording that is simulated
SLOW_SHARE = 1.56  # of the acceleration time on either side is a decibel quieter or more than full speed
SAME = 0.03  # a period and a speed that differ by less are those of the description
SLOW_SPREAD = (0.8, 1.2)  # how well the time in which an axis is slow can be heard


@dataclass(frozen=True)
class Taken:
    """How a recording was taken: what has to be alike in the simulation.

    Parameters
    ----------
    speed_rad_s, payload_kg_m2, period_s
        Largest speed and inertia of the output, one cycle of back and forth.
    slow_s
        Time around a reversal in which the axis is heard to be slower than on its way [s].
    described
        The motion and the servo, where the recording has those of the axis's description.
    """

    speed_rad_s: float
    payload_kg_m2: float
    period_s: float
    slow_s: float
    duration_s: float
    described: tuple[Movement, Servo] | None = None

    @classmethod
    def of(
        cls,
        axis: Axis,
        motion: Motion,
        duration_s: float,
        speed_rad_s: float | None = None,
        payload_kg_m2: float | None = None,
    ) -> Taken:
        """From what a recording says, the axis's description where speed or payload were not noted.

        Raises ParameterError where the recording has no period.
        """
        if not motion.period_s:
            raise ParameterError("recording: no back and forth is heard in it; say --period")
        start, end = motion.slow_s
        speed, usual = speed_rad_s or axis.motion.load_speed_rad_s, axis.motion
        same = max(abs(motion.period_s / usual.period_s - 1), abs(speed / usual.load_speed_rad_s - 1)) < SAME
        return cls(
            speed,
            payload_kg_m2 or axis.load.inertia_kg_m2,
            motion.period_s,
            end - start,
            min(duration_s, LONGEST_S),
            (usual, axis.servo) if same else None,
        )

    def motion_like(self, ramp_s: float, random: np.random.Generator) -> Movement:
        """The motion described, or one that is heard to be slow as long as this, with about this acceleration time."""
        if self.described:
            return self.described[0]
        slow = self.slow_s * random.uniform(*SLOW_SPREAD)
        ramp = min(ramp_s, slow / SLOW_SHARE, 0.2 * self.period_s)
        dwell = min(max(slow - SLOW_SHARE * ramp, 0.0), 0.45 * self.period_s - 2 * ramp)
        return Movement(self.period_s, self.speed_rad_s, ramp, dwell)

    @property
    def half_s(self) -> float:
        """How far the trace around a reversal reaches: half a stroke, or until the axis runs evenly again."""
        return min(self.period_s / 4, LONGEST_HALF_S)


@dataclass(frozen=True, eq=False)
class Design:
    """Simulated cases of one label: profiles (cases, n), sizes [rad] and specimens (cases,)."""

    label: str
    taken: Taken
    profiles: Floats
    sizes: Floats
    specimens: NDArray[np.intp]

    def size_of(self, recording: Recording, condition: OperatingCondition) -> Severity:
        """Size of the fault in a recording.

        Of a fault that is not heard it is only known that it is small: the interval then begins at 0, and ends where
        nine of ten simulated cases that are not heard either lie below.
        """
        profile = profile_of(recording, condition, self.taken.half_s)[None]
        unheard = self.sizes[~self._heard]
        if not self._heard_in(profile)[0] and unheard.size >= FEWEST:
            middle, most = np.quantile(unheard, (0.5, AT_MOST))
            return Severity(PARAMETERS[self.label], float(middle), 0.0, float(most), int(unheard.size))
        columns, scaling, regression = self._fitted
        return regression.severity(PARAMETERS[self.label], scaling.apply(self._reduced(profile)[:, columns]))

    @cached_property
    def _fitted(self) -> tuple[NDArray[np.intp], Scaling, Regression]:
        """Which columns tell the size of left-out specimens best, and the regression on them."""
        trace, rest = np.arange(COMPONENTS), np.arange(COMPONENTS, COMPONENTS + self.profiles.shape[1] - self._trace)
        known, sizes, fits = self._reduced(self.profiles)[self._used], self.sizes[self._used], []
        for columns in (trace, rest, np.concatenate([trace, rest])):
            scaling = Scaling.of(known[:, columns], sizes)
            regression = Regression.of(scaling.apply(known[:, columns]), sizes, self.specimens[self._used])
            fits.append((columns, scaling, regression))
        return min(fits, key=lambda fit: fit[2].score)

    @cached_property
    def _heard(self) -> NDArray[np.bool_]:
        return self._heard_in(self.profiles)

    @cached_property
    def _used(self) -> NDArray[np.bool_]:
        """Cases that the regression is fitted to: those that are heard, all where hardly any is."""
        return self._heard if self._heard.sum() >= FEWEST else np.ones_like(self._heard)

    def _heard_in(self, profiles: Floats) -> NDArray[np.bool_]:
        place = list(catalogue()).index(f"{self.label}_bump_12_200_hz")
        return np.asarray(profiles[:, self._trace + place] > 0)

    @property
    def _trace(self) -> int:
        return 2 * round(self.taken.half_s * HOP_HZ)

    @cached_property
    def _basis(self) -> tuple[Floats, Floats]:
        """Mean trace and its principal components, shape (trace, COMPONENTS)."""
        trace = self.profiles[self._used, : self._trace]
        known = np.isfinite(trace)
        center = np.where(known, trace, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        _, _, directions = np.linalg.svd(np.where(known, trace - center, 0.0), full_matrices=False)
        basis = np.zeros((self._trace, COMPONENTS))
        basis[:, : min(COMPONENTS, len(directions))] = directions[:COMPONENTS].T
        return center, basis

    def _reduced(self, profiles: Floats) -> Floats:
        """Profiles with principal components in place of the trace."""
        center, basis = self._basis
        trace = np.nan_to_num(profiles[:, : self._trace] - center) @ basis
        return np.concatenate([trace, profiles[:, self._trace :]], axis=1)


def profile_of(recording: Recording, condition: OperatingCondition, half_s: float) -> Floats:
    """What sizes are read from: trace around the reversal, features of the catalogue, ratios of the bump; shape (n,).

    Features that follow the gain are missing.
    """
    analysis = Analysis(recording, condition)
    compared = np.array([definition.compared for definition in catalogue().values()])
    features = np.where(compared, feature_values(analysis), np.nan)
    return np.concatenate([reversal_trace_db(analysis, half_s), features, bump_ratios_db(analysis)])


def design_for(
    axis: Axis,
    label: str,
    taken: Taken,
    microphones: Sequence[Microphone] = (),
    *,
    seed: int = 0,
    processes: int = 1,
    advance: Callable[[], None] = lambda: None,
) -> Design:
    """Simulate a fault in `RUNS` specimens as a recording was taken, each heard by `LISTENERS` microphones.

    Parameters
    ----------
    microphones
        Paths fitted to the place; without any, housings are drawn from all that is usual.

    Raises ParameterError for a label whose size is not known.
    """
    if label not in PARAMETERS:
        raise ParameterError(f"label: the size of {label!r} is not known; {', '.join(PARAMETERS)} have one")
    planned = plan(axis, {label: RUNS}, seed, microphones=microphones, duration_s=taken.duration_s)
    tasks = [_Task(each, taken, tuple(microphones), (seed, number)) for number, each in enumerate(planned)]
    profiles = []
    for heard in in_parallel(_heard, tasks, processes, 4):
        profiles.append(heard)
        advance()
    sizes = np.array([each.size for each in planned], dtype=np.float64)
    number = np.arange(len(planned))
    everything = np.concatenate(profiles)
    return Design(label, taken, everything, np.repeat(sizes, LISTENERS), np.repeat(number, LISTENERS))


@dataclass(frozen=True)
class _Task:
    planned: Planned
    taken: Taken
    microphones: tuple[Microphone, ...]
    seed: tuple[int, int]


def _heard(task: _Task) -> Floats:
    """Profiles of one specimen as its microphones hear it, shape (LISTENERS, n)."""
    random = np.random.default_rng(task.seed)
    scenario = as_taken(task.planned, task.taken, random)
    run, profiles = scenario.simulate(), []
    for _ in range(LISTENERS):
        listener = (
            detuned(task.microphones[int(random.integers(len(task.microphones)))], random)
            if task.microphones
            else usual_microphone(random)
        )
        heard = replace(scenario, microphone=listener, noise_seed=int(random.integers(2**31)))
        performed, sound = heard.with_head_room(heard.hear(run))
        profiles.append(profile_of(Recording(sound, SAMPLE_RATE_HZ), condition_of(performed), task.taken.half_s))
    return np.array(profiles)


def as_taken(planned: Planned, taken: Taken, random: np.random.Generator) -> Scenario:
    """A specimen with its fault, moved as the recording was taken."""
    motion = taken.motion_like(planned.scenario.axis.motion.acceleration_time_s, random)
    scenario = moved(planned, motion, taken.payload_kg_m2).scenario
    if taken.described and taken.described[1].speed_bandwidth_rad_s:
        scenario = replace(scenario, axis=replace(scenario.axis, servo=taken.described[1]))
    return scenario
