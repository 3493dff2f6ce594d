"""Benchmarks: each module has `run()`, which returns rows.

Folders are banks, which have frozen seeds and commands of their own: `python -m benchmarks.hidden_effects`.
"""

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

# before numpy, which takes as many threads as it is told when it is loaded; as in `app`, which banks do not import
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@dataclass(frozen=True)
class Row:
    """One line of a benchmark's table.

    Args:
        name: what was measured.
        seconds: best time of one call [s].
        ratio: time over the time of the reference named in `against` [1].
        against: the reference.
        note: target or remark.
    """

    name: str
    seconds: float
    ratio: float | None = None
    against: str = ""
    note: str = ""


def best_seconds(calls: Mapping[str, Callable[[], object]], rounds: int = 15) -> dict[str, float]:
    """Return the best time of each call [s]; they take turns, so that other load on the machine meets all alike."""
    best = dict.fromkeys(calls, float("inf"))
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def table(title: str, rows: list[Row]) -> str:
    """Return rows as lines of text."""
    lines = [title]
    for row in rows:
        ratio = f"{row.ratio:8.2f} x {row.against}" if row.ratio is not None else ""
        lines.append(f"  {row.name:<58} {1000 * row.seconds:10.3f} ms {ratio}  {row.note}".rstrip())
    return "\n".join(lines)
