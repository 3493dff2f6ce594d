"""How large a fault is, from cases simulated for the recording at hand: its axis, speed, payload and motion.

Cases of the library differ from a recording in motion and payload as much as in the size of their fault, and the
size drowns in that. So the fault is simulated as the recording was taken, with many sizes, specimens, servos and
microphones, and its size is read off what these have in common (`casebase.severity`). A recording with the period and
the speed of the axis's description has its acceleration, rest and servo, too. Otherwise what the loudness says of the
motion (how long the axis is slow around a reversal) narrows them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.generation import condition_of, in_parallel
from casebase.severity import PARAMETERS, Severity, estimate
from casebase.signals.features import Extraction, Motion, extract
from casebase.signals.recording import Recording
from sim.audibility import FaultRun
from sim.axis import Axis, Servo
from sim.axis import Motion as Movement
from sim.design import Planned, detuned, moved, plan, usual_microphone
from sim.errors import ParameterError
from sim.sound import SAMPLE_RATE_HZ, Microphone

RUNS, LISTENERS = 64, 3  # simulated specimens, and microphones that hear each
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


@dataclass(frozen=True, eq=False)
class Design:
    """Simulated cases of one label: features (cases, n), sizes [rad] and specimens (cases,)."""

    label: str
    values: NDArray[np.float32]
    sizes: NDArray[np.float64]
    specimens: NDArray[np.intp]

    def size_of(self, extraction: Extraction) -> Severity | None:
        """Size of the fault in a recording; None where nothing can be compared."""
        values = extraction.features.values
        return estimate(PARAMETERS[self.label], self.values, self.sizes, values, self.specimens)


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
    values = []
    for heard in in_parallel(_heard, tasks, processes, 4):
        values.append(heard)
        advance()
    sizes = np.array([each.size for each in planned], dtype=np.float64)
    number = np.arange(len(planned))
    return Design(label, np.concatenate(values), np.repeat(sizes, LISTENERS), np.repeat(number, LISTENERS))


@dataclass(frozen=True)
class _Task:
    planned: Planned
    taken: Taken
    microphones: tuple[Microphone, ...]
    seed: tuple[int, int]


def _heard(task: _Task) -> NDArray[np.float32]:
    """Features of one specimen as its microphones hear it, shape (LISTENERS, n)."""
    random = np.random.default_rng(task.seed)
    motion = task.taken.motion_like(task.planned.scenario.axis.motion.acceleration_time_s, random)
    scenario = moved(task.planned, motion, task.taken.payload_kg_m2).scenario
    if task.taken.described and task.taken.described[1].speed_bandwidth_rad_s:
        scenario = replace(scenario, axis=replace(scenario.axis, servo=task.taken.described[1]))
    run = FaultRun.of(scenario)
    values = []
    for _ in range(LISTENERS):
        listener = (
            detuned(task.microphones[int(random.integers(len(task.microphones)))], random)
            if task.microphones
            else usual_microphone(random)
        )
        heard = run.heard_by(listener, int(random.integers(2**31)))
        performed, sound = heard.scenario.with_head_room(heard.sound)
        values.append(extract(Recording(sound, SAMPLE_RATE_HZ), condition_of(performed)).features.values)
    return np.array(values)
