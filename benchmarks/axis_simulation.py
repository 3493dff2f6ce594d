"""A robot axis of three shafts with a notch and play, 30 s: engine, sound, files, batches."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import soundfile

from app.commands.simulate import SOUND_RATE_HZ, write_telemetry
from benchmarks import Row, best_seconds
from sim.description.axis import Axis
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.virtual_measurement import built, measure
from sim.mechanisms import Backlash, ToothDamage
from sim.mechanisms.catalogue import with_mechanism
from sim.solver import simulate

SECONDS, RATE_HZ, TELEMETRY_HZ = 30.0, 8000.0, 2000.0
RUNS_PER_CORE, ROUNDS = 4, 3


def faulty_axis() -> Axis:
    """The paper's axis with both of its faults at the output gear."""
    with_play = with_mechanism(PAPER_AXIS, Backlash("output", {"gap_rad": 1e-3}))
    return with_mechanism(with_play, ToothDamage("output", {"angle_rad": 1.1, "depth_rad": 1e-3}))


def run() -> list[Row]:
    """Measure single runs."""
    axis = faulty_axis()
    train = built(axis)
    calls = {
        "mechanisms and sound, 8 kHz": partial(measure, axis, SECONDS),
        "mechanisms alone, 8 kHz": partial(simulate, train, SECONDS, RATE_HZ),
        "a tenth of the time": partial(measure, axis, SECONDS / 10),
    }
    for call in calls.values():
        call()
    best = best_seconds(calls, rounds=7)
    whole = best["mechanisms and sound, 8 kHz"]
    rows = [
        Row(name, seconds, note=f"{length / seconds:.0f} x real time{goal}")
        for (name, seconds), length, goal in zip(
            best.items(),
            (SECONDS, SECONDS, SECONDS / 10),
            (" (target 500)", "", ""),
            strict=True,
        )
    ]
    rows[2] = replace(
        rows[2], ratio=10 * best["a tenth of the time"] / whole, against="a tenth of 30 s (cost is linear)"
    )
    return [*rows, *_written(axis)]


def _written(axis: Axis) -> list[Row]:
    """What `gearcase simulate` writes of a run of ten times the length."""
    result = measure(axis, 10 * SECONDS)
    with TemporaryDirectory() as folder:
        calls = {
            name: partial(write_telemetry, result.telemetry, Path(folder) / name)
            for name in ("telemetry.csv", "telemetry.parquet")
        }
        calls["sound.wav"] = partial(
            soundfile.write, Path(folder) / "sound.wav", result.sound, SOUND_RATE_HZ, subtype="PCM_16"
        )
        best = best_seconds(calls, rounds=3)
    return [
        Row(f"300 s written, {name}", seconds, note=f"{10 * SECONDS / seconds:.0f} x real time (target 150)")
        for name, seconds in best.items()
    ]
