"""Run the bank of robots through the command line: `python -m benchmarks.robot_bank --count 150 --seed 1`.

Results are kept as lines of JSON in out/robot_bank, one file per state of the product and the generator, so that a run
that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.robot_bank.plan import plan
from benchmarks.robot_bank.product import ROOT
from benchmarks.robot_bank.run import run, state, write
from benchmarks.robot_bank.scenario import KINDS


def main() -> None:
    """Run what is missing and print all tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robot_bank", description=__doc__)
    parser.add_argument("--count", type=int, default=150, help="cases; of every 150 a hundred hide something")
    parser.add_argument("--seed", type=int, default=1, help="of the bank")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=[], help="only these kinds")
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side")
    parser.add_argument("--write", type=Path, help="instead: write the files of the cases and answers.json there")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "robot_bank", help="where results are kept")
    options = parser.parse_args()
    entries = plan(options.count, options.seed, tuple(options.kind))
    if options.write is not None:
        write(entries, options.write)
        return
    run(entries, options.out / f"{state('benchmarks/robot_bank')}.jsonl", options.jobs)


if __name__ == "__main__":
    main()
