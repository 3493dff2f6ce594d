"""Compile the simulator's inner loops once, at set-up: `python -m sim` runs each engine for a moment."""

import sys

from sim.drive_train import DriveTrain
from sim.measurement import measure
from sim.paper import PAPER_AXIS
from sim.solver import simulate


def main() -> int:
    """Run both engines; what they compile is cached beside the code."""
    simulate(DriveTrain.from_axis(PAPER_AXIS), 0.05, 1000.0)
    measure(PAPER_AXIS, 0.2, seed=0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
