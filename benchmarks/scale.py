"""A library of a million cases opened from its file; the first diagnosis of one of a hundred thousand after a start."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import Row, best_seconds
from casebase.__main__ import search_once
from casebase.library import CaseLibrary
from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.priors import prior_weights
from casebase.search.case_table import CaseTable
from casebase.search.retrieval import CaseMatrix, metric_of
from casebase.search.stored_table import name_table, read_table, write_table
from casebase.store.database import create_engine_for, sqlite_url, upgrade_database
from signals.features import EXTRACTOR_VERSION, catalogue

FIRST, LARGEST = 100_000, 1_000_000
NEAREST = 10
LABELS = np.array(["normal", "notch", "play"])


def made_table(count: int) -> CaseTable:
    """Return measured and simulated cases of three classes and 200 gearboxes, each of a sound of its own."""
    generator = np.random.default_rng(count)
    names = tuple(catalogue())
    kind = generator.integers(0, 3, count)
    values = generator.standard_normal((count, len(names)), np.float32)
    values += generator.standard_normal((3, len(names)), np.float32)[kind]
    ids = np.array([f"{row:032x}" for row in range(count)])
    sounds = np.char.add(ids, ids)
    origins = np.where(generator.random(count) < 0.5, "simulated", "measured")
    boxes = np.char.add("g", generator.integers(0, 200, count).astype(np.str_))
    axes = np.full(count, "axis")
    return CaseTable(0, EXTRACTOR_VERSION, names, ids, LABELS[kind], origins, axes, boxes, sounds, values)


def kept(folder: Path, count: int) -> None:
    """Make a library whose table of so many cases lies in a file; the rows behind them are not made."""
    engine = create_engine_for(sqlite_url(folder / "gearcase.db"))
    upgrade_database(engine)
    library = CaseLibrary(engine, folder)
    document = write_table(folder / "tables", made_table(count))
    with library.transaction("benchmark") as session:
        name_table(session, EXTRACTOR_VERSION, document)
    library.close()


def peak_bytes() -> int:
    """Return the most memory that this process has had, mapped pages included; `ru_maxrss` is the parent's too."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:"))


def measured(folder: Path) -> dict[str, float]:
    """Open, search, and diagnose, in this process, which has done nothing yet."""
    library = CaseLibrary(create_engine_for(sqlite_url(folder / "gearcase.db")), folder)
    search_once()  # as a start of the service does
    before, used = time.perf_counter(), time.process_time()
    with library.reading() as session:
        table = read_table(session, folder / "tables", EXTRACTOR_VERSION)
    assert table is not None
    matrix = CaseMatrix(table, metric_of(table.take(np.arange(1000)), prior_weights(table.names)))
    opened, opened_cpu = time.perf_counter() - before, time.process_time() - used
    peak = peak_bytes()
    query = np.random.default_rng(1).normal(size=len(table.names))
    bare = table.values.copy()
    calls = {"search": lambda: matrix.search(query, NEAREST), "bare": lambda: bare @ query.astype(np.float32)}
    best = best_seconds(calls, rounds=20)
    found = {"cases": len(table), "open_s": opened, "open_cpu_s": opened_cpu, "peak_bytes": peak, **best}
    if len(table) <= FIRST:
        del matrix
        before, used = time.perf_counter(), time.process_time()
        with library.reading() as session:
            again = read_table(session, folder / "tables", EXTRACTOR_VERSION)
        assert again is not None
        Reasoner(again).judge(query)
        found["first_s"], found["first_cpu_s"] = time.perf_counter() - before, time.process_time() - used
    library.close()
    return found


def run() -> list[Row]:
    """Measure both sizes, each in a process of its own."""
    rows = []
    for count in (FIRST, LARGEST):
        with tempfile.TemporaryDirectory() as name:
            kept(Path(name), count)
            command = [sys.executable, "-m", "benchmarks.scale", name]
            found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        note = f"{found['open_cpu_s']:.2f} s of CPU; {found['peak_bytes'] / 2**20:.0f} MiB at most, all told"
        rows.append(Row(f"{count} cases: open", found["open_s"], note=note))
        ratio = found["search"] / found["bare"]
        rows.append(Row(f"{count} cases: ten nearest", found["search"], ratio, "bare product"))
        if "first_s" in found:
            rows.append(
                Row(
                    f"{count} cases: first diagnosis after a start",
                    found["first_s"],
                    note=f"{found['first_cpu_s']:.2f} s of CPU",
                )
            )
    return rows


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measured(Path(sys.argv[1]))))
    else:
        from benchmarks import table

        print(table(__doc__, run()))
