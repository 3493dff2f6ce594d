"""Spoilt sound files, many of them, through the decoder: read or refused, never a crash of the one who asked.

python -m benchmarks.fuzz_decode --files 100000
"""

import argparse
import random
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.encoded_sounds import seeds
from signals.errors import BrokenAudioError, DecoderUnavailableError, SignalError
from signals.reading.decode import LIMITS, read_recording
from signals.reading.limited_pool import SOUNDS

SIZES = (0, 1, 2, 7, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFF0, 0xFFFFFFFE, 0xFFFFFFFF)
GIVEN_UP = "given up"


@dataclass
class Tally:
    """What became of the files: kind of seed and outcome -> count; the largest time [s] and memory [byte] of one."""

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    longest_s: float = 0.0
    largest_bytes: int = 0

    def of(self, outcome: str) -> int:
        return sum(count for (_, each), count in self.outcomes.items() if each == outcome)


def spoilt(content: bytes, others: Sequence[bytes], dice: random.Random) -> bytes:
    """Return the content of a file with one to three things wrong."""
    spoilt = bytearray(content)
    for _ in range(dice.randint(1, 3)):
        kind = dice.randrange(6)
        at = dice.randrange(len(spoilt)) if dice.random() < 0.5 else dice.randrange(min(len(spoilt), 128))
        if kind == 0:
            for _ in range(dice.randint(1, 20)):
                spoilt[dice.randrange(len(spoilt))] = dice.randrange(256)
        elif kind == 1:
            spoilt[at : at + 8] = dice.randbytes(dice.randint(1, 8))
        elif kind == 2:
            del spoilt[max(1, at) :]
        elif kind == 3:
            order = dice.choice("<>")
            spoilt[at : at + 4] = struct.pack(order + "I", dice.choice(SIZES))
        elif kind == 4:
            other = dice.choice(others)
            spoilt[at:] = other[dice.randrange(len(other)) :]
        else:
            spoilt[at : at + dice.randint(0, 64)] = dice.randbytes(dice.randint(0, 64))
        if not spoilt:
            return b"\0"
    return bytes(spoilt)


def fuzz(files: int, seed: int, folder: Path, *, show: int = 0) -> Tally:
    """Decode so many spoilt files and count what became of them.

    The last file lies in the folder as `spoilt`, those on which the decoder gave up as `given-up-SEED-NUMBER`.

    Raises:
        AssertionError: if samples are read that are not finite, or a good file is not read after all that.
        Exception: anything but a SignalError that the decoder raised.
    """
    dice = random.Random(seed)
    good = seeds(folder)
    names, contents = list(good), list(good.values())
    path, tally = folder / "spoilt", Tally()
    for number in range(files):
        name = dice.choice(names)
        path.write_bytes(spoilt(good[name], contents, dice))
        began = time.monotonic()
        try:
            assert np.isfinite(read_recording(path).samples).all()
            outcome = "read"
        except DecoderUnavailableError:
            raise
        except SignalError as error:
            outcome = type(error).__name__
            if isinstance(error, BrokenAudioError) and "gave up" in str(error):
                outcome = GIVEN_UP
                (folder / f"given-up-{seed}-{number}").write_bytes(path.read_bytes())
                if show:
                    print(f"{name}: {error}", file=sys.stderr)
        tally.outcomes[name, outcome] += 1
        tally.longest_s = max(tally.longest_s, time.monotonic() - began)
        if number % 100 == 0:
            tally.largest_bytes = max(tally.largest_bytes, peak_bytes())
        if show and number % show == show - 1:
            print(number + 1, "files", file=sys.stderr)
    path.write_bytes(good["wav pcm_16"])
    assert read_recording(path).samples.size > 0
    return tally


def peak_bytes() -> int:
    """The most memory that the decoder's process had so far [byte]; 0 where there is no /proc."""
    with SOUNDS.worker() as worker:
        status = Path(f"/proc/{worker.process.pid}/status")
        if not status.exists():
            return 0
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024


def main() -> None:
    """Fuzz and print a table; ends with 1 if a file took more time or memory than the limits allow."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="keeps the files on which the decoder gave up")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tally = fuzz(asked.files, asked.seed, asked.folder or Path(folder), show=5000)
    outcomes = sorted({outcome for _, outcome in tally.outcomes})
    print(f"{'seed':20}", *(f"{outcome[:20]:>20}" for outcome in outcomes))
    for name in sorted({name for name, _ in tally.outcomes}):
        print(f"{name:20}", *(f"{tally.outcomes[name, outcome]:>20}" for outcome in outcomes))
    print(f"{'all':20}", *(f"{tally.of(outcome):>20}" for outcome in outcomes))
    print(f"longest {tally.longest_s:.2f} s of {LIMITS.seconds:g}, ", end="")
    print(f"most memory of the worker {tally.largest_bytes >> 20} MiB of {LIMITS.memory_bytes >> 20}")
    within = tally.longest_s < LIMITS.seconds + 5 and tally.largest_bytes <= LIMITS.memory_bytes
    sys.exit(0 if within else 1)


if __name__ == "__main__":
    main()
