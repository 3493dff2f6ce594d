"""What simulated cases are worth on measured recordings: `python -m benchmarks.measured_help [FOLDER] [CASES]`.

FOLDER holds axis.toml, manifest.csv (file, label, gearbox, payload_kg_m2, speed_rad_s) and the recordings. One
gearbox at a time is held out; no simulated case has heard anything of it, and none has heard a fault. The learning
curve, over how many measured cases of each class the library has, is drawn into docs/figures.
"""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.recordings.intake import condition_on
from app.simulated.generation import simulate_case
from benchmarks import Row
from benchmarks.shared_data import SHARED
from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.evaluation import Proportion
from casebase.search.case_table import CaseTable
from signals.features import EXTRACTOR_VERSION, catalogue, extract
from signals.reading.decode import read_recording
from sim.acoustics.transfer_path_fit import NormalRecording, fit_sound
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import LABELS, Planned, plan

FIGURE = Path("docs/figures/measured_help.png")
CASES, DURATION_S = 40, 15.0  # simulated cases of each label, and how long each is
EACH = (1, 2, 3, 5)  # measured cases of each class in the learning curve
DRAWS = 3  # of which measured cases the library has, in the learning curve


@dataclass(frozen=True, eq=False)
class Vectors:
    """Features, shape (cases, n), with label, gearbox and origin of each."""

    values: NDArray[np.float32]
    labels: NDArray[np.str_]
    gearboxes: NDArray[np.str_]
    origin: str

    def take(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Vectors:
        return Vectors(self.values[rows], self.labels[rows], self.gearboxes[rows], self.origin)


def measured(folder: Path, axis: Axis) -> tuple[Vectors, dict[str, list[NormalRecording]]]:
    """All recordings as features, and the normal ones by gearbox."""
    values, labels, gearboxes = [], [], []
    normal: dict[str, list[NormalRecording]] = {}
    with (folder / "manifest.csv").open() as lines:
        for row in csv.DictReader(lines):
            speed, payload = float(row["speed_rad_s"]), float(row["payload_kg_m2"])
            recording = read_recording(folder / row["file"])
            condition = condition_on(axis, speed_rad_s=speed, payload_kg_m2=payload)
            found = extract(recording, condition)
            values.append(found.features.values)
            labels.append(row["label"])
            gearboxes.append(row["gearbox"])
            if row["label"] == "normal" and found.motion.period_s:
                heard = NormalRecording(recording.samples, speed, payload, found.motion.period_s)
                normal.setdefault(row["gearbox"], []).append(heard)
    return Vectors(np.array(values), np.array(labels), np.array(gearboxes), "measured"), normal


def simulated(planned: Sequence[Planned], sources: Sequence[str]) -> Vectors:
    """Simulate cases; `sources` says whose normal recordings each has heard."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        values = list(pool.map(_features, planned, chunksize=4))
    labels = np.array([each.label for each in planned])
    return Vectors(np.array(values), labels, np.array(sources), "simulated")


def _features(planned: Planned) -> NDArray[np.float32]:
    return simulate_case(planned).extraction.features.values


def right(parts: Sequence[Vectors], queries: Vectors) -> int:
    """How many queries a library of these parts gives the right label as its best hypothesis."""
    parts = [part for part in parts if part.labels.size]
    count = sum(part.labels.size for part in parts)
    ids = np.array([f"{number:06d}" for number in range(count)])
    gearboxes = np.concatenate([p.gearboxes for p in parts])
    table = CaseTable(
        1,
        EXTRACTOR_VERSION,
        tuple(catalogue()),
        ids,
        np.concatenate([part.labels for part in parts]),
        np.concatenate([np.full(part.labels.size, part.origin) for part in parts]),
        np.full(count, "axis"),
        gearboxes,
        ids.copy(),
        np.concatenate([part.values for part in parts]).astype(np.float32),
    )
    reasoner = Reasoner(table)
    said = [reasoner.judge(values) for values in queries.values]
    best = [judgement.best.label for judgement in said]
    return int((np.array(best) == queries.labels).sum())


def few(known: Vectors, each: int, seed: int) -> Vectors:
    """Some measured cases of every class."""
    random = np.random.default_rng(seed)
    rows = [random.permutation(np.flatnonzero(known.labels == label))[:each] for label in sorted(set(known.labels))]
    return known.take(np.concatenate(rows))


@dataclass(frozen=True, eq=False)
class Material:
    """What is compared: measured cases, simulated ones of usual housings, and ones fitted to the normal recordings
    of one gearbox each, whose name they bear."""

    known: Vectors
    generic: Vectors
    fitted: Vectors


def material(folder: Path, cases: int) -> Material:
    """Read the measured recordings and simulate `cases` of every label of either kind."""
    axis = read_axis(folder / "axis.toml")
    known, normal = measured(folder, axis)
    usual = plan(axis, dict.fromkeys(LABELS, cases), 0, duration_s=DURATION_S)
    planned, sources = [], []
    for number, (name, heard) in enumerate(sorted(normal.items())):
        counts = dict.fromkeys(LABELS, max(4, cases // len(normal)))
        microphones = [fit_sound(axis, heard).microphone]
        more = plan(axis, counts, 100 + number, microphones=microphones, duration_s=DURATION_S)
        planned += more
        sources += [name] * len(more)
    return Material(known, simulated(usual, ["-"] * len(usual)), simulated(planned, sources))


def scores(given: Material) -> dict[str, int]:
    """How many recordings are diagnosed right by what kind of library, the recording's own gearbox held out."""
    found: dict[str, int] = {}
    for queries, others, own in held_out(given):
        kinds = {
            "simulated cases alone, usual housings": [given.generic],
            "fitted to siblings' normal recordings, and these": [own, others.take(others.labels == "normal")],
            "measured": [others],
            "measured and fitted": [others, own],
        }
        for kind, parts in kinds.items():
            found[kind] = found.get(kind, 0) + right(parts, queries)
    return found


def learning_curve(given: Material) -> dict[str, list[float]]:
    """Share diagnosed right with `EACH` measured cases of each class, alone and with simulated cases fitted."""
    found = {kind: [0.0] * len(EACH) for kind in ("measured", "measured and fitted")}
    tries = given.known.labels.size * DRAWS
    for queries, others, own in held_out(given):
        for place, each in enumerate(EACH):
            for seed in range(DRAWS):
                part = few(others, each, seed)
                found["measured"][place] += right([part], queries) / tries
                found["measured and fitted"][place] += right([part, own], queries) / tries
    return found


def held_out(given: Material) -> Iterator[tuple[Vectors, Vectors, Vectors]]:
    """Gearbox by gearbox: its recordings, those of the others, and the cases fitted to the others."""
    for name in sorted(set(given.known.gearboxes.tolist())):
        own = given.known.gearboxes == name
        yield given.known.take(own), given.known.take(~own), given.fitted.take(given.fitted.gearboxes != name)


def draw(curve: dict[str, list[float]], path: Path) -> None:
    """Plot the learning curve."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3.5), layout="constrained")
    FigureCanvasAgg(figure)
    area = figure.subplots()
    for (kind, shares), style in zip(curve.items(), ("o--", "s-"), strict=True):
        area.plot(EACH, shares, style, label=kind)
    area.axhline(1 / 3, color="0.6", lw=0.8)
    area.annotate("chance", (EACH[0], 1 / 3), fontsize=8, va="bottom")
    area.set(xlabel="measured cases of each class", ylabel="diagnosed right [1]", ylim=(0.3, 1.02), xticks=EACH)
    area.grid(alpha=0.3)
    area.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80)


def rows(folder: Path, cases: int, figure: Path) -> Iterator[Row]:
    """Measure, draw, and say what was found; the time of a row is what it took on top of those before."""
    started = time.perf_counter()
    given = material(folder, cases)
    yield Row(
        f"{given.known.labels.size} recordings read, 2 x 3 x {cases} cases simulated", time.perf_counter() - started
    )
    started = time.perf_counter()
    found = scores(given)
    took = (time.perf_counter() - started) / len(found)
    for kind, count in found.items():
        share = Proportion(count, given.known.labels.size)
        low, high = share.interval
        yield Row(kind, took, note=f"{share.right}/{share.of} = {share.value:.2f} ({low:.2f} to {high:.2f})")
    started = time.perf_counter()
    curve = learning_curve(given)
    draw(curve, figure)
    took = (time.perf_counter() - started) / (len(curve) * len(EACH))
    for kind, shares in curve.items():
        for each, value in zip(EACH, shares, strict=True):
            yield Row(f"{each} measured of each class: {kind}", took, note=f"{value:.2f}")


def run() -> list[Row]:
    """All rows; one that says so where the measured data are not here."""
    folder = SHARED / "data" / "axis_recordings"
    if not folder.exists():
        return [Row("skipped", 0.0, note="the measured data are not here: set GEARCASE_SHARED to their folder")]
    return list(rows(folder, CASES, FIGURE))


def main(folder: Path, cases: int) -> None:
    """Measure and print."""
    from benchmarks import table

    for row in rows(folder, cases, FIGURE):
        print(table("", [row]).strip("\n"), flush=True)


if __name__ == "__main__":
    chosen = Path(sys.argv[1]) if len(sys.argv) > 1 else SHARED / "data" / "axis_recordings"
    main(chosen, int(sys.argv[2]) if len(sys.argv) > 2 else CASES)
