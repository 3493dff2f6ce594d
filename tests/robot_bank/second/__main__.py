"""Run the second bank of robots through the command line: `python -m tests.robot_bank.second --count 60 --seed 5`."""

from __future__ import annotations

import argparse

from tests.robot_bank.product import ROOT, takes_robots
from tests.robot_bank.run import options as add_options
from tests.robot_bank.run import run, state, write
from tests.robot_bank.second.cases import KINDS
from tests.robot_bank.second.plan import plan


def main() -> None:
    """Run what is missing and print all tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.robot_bank.second", description=__doc__)
    add_options(parser, KINDS, ROOT / "out" / "robot_bank_second")
    options = parser.parse_args()
    cases = plan(options.count, options.seed, tuple(options.kind))
    if options.write is not None:
        write(cases, options.write)
        return
    if not takes_robots():
        parser.error("`gearcase investigate` has no option --robot")
    run(cases, options.out / f"{state('tests/robot_bank')}.jsonl", options.jobs)


if __name__ == "__main__":
    main()
