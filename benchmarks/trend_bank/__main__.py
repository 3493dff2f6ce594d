"""Ask the product when it tells of a change: `python -m benchmarks.trend_bank --worn 12 --good 25`."""

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks.trend_bank.lives import CHANGED_FROM, EXCHANGED, MOVED, RECORDINGS
from benchmarks.trend_bank.product import alarm, asked, evidence, lived
from casebase.reasoning.trend import RECORDINGS_PER_FALSE_ALARM

FAULTS, GOOD, CHANGES = (("notch", 0), ("play", 100)), 200, ((EXCHANGED, 300), (MOVED, 400))
"""Seeds from that of the command on."""


def main() -> None:
    """Make the lives, play them, print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.trend_bank", description=__doc__)
    parser.add_argument("--worn", type=int, default=12, help="gearboxes of each fault, which grows over 40 recordings")
    parser.add_argument("--good", type=int, default=25, help="gearboxes without a fault, 40 recordings each")
    parser.add_argument("--changed", type=int, default=12, help="good ones exchanged, and as many heard from elsewhere")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "gearcase-trend-bank")
    given = parser.parse_args()
    first = given.seed
    wanted = [*((label, first + apart + k) for label, apart in FAULTS for k in range(given.worn))]
    good = [("normal", first + GOOD + k) for k in range(given.good)]
    changes = {label: [(label, first + apart + k) for k in range(given.changed)] for label, apart in CHANGES}
    with ProcessPoolExecutor(given.jobs) as pool:
        every = [*wanted, *good, *(one for some in changes.values() for one in some)]
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
    questions = sum(asked(each) is not None for each in lives)
    print(f"asked what changed at once: {questions} of {len(lives)} good gearboxes; promised: as above, beside it")
    early = [asked(lived(label, seed, given.cache)) for label, seed in wanted]
    print(f"asked what changed at once while a fault grew: {sum(each is not None for each in early)} of {len(early)}")
    for label, some in changes.items():
        found = [lived(*one, given.cache) for one in some]
        told = [each for one in found if (each := asked(one)) is not None and each[0] >= CHANGED_FROM]
        near = sum(abs(began - CHANGED_FROM) <= 2 for _, began in told)
        later = [number - CHANGED_FROM + 1 for number, _ in told]
        risen = sum(alarm(evidence(one)) is not None for one in found)
        print(f"{label}: asked {len(told)} of {len(found)}, the place within 2 recordings {near}", end="")
        print(f", after recordings: {sorted(later)}; told as a change of impacts {risen}")


def make(one: tuple[str, int], cache: Path) -> None:
    """Make one life in a process of its own."""
    lived(*one, cache)


if __name__ == "__main__":
    main()
