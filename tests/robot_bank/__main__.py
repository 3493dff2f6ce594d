"""Run the bank of robots through the command line: `python -m tests.robot_bank --count 150 --seed 1`.

Results are kept as lines of JSON in out/robot_bank, one file per state of the product and the generator, so that a run
that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from tests.robot_bank import wrong_input
from tests.robot_bank.plan import plan
from tests.robot_bank.product import ROOT, investigate, takes_robots
from tests.robot_bank.run import options as add_options
from tests.robot_bank.run import run, state, write
from tests.robot_bank.scenario import KINDS


def _wrong_inputs(seed: int) -> None:
    """Print for each wrong input whether the answer was clear."""
    clear = 0
    scenario = wrong_input.base(seed)
    for case in wrong_input.CASES:
        with tempfile.TemporaryDirectory() as name:
            mentions = case.spoil(scenario, Path(name))
            verdict = wrong_input.judge(case, mentions, investigate(Path(name)))
        clear += verdict.clear
        print(f"{'clear' if verdict.clear else 'LACKING':8s} {case.name}", flush=True)
        for lack in verdict.lacking:
            print(f"           wanted: {lack}")
        if not verdict.clear:
            print(f"           said: {verdict.words}")
    print(f"{clear} of {len(wrong_input.CASES)} answers are clear")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.robot_bank", description=__doc__)
    add_options(parser, KINDS, ROOT / "out" / "robot_bank")
    parser.add_argument("--wrong-input", action="store_true", help="instead: descriptions that do not fit their log")
    options = parser.parse_args()
    if options.write is None and not takes_robots():
        parser.error("`gearcase investigate` has no option --robot")
    return options


def main() -> None:
    """Run what is missing and print all tables."""
    options = _arguments()
    if options.wrong_input:
        _wrong_inputs(options.seed)
        return
    entries = plan(options.count, options.seed, tuple(options.kind))
    if options.write is not None:
        write(entries, options.write)
        return
    run(entries, options.out / f"{state('tests/robot_bank')}.jsonl", options.jobs)


if __name__ == "__main__":
    main()
