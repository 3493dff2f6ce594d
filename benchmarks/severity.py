"""How well the size of a fault is told from sound alone: simulated recordings of other specimens and microphones.

`python -m benchmarks severity`, or `python -m benchmarks.severity LABEL`. Every state of operation (motion, payload,
servo) is drawn; what is told of it is what a measurement would tell: speed and payload, and in the rows that say so
the motion and the servo as the axis's description has them.
 Beside it: always saying the middle of the range.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.generation import condition_of
from app.sizing import LISTENERS, Taken, design_for
from benchmarks import Row
from casebase.severity import COVERAGE, PARAMETERS
from casebase.signals.features import Extraction, extract
from casebase.signals.recording import Recording
from sim.audibility import FaultRun
from sim.design import Planned, moved, plan, usual_microphone
from sim.paper import PAPER_AXIS
from sim.sound import SAMPLE_RATE_HZ

STATES, EACH = 4, 10  # states of operation, and recordings of each
DURATION_S = 10.0
SEED = 20_000  # of what is tested; no case that it is held against comes from it


@dataclass(frozen=True, eq=False)
class Test:
    """A recording of known size."""

    size: float
    extraction: Extraction


def tests(label: str, state: int) -> tuple[Planned, list[Test]]:
    """A state of operation, and recordings of fresh specimens in it."""
    planned = plan(PAPER_AXIS, {label: STATES * (EACH + 1)}, SEED, duration_s=DURATION_S)
    chosen, others = planned[state], planned[STATES + state * EACH : STATES + (state + 1) * EACH]
    scenario = chosen.scenario
    found = []
    for number, each in enumerate(others):
        there = moved(each, scenario.axis.motion, scenario.payload_kg_m2)
        servo = replace(there.scenario.axis, servo=scenario.axis.servo)
        random = np.random.default_rng([SEED, state, number])
        heard = FaultRun.of(replace(there.scenario, axis=servo)).heard_by(usual_microphone(random), number)
        performed, sound = heard.scenario.with_head_room(heard.sound)
        assert each.size is not None
        found.append(Test(each.size, extract(Recording(sound, SAMPLE_RATE_HZ), condition_of(performed))))
    return chosen, found


def rows(label: str, described: bool, states: int = STATES, processes: int = 2) -> Iterator[Row]:
    """Median error and coverage of the interval over all states."""
    errors, inside, widths, middle, took = [], [], [], [], 0.0
    for state in range(states):
        chosen, recordings = tests(label, state)
        first = next(each for each in recordings if each.extraction.motion.period_s)
        scenario = chosen.scenario
        started = time.perf_counter()
        axis = replace(scenario.axis, mechanisms=()) if described else PAPER_AXIS
        taken = Taken.of(
            axis,
            first.extraction.motion,
            DURATION_S,
            scenario.axis.motion.load_speed_rad_s,
            scenario.payload_kg_m2,
        )
        design = design_for(axis, label, taken, seed=state, processes=processes)
        took += time.perf_counter() - started
        guess = float(np.exp(np.mean(np.log(design.sizes))))
        for each in recordings:
            found = design.size_of(each.extraction)
            assert found is not None
            errors.append(abs(found.value / each.size - 1))
            middle.append(abs(guess / each.size - 1))
            inside.append(found.low <= each.size <= found.high)
            widths.append(found.high / found.low)
    note = (
        f"median error {np.median(errors):.0%} (always the middle: {np.median(middle):.0%}), interval holds it in "
        f"{np.mean(inside):.0%} (said: {COVERAGE:.0%}), its ends a factor {np.median(widths):.1f} apart"
    )
    known = "motion described" if described else "motion as heard"
    yield Row(f"{label}, {PARAMETERS[label]}, {known}: {len(errors)} recordings", took / states, note=note)


def run(labels: Sequence[str] = tuple(PARAMETERS)) -> list[Row]:
    """All rows; the time is that of the simulations for one recording."""
    return [row for label in labels for described in (False, True) for row in rows(label, described)]


if __name__ == "__main__":
    from benchmarks import table

    print(table(f"severity, {LISTENERS} microphones each", run(sys.argv[1:] or tuple(PARAMETERS))))
