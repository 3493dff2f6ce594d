"""Ask the product when it tells of a change: `python -m tests.trend_bank --worn 12 --good 25`."""

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np

from casebase.trend import RECORDINGS_PER_FALSE_ALARM
from tests.trend_bank.lives import RECORDINGS
from tests.trend_bank.product import alarm, evidence, joined, lived

FAULTS, GOOD = (("notch", 0), ("play", 100)), 200
"""Seeds from that of the command on."""


def main() -> None:
    """Make the lives, play them, print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.trend_bank", description=__doc__)
    parser.add_argument("--worn", type=int, default=12, help="gearboxes of each fault, which grows over 40 recordings")
    parser.add_argument("--good", type=int, default=25, help="gearboxes without a fault, 40 recordings each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "gearcase-trend-bank")
    given = parser.parse_args()
    first = given.seed
    wanted = [*((label, first + apart + k) for label, apart in FAULTS for k in range(given.worn))]
    good = [("normal", first + GOOD + k) for k in range(given.good)]
    with ProcessPoolExecutor(given.jobs) as pool:
        every = [*wanted, *good]
        for number, _ in enumerate(pool.map(make, every, [given.cache] * len(every))):
            print(f"{number + 1} of {len(every)} gearboxes", file=sys.stderr)
    print("fault  gearbox  heard from [mrad]  alarm at [mrad]  alarm over heard")
    over = []
    for label, seed in wanted:
        life = lived(label, seed, given.cache)
        told = alarm(evidence(life))
        size = np.nan if told is None else life.size_rad[told]
        over.append(size / life.heard_from_rad)
        print(f"{label:<6} {seed:>7} {1e3 * life.heard_from_rad:>18.2f} {1e3 * size:>16.2f} {over[-1]:>17.2f}")
    before = sum(ratio < 2 for ratio in over)
    print(f"alarm before twice the size from which it is heard at all: {before} of {len(over)}")
    lives = [lived(label, seed, given.cache) for label, seed in good]
    alarms = sum(alarm(evidence(life)) is not None for life in lives)
    print(f"false alarms: {alarms} of {len(lives)} good gearboxes, {RECORDINGS * len(lives)} recordings", end="")
    print(f"; promised: one in {RECORDINGS_PER_FALSE_ALARM} recordings at most")
    swaps = [alarm(evidence(joined(one, other))) for one, other in pairwise(lives)]
    noticed = [told - RECORDINGS for told in swaps if told is not None and told >= RECORDINGS]
    print(f"an exchange of a good gearbox that nobody noted, told as a change: {len(noticed)} of {len(swaps)}")


def make(one: tuple[str, int], cache: Path) -> None:
    """Make one life in a process of its own."""
    lived(*one, cache)


if __name__ == "__main__":
    main()
