"""Run the bank of robots through the command line: `python -m benchmarks.robot_bank --count 150 --seed 1`.

Results are kept as lines of JSON in out/robot_bank, one file per state of the product and the generator, so that a run
that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse

from benchmarks.robot_bank.plan import plan
from benchmarks.robot_bank.product import ROOT, takes_robots
from benchmarks.robot_bank.run import options as add_options
from benchmarks.robot_bank.run import run, state, write
from benchmarks.robot_bank.scenario import KINDS


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robot_bank", description=__doc__)
    add_options(parser, KINDS, ROOT / "out" / "robot_bank")
    options = parser.parse_args()
    if options.write is None and not takes_robots():
        parser.error("`gearcase investigate` has no option --robot")
    return options


def main() -> None:
    """Run what is missing and print all tables."""
    options = _arguments()
    entries = plan(options.count, options.seed, tuple(options.kind))
    if options.write is not None:
        write(entries, options.write)
        return
    run(entries, options.out / f"{state('benchmarks/robot_bank')}.jsonl", options.jobs)


if __name__ == "__main__":
    main()
