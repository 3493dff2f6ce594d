"""A robot axis of three shafts with a notch and play, 30 s: engine, sound, files, batches."""

import multiprocessing
import os
import time
from dataclasses import replace
from functools import partial
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Barrier
from pathlib import Path
from tempfile import TemporaryDirectory

from app.simulation_files import write_sound, write_telemetry
from benchmarks import Row, best_seconds
from sim.description.axis import Axis
from sim.experiment.batch import simulate_many
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
    """Measure single runs, then batches."""
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
    return [*rows, *_written(axis), *_batch(axis)]


def _written(axis: Axis) -> list[Row]:
    """What `gearcase simulate` writes of a run of ten times the length."""
    result = measure(axis, 10 * SECONDS)
    with TemporaryDirectory() as folder:
        calls = {
            name: partial(write_telemetry, result.telemetry, Path(folder) / name)
            for name in ("telemetry.csv", "telemetry.parquet")
        }
        calls["sound.wav"] = partial(write_sound, result.sound, Path(folder) / "sound.wav")
        best = best_seconds(calls, rounds=3)
    return [
        Row(f"300 s written, {name}", seconds, note=f"{10 * SECONDS / seconds:.0f} x real time (target 150)")
        for name, seconds in best.items()
    ]


def _batch(axis: Axis) -> list[Row]:
    """A batch on all cores, beside processes that know nothing of each other: that much the machine itself takes."""
    cores = os.cpu_count() or 1
    alone = _processes(axis, 1)
    together = _processes(axis, cores)
    count = RUNS_PER_CORE * cores
    axes = [replace(axis, load=replace(axis.load, inertia_kg_m2=20.0 + i)) for i in range(count)]
    each = min(_seconds_of_batch(axes) for _ in range(ROUNDS)) * cores / count
    return [
        Row(
            f"{cores} processes at once, per run", together, together / alone, "one process", "the machine's own share"
        ),
        Row(f"batch of {count} on {cores} cores, per run and core", each, each / alone, "one process", "target 1.2"),
        Row("  the same", each, each / together, f"{cores} processes at once", "our own share"),
    ]


def _seconds_of_batch(axes: list[Axis]) -> float:
    start = time.perf_counter()
    for _ in simulate_many(axes, SECONDS):
        pass
    return time.perf_counter() - start


def _processes(axis: Axis, count: int) -> float:
    """Seconds per run in each of `count` processes that begin together, best of some rounds."""
    context = multiprocessing.get_context("spawn")
    barrier, times = context.Barrier(count), context.SimpleQueue()
    processes = [context.Process(target=_runs, args=(axis, barrier, times)) for _ in range(count)]
    for process in processes:
        process.start()
    taken = [times.get() for _ in processes]
    for process in processes:
        process.join()
    return min(map(max, zip(*taken, strict=True)))


def _runs(axis: Axis, barrier: Barrier, times: "SimpleQueue[list[float]]") -> None:
    measure(axis, SECONDS)
    taken = []
    for _ in range(ROUNDS):
        barrier.wait()
        start = time.perf_counter()
        for _ in range(RUNS_PER_CORE):
            measure(axis, SECONDS)
        taken.append((time.perf_counter() - start) / RUNS_PER_CORE)
    times.put(taken)
