"""Diagnosis of recordings from gearboxes the library has not seen, beside usual ways.

Needs the measured data (GEARCASE_SHARED, default `../shared` beside the checkout). Every share of right answers is
followed by its 95 % Wilson interval. The recordings tested are never in the library, nor are others of their gearbox.

`python -m benchmarks.diagnosis side_by_side field_bank` prints these parts alone, each with how well its probabilities
are calibrated on recordings of known labels.
"""

import csv
import itertools
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from benchmarks import Row
from benchmarks.field_bank import bank
from benchmarks.plain_classifier import PlainClassifier
from benchmarks.shared_data import SHARED
from casebase.reasoning.diagnosis import DIAGNOSED_FROM, Reasoner
from casebase.search.case_table import CaseTable
from signals.condition import OperatingCondition
from signals.features import EXTRACTOR_VERSION, Extraction, extract
from signals.reading.decode import read_recording
from signals.recording import Recording

DATA = SHARED / "data"
Samples = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Sound:
    """One labelled recording."""

    name: str
    samples: Samples
    rate_hz: float
    label: str
    group: str
    condition: OperatingCondition

    def extraction(self) -> Extraction:
        """Return its features."""
        return extract(Recording(self.samples, self.rate_hz), self.condition)


def axis_sounds(folder: Path = DATA / "axis_recordings") -> list[Sound]:
    """Return the recordings of the manifest."""
    with (folder / "manifest.csv").open(encoding="utf-8") as file:
        return [_axis_sound(folder, row) for row in csv.DictReader(file)]


def _axis_sound(folder: Path, row: dict[str, str]) -> Sound:
    samples, rate = soundfile.read(folder / row["file"], dtype="float32")
    condition = OperatingCondition(speed_rad_s=float(row["speed_rad_s"]), payload_kg_m2=float(row["payload_kg_m2"]))
    return Sound(row["file"], samples, float(rate), row["label"], row["gearbox"], condition)


def _table(sounds: Sequence[Sound], extractions: Sequence[Extraction]) -> CaseTable:
    ids = np.array([f"{row:032x}" for row in range(len(sounds))])
    labels, groups = np.array([each.label for each in sounds]), np.array([each.group for each in sounds])
    origins = np.array(["measured"] * len(sounds))
    values = np.array([each.features.values for each in extractions], dtype=np.float32)
    names = extractions[0].features.names
    return CaseTable(1, EXTRACTOR_VERSION, names, ids, labels, origins, origins, groups, ids, values)


# -- nearest neighbours and one logistic, on the same splits


@dataclass(frozen=True, eq=False)
class Asked:
    """A recording with its true label, "" where no label is right."""

    kind: str
    truth: str
    extraction: Extraction


def side_by_side() -> list[Row]:
    """Shared recordings: what is said at 0.9 with one to four gearboxes in the library, over all choices of them."""
    sounds = axis_sounds()
    asked = [Asked("shared", each.label, each.extraction()) for each in sounds]
    table = _table(sounds, [each.extraction for each in asked])
    serials, rows = np.unique(table.gearboxes), []
    for count in range(1, serials.size):
        inside = [np.isin(table.gearboxes, chosen) for chosen in itertools.combinations(serials, count)]
        parts = [(table.take(known), [asked[row] for row in np.flatnonzero(~known)]) for known in inside]
        rows += _both(f"{count} gearboxes", parts)
    return rows


def field_bank() -> list[Row]:
    """Sounds of benchmarks/field_bank, half work: what is said at 0.9 with two to ten gearboxes in the library."""
    known = [_known(each) for each in bank.libraries("work", "own", 10)[0]]
    files = bank.written("work", "own", Path(tempfile.gettempdir()) / "gearcase-field-bank")
    files = [(file, question) for file, question in files if question.group != "harmless"]
    with ProcessPoolExecutor(2) as pool:
        cases = list(pool.map(Sound.extraction, known, chunksize=4))
        heard = list(pool.map(_read, [file for file, _ in files], chunksize=16))
    asked = [Asked(each.group, each.truth, found) for (_, each), found in zip(files, heard, strict=True)]
    table = _table(known, cases)
    gearboxes = list(dict.fromkeys(table.gearboxes.tolist()))
    return [
        row
        for count in (2, 3, 5, 10)
        for row in _both(f"{count} gearboxes", [(table.take(np.isin(table.gearboxes, gearboxes[:count])), asked)])
    ]


def _known(each: bank.Known) -> Sound:
    condition = OperatingCondition(speed_rad_s=each.speed_rad_s, payload_kg_m2=each.payload_kg_m2)
    samples, rate = each.sound.samples.astype(np.float32), float(each.sound.rate)
    return Sound("", samples, rate, each.label, each.gearbox, condition)


def _read(file: Path) -> Extraction:
    return extract(read_recording(file))


def _both(name: str, parts: Iterable[tuple[CaseTable, Sequence[Asked]]]) -> list[Row]:
    """Return a row for every kind: right and wrong answers of at least 0.9, of Gearcase and of the plain classifier.

    The last row is the calibration of what Gearcase says of known labels.
    """
    tally: dict[str, NDArray[np.intp]] = {}
    given: list[tuple[float, bool, bool]] = []
    start = time.perf_counter()
    for table, asked in parts:
        reasoner, plain = Reasoner(table), PlainClassifier(table)
        for each in asked:
            diagnosis = reasoner.diagnose(each.extraction)
            label, sure = plain.judge(each.extraction.features.values) if each.extraction.usable else ("", 0.0)
            ours, theirs = diagnosis.verdict == "diagnosed", sure >= DIAGNOSED_FROM
            own, other = diagnosis.label == each.truth, label == each.truth
            if each.truth and diagnosis.hypotheses:
                best = diagnosis.hypotheses[0]
                given.append((best.probability, best.label == each.truth, ours))
            found = (ours and own, ours and not own, theirs and other, theirs and not other, True)
            tally[each.kind] = tally.get(each.kind, np.zeros(5, np.intp)) + found
    seconds = (time.perf_counter() - start) / max(1, sum(counts[-1] for counts in tally.values()))
    return [
        Row(f"{name}, {kind}", seconds, note="said right/wrong {}/{}, plain {}/{} of {}".format(*counts))
        for kind, counts in tally.items()
    ] + [Row(f"{name}, calibration", seconds, note=_calibration(np.array(given)))]


def _calibration(given: NDArray[np.float64]) -> str:
    """Return the expected calibration error in ten bins of equal counts, and what is said beside how often it is right.

    Source: Naeini, Cooper, Hauskrecht, Obtaining well calibrated probabilities using Bayesian binning, AAAI (2015).

    Args:
        given: probability of the leading label, whether it is right, whether it is said, shape (n, 3).
    """
    bins = np.array_split(given[given[:, 0].argsort(kind="stable")], 10)
    error = sum(abs(part[:, 0].sum() - part[:, 1].sum()) for part in bins) / len(given)
    said = given[given[:, 2] == 1, :2]
    sure, right = said.mean(axis=0) if len(said) else (0.0, 0.0)
    return (
        f"ECE {error:.3f} of {len(given)}; said {sure:.3f}, right {right:.3f}, gap {sure - right:+.3f} of {len(said)}"
    )


PARTS: tuple[Callable[[], list[Row]], ...] = (side_by_side, field_bank)


def run() -> list[Row]:
    """Return all rows; one that says so where the measured data are not here."""
    if not DATA.exists():
        return [Row("skipped", 0.0, note="the measured data are not here: set GEARCASE_SHARED to their folder")]
    return [row for part in PARTS for row in part()]


if __name__ == "__main__":
    from benchmarks import table as shown

    for part in PARTS:
        if part.__name__ in sys.argv[1:] or not sys.argv[1:]:
            print(shown(part.__doc__ or part.__name__, part()), flush=True)
