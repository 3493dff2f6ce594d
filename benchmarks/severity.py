"""How well the size of a fault is told from sound alone: simulated recordings of other specimens and microphones.

`python -m benchmarks severity`, or `python -m benchmarks.severity LABEL`. States of operation (motion, payload, servo)
are drawn, and in each of them recordings of fresh specimens by fresh microphones, whose lower limit, unlike that of
the microphones the estimate learns from, is drawn as well. Told is what a measurement tells: speed and payload, and in
the rows that say so the motion and the servo as the axis's description has them. Beside it: always saying the middle
of the range. A fault that is not heard is answered by 'at most', and counted apart.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.simulated.generation import condition_of
from app.simulated.severity_by_simulation import LISTENERS, RUNS, Design, Taken, design_for
from benchmarks import Row
from casebase.reasoning.severity import COVERAGE, PARAMETERS, Severity
from signals.condition import OperatingCondition
from signals.features import extract
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.experiment.design_of_experiments import Planned, moved, plan, usual_microphone
from sim.experiment.paper_axis import PAPER_AXIS

STATES, EACH = 4, 14  # states of operation, and recordings of each
DURATION_S = 10.0
SEED = 20_000  # of what is tested; no case that it is held against comes from it
LOWEST_HZ = (20.0, 45.0)  # of the microphones that are tested


@dataclass(frozen=True, eq=False)
class Test:
    """A recording of known size."""

    size: float
    recording: Recording
    condition: OperatingCondition


@dataclass(frozen=True)
class Found:
    """What was said of a recording of known size, and what always saying the middle would have been."""

    size: float
    severity: Severity
    middle: float

    @property
    def inside(self) -> bool:
        """Whether the interval holds the size."""
        return self.severity.low <= self.size <= self.severity.high


def tests(label: str, state: int) -> tuple[Planned, list[Test]]:
    """A state of operation, and recordings of fresh specimens in it."""
    planned = plan(PAPER_AXIS, {label: STATES * (EACH + 1)}, SEED, duration_s=DURATION_S)
    chosen, others = planned[state], planned[STATES + state * EACH : STATES + (state + 1) * EACH]
    motion, servo, payload = chosen.scenario.axis.motion, chosen.scenario.axis.servo, chosen.scenario.payload_kg_m2
    found = []
    for number, each in enumerate(others):
        random = np.random.default_rng([SEED, state, number])
        scenario = moved(each, motion, payload).scenario
        microphone = replace(usual_microphone(random), lowest_hz=float(random.uniform(*LOWEST_HZ)))
        scenario = replace(
            scenario, axis=replace(scenario.axis, servo=servo), microphone=microphone, noise_seed=SEED + number
        )
        performed, sound = scenario.with_head_room(scenario.perform())
        assert each.size is not None
        found.append(Test(each.size, Recording(sound, SAMPLE_RATE_HZ), condition_of(performed)))
    return chosen, found


def found_in(label: str, state: int, described: bool, processes: int) -> Iterator[Found]:
    """What is said of the recordings of one state."""
    chosen, recordings = tests(label, state)
    scenario = chosen.scenario
    motions = [extract(each.recording, each.condition).motion for each in recordings]
    motion = next(each for each in motions if each.period_s)
    axis = replace(scenario.axis, mechanisms=()) if described else PAPER_AXIS
    speed = scenario.axis.motion.load_speed_rad_s
    taken = Taken.of(axis, motion, DURATION_S, speed, scenario.payload_kg_m2)
    design: Design = design_for(axis, label, taken, seed=state, processes=processes)
    middle = float(np.exp(np.mean(np.log(design.sizes))))
    for each in recordings:
        yield Found(each.size, design.size_of(each.recording, each.condition), middle)


def rows(label: str, described: bool, states: int = STATES, processes: int = 2) -> Iterator[Row]:
    """Median error and coverage of the interval over all states, and the errors state by state."""
    known, started = "motion described" if described else "motion as heard", time.perf_counter()
    by_state = [list(found_in(label, state, described, processes)) for state in range(states)]
    took = (time.perf_counter() - started) / states
    heard = [[found for found in state if not found.severity.at_most] for state in by_state]
    unheard = [found for state in by_state for found in state if found.severity.at_most]
    every = [found for state in heard for found in state]
    widths = [found.severity.high / found.severity.low for found in every]
    note = (
        f"median error {_error(every):.0%} (by state {', '.join(f'{_error(state):.0%}' for state in heard)}; always "
        f"the middle: {np.median([abs(found.middle / found.size - 1) for found in every]):.0%}), interval holds it in "
        f"{np.mean([found.inside for found in every]):.0%} (said: {COVERAGE:.0%}), its ends a factor "
        f"{np.median(widths):.1f} apart; heard from {1e3 * min(found.size for found in every):.2f} to "
        f"{1e3 * max(found.size for found in every):.2f} mrad"
    )
    if unheard:
        note += f"; {len(unheard)} not heard, 'at most' holds in {sum(found.inside for found in unheard)}"
    yield Row(f"{label}, {PARAMETERS[label]}, {known}: {len(every)} recordings", took, note=note)


def _error(found: Sequence[Found]) -> float:
    return float(np.median([abs(each.severity.value / each.size - 1) for each in found])) if found else float("nan")


def run(labels: Sequence[str] = tuple(PARAMETERS)) -> list[Row]:
    """All rows; the time is that of the simulations for one state."""
    return [row for label in labels for described in (True, False) for row in rows(label, described)]


if __name__ == "__main__":
    from benchmarks import table

    print(table(f"severity, {RUNS} specimens, {LISTENERS} microphones each", run(sys.argv[1:] or tuple(PARAMETERS))))
