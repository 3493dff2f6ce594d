"""Compile the simulator's inner loops once, at set-up: `python -m sim` runs each engine for a moment."""

import sys
from dataclasses import replace

from sim.assembly import drive_train_of
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.virtual_measurement import measure
from sim.investigation.data.validation import examine
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import Noise
from sim.solver import simulate


def main() -> int:
    """Run all engines, that of investigations for one and two stages; what they compile is cached beside the code."""
    train = drive_train_of(PAPER_AXIS)
    simulate(train, 0.05, 1000.0)
    for stages in (PAPER_AXIS.stages[-1:], PAPER_AXIS.stages):
        axis = replace(PAPER_AXIS, stages=stages)
        seen = examine(axis, measure(axis, 2.0, seed=0).telemetry).measurement
        Problem(axis, seen, Noise.flat(1.0, 1.0)).fit(iterations=0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
