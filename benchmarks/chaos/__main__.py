"""`python -m benchmarks.chaos crash-points | kills | machines`: says what was tried; 1 if it went wrong.

Everything is bounded by `--minutes`, and goes no further than the loopback of this machine and network namespaces of
its own.
"""

import argparse
import json
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path


def crash_points(chosen: argparse.Namespace) -> list[str]:
    from benchmarks.chaos.crash_points import ALL, run

    wrong: list[str] = []
    for database in chosen.database:
        started = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="gearcase-chaos-") as folder:
            found = run(
                Path(folder),
                database,
                chosen.only or ALL,
                most=chosen.most,
                seconds=60 * chosen.minutes / len(chosen.database),
                seed=chosen.seed,
            )
        for name, tally in found.items():
            print(f"{database:<11} {name:<45} {tally.points:>4} of {tally.of:>4} points, {len(tally.wrong)} wrong")
            wrong += [f"{database}: {each}" for each in tally.wrong]
        print(
            f"{database:<11} {sum(each.points for each in found.values())} points in {time.monotonic() - started:.0f} s"
        )
    return wrong


def kills(chosen: argparse.Namespace) -> list[str]:
    from benchmarks.chaos.kills import run
    from benchmarks.harness import postgres

    wrong: list[str] = []
    for database in chosen.database:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gearcase-chaos-")))
            url = None if database == "sqlite" else stack.enter_context(postgres.running_server())
            seconds = 60 * chosen.minutes / len(chosen.database)
            words, found = run(folder, url, kills=chosen.kills, seconds=seconds, seed=chosen.seed)
        print(f"{database:<11} {words}; {len(found)} wrong")
        wrong += [f"{database}: {each}" for each in found]
    return wrong


def machines(chosen: argparse.Namespace) -> list[str]:
    from benchmarks.chaos.machines import NoNamespacesError, run

    with tempfile.TemporaryDirectory(prefix="gearcase-chaos-") as folder:
        try:
            words, wrong = run(Path(folder), cases=chosen.cases, duration_s=chosen.duration_s, lease_s=chosen.lease_s)
        except NoNamespacesError as error:
            print(f"skipped: {error}")
            return []
    for each in words:
        print(each)
    return wrong


def main() -> None:
    """Run a part and say what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parts = parser.add_subparsers(dest="part", required=True)
    points = parts.add_parser("crash-points", help="kill -9 at every write of every POST")
    points.add_argument("--only", nargs="+", metavar="ORDER", help="orders, as they are printed")
    points.add_argument("--most", type=int, default=400, help="points of an order, drawn where there are more")
    points.set_defaults(run=crash_points)
    killing = parts.add_parser("kills", help="kill -9 at random while clients order")
    killing.add_argument("--kills", type=int, default=100, help="on each database, if there is time")
    killing.set_defaults(run=kills)
    apart = parts.add_parser("machines", help="two network namespaces, one cut off, one killed")
    apart.add_argument("--cases", type=int, default=1000)
    apart.add_argument("--duration-s", type=float, default=10.0, help="of each simulated recording [s]")
    apart.add_argument("--lease-s", type=float, default=15.0)
    apart.set_defaults(run=machines)
    for part in (points, killing, apart):
        part.add_argument("--database", nargs="+", choices=("sqlite", "postgresql"), default=["sqlite", "postgresql"])
        part.add_argument("--minutes", type=float, default=20.0)
        part.add_argument("--seed", type=int, default=0)
        part.add_argument("--json", action="store_true", help="what was wrong as JSON")
    chosen = parser.parse_args()
    wrong = chosen.run(chosen)
    if chosen.json:
        json.dump(wrong, sys.stdout)
    for each in wrong:
        print(f"WRONG  {each}", file=sys.stderr)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
