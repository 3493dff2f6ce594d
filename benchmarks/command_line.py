"""`gearcase simulate` as processes of their own, telemetry as CSV and sound as WAV: their start and their speed."""

import subprocess
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import Row, best_seconds
from benchmarks.axis_simulation import faulty_axis
from sim.description.axis_document import write_axis

MOMENT, LENGTHS = "0.01", ("30", "300", "1500")
"""How long the runs are [s]; the first is over at once and tells what starting takes."""
ROUNDS = 5


def run() -> list[Row]:
    """Measure help, the shortest run, and longer ones with and without what starting takes."""
    with TemporaryDirectory() as folder:
        axis = Path(folder) / "axis.toml"
        axis.write_text(write_axis(faulty_axis()), encoding="utf-8")
        words = [sys.executable, "-m", "app", "simulate", "--axis", str(axis), "--out", folder]
        lines = {"--help": ["--help"], **{f"{length} s": ["--duration", length] for length in (MOMENT, *LENGTHS)}}
        calls = {
            name: partial(subprocess.run, [*words, *more], check=True, capture_output=True)
            for name, more in lines.items()
        }
        best = best_seconds(calls, ROUNDS)
    start = best[f"{MOMENT} s"]
    return [
        Row("gearcase simulate --help", best["--help"]),
        Row("a run that is over at once", start, note="start-up (target 400 ms)"),
        *(_row(length, best[f"{length} s"], start) for length in LENGTHS),
    ]


def _row(length: str, seconds: float, start: float) -> Row:
    speed, running = float(length) / seconds, float(length) / (seconds - start)
    return Row(
        f"{length} s, CSV and WAV written",
        seconds,
        note=f"{speed:.0f} simulated seconds per second, {running:.0f} once it is started (target 300)",
    )
