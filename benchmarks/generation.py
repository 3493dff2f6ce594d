"""A campaign of generated cases over durable jobs: `python -m benchmarks.generation [CASES] [--postgres]`.

Prints the share of the worker's processor time, its start and its waiting included, that is simulation and features (as
the tasks themselves measure it), the speed of two workers over one beside that of two processes that do nothing else
(what this machine has to give), and whether every case is there once after one of two workers was killed in the middle.
With --only, only some of these.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from sqlalchemy import func, select

from app.jobs.jobs import open_jobs
from app.settings import Settings
from app.simulated.generation import KIND, Campaign, simulate_case
from casebase.library import CaseLibrary
from casebase.store.models import Case
from sim.experiment.design_of_experiments import Planned
from sim.experiment.paper_axis import PAPER_AXIS

SAMPLE = 12  # cases timed alone, to know what simulation and features cost


def campaign(cases: int) -> Campaign:
    """Cases of 10 s, a third of each label."""
    third = cases // 3
    return Campaign(PAPER_AXIS, {"normal": cases - 2 * third, "play": third, "notch": third}, seed=7, duration_s=10.0)


def cost_per_case(planned: Sequence[Planned]) -> float:
    """Processor time of simulation and features of a case on one core without anything else [s]."""
    simulate_case(planned[0])
    started = time.process_time()
    for each in planned:
        simulate_case(each)
    return (time.process_time() - started) / len(planned)


def company(planned: Sequence[Planned]) -> float:
    """How many times faster two processes simulate than one: near 2 where nobody else uses the machine."""
    took = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(cost_per_case, [planned[:1]] * 2))
        for count in (1, 2):
            started = time.perf_counter()
            list(pool.map(cost_per_case, [planned] * count))
            took.append(time.perf_counter() - started)
    return 2 * took[0] / took[1]


def processor_time() -> float:
    """What processes that this one started, and that have ended, took of the processor [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@contextmanager
def workers(settings: Settings, count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Worker processes of an installation."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    if settings.database_url:
        environment["GEARCASE_DATABASE_URL"] = settings.database_url
    command = [sys.executable, "-m", "app", "--data-dir", str(settings.data_dir), "worker"]
    running = [subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) for _ in range(count)]
    try:
        yield running
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait()


@dataclass(frozen=True)
class Done:
    """A campaign that is done: time from the first finished task to the end, for all tasks [s], what simulation and
    features took of the processor [s], and what all took, the workers' start included [s]."""

    wall_s: float
    simulation_s: float
    processor_s: float

    def words(self, cases: int) -> str:
        """In one line."""
        share = self.simulation_s / self.processor_s
        return (
            f"{cases} cases in {self.wall_s:.1f} s, {share:.0%} of the workers' {self.processor_s:.1f} processor s "
            f"simulation and features, {1e3 * self.simulation_s / cases:.0f} ms a case"
        )


def run(settings: Settings, wanted: Campaign, count: int, *, kill: bool = False) -> Done:
    """Generate a campaign with so many workers; every case is checked to be there once."""
    before = processor_time()
    library = CaseLibrary.open(settings.data_dir, settings.database_url)
    with open_jobs(settings) as jobs, workers(settings, count) as running:
        job = jobs.submit(KIND, wanted.to_document())
        started, first = 0.0, 0
        for event in jobs.events(job):
            if event.progress.done and not started:
                started, first = time.perf_counter(), event.progress.done
            if kill and event.progress.fraction > 0.4:
                kill = False
                running[0].kill()
                running[0].wait()
                with workers(settings, 1) as heirs:
                    running.extend(heirs)
                    for _ in jobs.events(job, after=event.number):
                        pass
        took, total = time.perf_counter() - started, len(wanted.batches())
        ended = jobs.get(job)
    with library.reading() as session:
        there, different = session.execute(select(func.count(), func.count(Case.key.distinct()))).one()
    library.close()
    expected = sum(wanted.counts.values())
    if (ended.state, there, different) != ("done", expected, expected):
        raise SystemExit(f"{ended.state}: {there} cases, {different} different, {expected} expected: {ended.error}")
    assert isinstance(ended.result, dict)
    simulated = float(str(ended.result["simulation_s"]))
    return Done(took * total / max(total - first, 1), simulated, processor_time() - before)


PARTS = ("share", "two", "killed", "postgres")


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=int, nargs="?", default=1000)
    parser.add_argument("--postgres", action="store_true", help="two workers on PostgreSQL, one killed, as well")
    parser.add_argument("--only", choices=PARTS, nargs="+", help="parts to run")
    chosen = parser.parse_args()
    parts = chosen.only or (PARTS if chosen.postgres else PARTS[:-1])
    wanted = campaign(chosen.cases)
    one: Done | None = None
    if {"share", "two"} & set(parts):
        with tempfile.TemporaryDirectory() as folder:
            one = run(Settings(data_dir=Path(folder)), wanted, 1)
        print(f"one worker: {one.words(chosen.cases)}", flush=True)
    if "two" in parts and one:
        planned = wanted.planned()
        alone = company(planned[:: max(1, len(planned) // SAMPLE)])
        print(f"two processes that only simulate: {alone:.2f} times one", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            two = run(Settings(data_dir=Path(folder)), wanted, 2)
        ratio = one.wall_s / two.wall_s
        print(f"two workers: {two.words(chosen.cases)}", flush=True)
        print(
            f"two workers are {ratio:.2f} times one, {ratio / alone:.0%} of what two bare processes reach", flush=True
        )
    if "killed" in parts:
        with tempfile.TemporaryDirectory() as folder:
            killed = run(Settings(data_dir=Path(folder)), wanted, 2, kill=True)
        print(f"two workers, one killed: {killed.words(chosen.cases)}, none twice", flush=True)
    if "postgres" in parts:
        from benchmarks.harness import postgres

        with postgres.running_server() as url, tempfile.TemporaryDirectory() as folder:
            database = postgres.create_database(url, "gearcase_generation")
            killed = run(Settings(data_dir=Path(folder), database_url=database), wanted, 2, kill=True)
        print(f"two workers on PostgreSQL, one killed: {killed.words(chosen.cases)}, none twice")


if __name__ == "__main__":
    main()
