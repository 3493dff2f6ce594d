"""What simulated cases are worth on measured recordings: `python -m benchmarks.measured_help FOLDER [CASES]`.

FOLDER holds axis.toml, manifest.csv (file, label, gearbox, payload_kg_m2, speed_rad_s) and the recordings. One
gearbox at a time is held out; no simulated case has heard anything of it, and none has heard a fault.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.generation import simulate_case
from app.intake import mesh_orders, shaft_orders
from casebase.diagnosis import Reasoner
from casebase.learning import learn
from casebase.retrieval import CaseTable
from casebase.signals.condition import OperatingCondition
from casebase.signals.decode import read_recording
from casebase.signals.features import EXTRACTOR_VERSION, catalogue, extract
from sim.axis import Axis, read_axis
from sim.design import LABELS, Planned, plan
from sim.fitting import Heard, fit_sound

DURATION_S = 15.0
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


def measured(folder: Path, axis: Axis) -> tuple[Vectors, dict[str, list[Heard]]]:
    """All recordings as features, and the normal ones by gearbox."""
    values, labels, gearboxes = [], [], []
    normal: dict[str, list[Heard]] = {}
    with (folder / "manifest.csv").open() as lines:
        for row in csv.DictReader(lines):
            speed, payload = float(row["speed_rad_s"]), float(row["payload_kg_m2"])
            recording = read_recording(folder / row["file"])
            condition = OperatingCondition(
                speed_rad_s=speed,
                payload_kg_m2=payload,
                shaft_orders=shaft_orders(axis),
                mesh_orders=mesh_orders(axis),
            )
            found = extract(recording, condition)
            values.append(found.features.values)
            labels.append(row["label"])
            gearboxes.append(row["gearbox"])
            if row["label"] == "normal" and found.motion.period_s:
                heard = Heard(recording.samples, speed, payload, found.motion.period_s)
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
    reasoner = Reasoner(table, learn(table))
    said = [reasoner.judge(values) for values in queries.values]
    best = [judgement.classes[int(np.argmax(judgement.probabilities))] for judgement in said]
    return int((np.array(best) == queries.labels).sum())


def few(known: Vectors, each: int, seed: int) -> Vectors:
    """Some measured cases of every class."""
    random = np.random.default_rng(seed)
    rows = [random.permutation(np.flatnonzero(known.labels == label))[:each] for label in sorted(set(known.labels))]
    return known.take(np.concatenate(rows))


def main(folder: Path, cases: int) -> None:
    """Measure and print."""
    axis = read_axis(folder / "axis.toml")
    known, normal = measured(folder, axis)
    names = sorted(set(known.gearboxes.tolist()))
    unfitted = plan(axis, dict.fromkeys(LABELS, cases), 0, duration_s=DURATION_S)
    generic = simulated(unfitted, ["-"] * len(unfitted))
    planned, sources = [], []
    for number, name in enumerate(names):
        microphone = fit_sound(axis, normal[name]).microphone
        counts = dict.fromkeys(LABELS, max(4, cases // len(names)))
        more = plan(axis, counts, 100 + number, microphones=[microphone], duration_s=DURATION_S)
        planned += more
        sources += [name] * len(more)
    fitted = simulated(planned, sources)
    total = known.labels.size
    kinds = ("simulated alone", "fitted to siblings' normal recordings, with these", "measured", "measured and fitted")
    scores = dict.fromkeys(kinds, 0)
    curve = {(each, kind): 0 for each in (1, 2, 4) for kind in ("measured", "both")}
    for name in names:
        queries, others = known.take(known.gearboxes == name), known.take(known.gearboxes != name)
        own = fitted.take(fitted.gearboxes != name)
        siblings = others.take(others.labels == "normal")
        for key, parts in zip(scores, ([generic], [own, siblings], [others], [others, own]), strict=True):
            scores[key] += right(parts, queries)
        for each, kind in curve:
            for seed in range(DRAWS):
                parts = [few(others, each, seed), *([own] if kind == "both" else [])]
                curve[each, kind] += right(parts, queries)
    for key, value in scores.items():
        print(f"{key:55s} {value}/{total} = {value / total:.2f}")
    for (each, kind), value in curve.items():
        print(f"{each} measured per class, {kind:10s} {value / total / DRAWS:.2f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 40)
