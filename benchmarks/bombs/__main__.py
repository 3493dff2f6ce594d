"""Wrong inputs of every kind through HTTP, and mixed load; prints what became of them and ends with 1 on any fault.

python -m benchmarks.bombs --inputs 100000        as many inputs, and the bombs
python -m benchmarks.bombs --minutes 10           inputs all the while, 120 listeners, 20 clients
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from app.commands.serve import TRIM_EVERY_S
from benchmarks.bombs.campaign import Campaign
from benchmarks.bombs.inputs import Inputs
from benchmarks.harness.live import started
from benchmarks.harness.wire import memory_bytes, settled

MEBIBYTE = 1 << 20


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=6000)
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--listeners", type=int, default=120)
    parser.add_argument("--clients", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        server = started(Path(folder) / "data", worker=bool(asked.minutes))
        campaign = Campaign(server, Inputs(asked.seed))
        once = len(campaign.inputs.kinds) * campaign.batch
        try:
            campaign.run(once)  # what is loaded and compiled once is no growth
            settled(server)
            campaign.tally.live_s.clear()
            campaign.tally.grown_bytes = 0
            if asked.minutes:
                _mixed(campaign, 60.0, asked, once)  # so is what a crowd needs once: threads, what draws spectrograms
                time.sleep(TRIM_EVERY_S)
                settled(server)
                campaign.tally.live_s.clear()
                campaign.tally.seconds.clear()
                before = memory_bytes(server)
                _mixed(campaign, 60.0 * asked.minutes, asked, once)
                time.sleep(TRIM_EVERY_S)  # until what is free has gone back
                settled(server)
                campaign.tally.left_bytes = memory_bytes(server) - before
            else:
                before = memory_bytes(server)
                campaign.run(asked.inputs)
        finally:
            server.stop()
    tally = campaign.tally
    for (kind, status), count in sorted(tally.answers.items()):
        print(f"{kind:12} {status} {count:8}")
    live = sorted(tally.live_s)
    print(f"/livez: {len(live)} looks, 99 % below {live[int(0.99 * (len(live) - 1))]:.3f} s, longest {live[-1]:.3f} s")
    for kind, seconds in sorted(tally.seconds.items()):
        middle, most = np.percentile(seconds, (50, 99))
        print(f"{kind}: {len(seconds)} times, half below {middle:.2f} s, 99 % below {most:.2f} s")
    print(f"memory: {before / MEBIBYTE:.0f} MiB before, {tally.grown_bytes / MEBIBYTE:+.0f} MiB at most,", end=" ")
    print(f"{tally.left_bytes / MEBIBYTE:+.0f} MiB at the end")
    for fault in tally.faults[:20]:
        print("FAULT", fault)
    print(f"{len(tally.faults)} faults")
    return 1 if tally.faults or tally.grown_bytes > 100 * MEBIBYTE else 0


def _mixed(campaign: Campaign, seconds: float, asked: argparse.Namespace, inputs: int) -> None:
    until = time.monotonic() + seconds
    with campaign.crowd(asked.listeners, asked.clients):
        while time.monotonic() < until:
            campaign.run(inputs, alone=False)


if __name__ == "__main__":
    sys.exit(main())
