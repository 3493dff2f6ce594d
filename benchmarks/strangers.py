"""Diagnosis of recordings that strangers made: four axes, eight motions, five faults that no case has.

`python -m benchmarks.strangers --half final --gearboxes 2,6` asks the half that was not worked with. Sounds are made at
the first call, in some minutes, and kept in the folder of tests.stranger_bank.
"""

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from benchmarks import Row, table
from benchmarks.diagnosis import said
from casebase.case_table import CaseTable
from casebase.diagnosis import Diagnosis, Reasoner
from casebase.signals.condition import OperatingCondition
from casebase.signals.features import EXTRACTOR_VERSION, Extraction, extract
from casebase.signals.recording import Recording
from tests import stranger_bank as bank
from tests.stranger_bank.bank import library_specs

UNHEARD_DB, UNHEARD_PEAK_DB = -20.0, 3.0
"""A fault below these in the whole band, below 200 Hz and in its loudest moments cannot be expected to be heard."""


def heard(spec: bank.Spec) -> tuple[bank.Recorded, Extraction]:
    """Return the truth, without its samples, and the features of a recording."""
    made = bank.cached(spec)
    return replace(made, samples=made.samples[:0]), extract(_recording(made), _condition(made))


def _recording(made: bank.Recorded) -> Recording:
    return Recording(made.samples.astype(np.float32), made.rate_hz)


def _condition(made: bank.Recorded) -> OperatingCondition:
    return OperatingCondition(speed_rad_s=made.speed_rad_s, payload_kg_m2=made.payload_kg_m2)


def reasoner(cases: Sequence[tuple[bank.Recorded, Extraction]]) -> Reasoner:
    """Return what a library of these cases says."""
    usable = [case for case in cases if case[1].usable]
    ids = np.array([f"{row:032x}" for row in range(len(usable))])
    columns = [np.array([value(made) for made, _ in usable]) for value in (_label, _measured, _axis, _gearbox)]
    values = np.array([each.features.values for _, each in usable])
    return Reasoner(CaseTable(1, EXTRACTOR_VERSION, usable[0][1].features.names, ids, *columns, ids, values))


def _label(made: bank.Recorded) -> str:
    return "+".join(sorted(made.labels))


def _measured(_: bank.Recorded) -> str:
    return "measured"


def _axis(made: bank.Recorded) -> str:
    return made.axis


def _gearbox(made: bank.Recorded) -> str:
    return made.gearbox


def audible(made: bank.Recorded) -> bool:
    """Whether a fault can be expected to be heard at all; a sound gear always counts."""
    levels = (made.audibility_db, made.audibility_low_db, made.audibility_peak_db)
    if any(level is None for level in levels):
        return True
    whole, low, peak = (float(level or 0.0) for level in levels)
    return whole >= UNHEARD_DB or low >= UNHEARD_DB or peak >= UNHEARD_PEAK_DB


def answer_of(diagnosis: Diagnosis) -> str:
    """Return what counts as said: the label, or the verdict where there is none."""
    return diagnosis.label or diagnosis.verdict


def judged(half: bank.Half, gearboxes: Sequence[int]) -> list[Row]:
    """Ask all questions of a half of libraries of so many gearboxes of the axis."""
    questions = bank.questions(half)
    axes = list(bank.DESIGNS[half])
    libraries = {axis: library_specs(half, axis, max(gearboxes)) for axis in axes}
    owned = [spec for each in libraries.values() for spec in each]
    specs = list(dict.fromkeys([*owned, *(spec for asked in questions for spec in asked.specs)]))
    begin = time.perf_counter()
    with ProcessPoolExecutor() as pool:
        found = dict(zip(specs, pool.map(heard, specs, chunksize=16), strict=True))
    rows = [Row("features of all", time.perf_counter() - begin)]
    for count in gearboxes:
        known = {}
        for axis, all_cases in libraries.items():
            boxes = sorted({spec.gearbox.name for spec in all_cases})[:count]
            chosen = [spec for spec in all_cases if spec.gearbox.name in boxes]
            known[axis] = reasoner([found[spec] for spec in chosen])
        tally: Counter[tuple[str, str]] = Counter()
        for asked in questions:
            kind = asked.name.split("/")[0]
            for spec in asked.specs:
                truth, extraction = found[spec]
                if kind in ("known", "unseen") and not audible(truth):
                    continue
                diagnosis = known[asked.library_axis].diagnose(extraction)
                answer, sure = answer_of(diagnosis), diagnosis.verdict == "diagnosed"
                right = answer in truth.labels
                groups = [kind, f"known, {truth.motion}"] if kind == "known" else [kind]
                groups += [asked.name.replace(f"/{truth.axis}", "")] if kind == "noise" else []
                for group in groups:
                    tally[group, "all"] += 1
                    tally[group, "right"] += right
                    tally[group, "normal"] += answer == "normal"
                    tally[group, "new"] += answer == "not_in_library"
                    tally[group, "wrong said"] += sure and not right
        rows += _rows(tally, count)
    return rows


def _rows(tally: Counter[tuple[str, str]], count: int) -> list[Row]:
    rows = []
    for group in dict.fromkeys(group for group, _ in tally):
        of = tally[group, "all"]
        words = ("normal", "new", "wrong said") if group == "unseen" else ("right", "new", "wrong said")
        note = "; ".join(f"{word} {said(tally[group, word], of)}" for word in words)
        rows.append(Row(f"{count} gearboxes, {group}", 0.0, note=note))
    return rows


def run() -> list[Row]:
    """Ask the half that may be worked with."""
    return judged("work", (2, 3, 6))


def main() -> None:
    """Ask one half of libraries of some sizes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.strangers", description=__doc__)
    parser.add_argument("--half", choices=("work", "final"), default="work", help="final is run once, at the end")
    parser.add_argument("--gearboxes", default="2,3,6", metavar="N,...", help="how many of each axis, at most 6")
    chosen = parser.parse_args()
    counts = [int(each) for each in chosen.gearboxes.split(",")]
    print(table(f"strangers, half {chosen.half}", judged(chosen.half, counts)))


if __name__ == "__main__":
    main()
