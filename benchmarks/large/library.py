"""Rows of a large library: cases, recordings that wait for a person, and one gearbox that was heard every day.

Numbers are generated; features are as the extractor names and stores them. The sounds behind them are not there.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import timedelta
from itertools import islice

import numpy as np
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from casebase.store.counter import count_change
from casebase.store.models import (
    Alarm,
    AlarmRule,
    AuditEntry,
    AxisRevision,
    Case,
    Delivery,
    Extractor,
    FeatureRow,
    MaintenanceMark,
    StoredDiagnosis,
    StoredInvestigation,
    StoredJob,
    StoredRecording,
    new_id,
    now,
)
from signals.features import EXTRACTOR_VERSION, NAMES

LABELS = ("normal", "notch", "play")
AXES = 8
LONG = ("bench", "g1")
"""Axis and name of the gearbox that was heard most."""
TOGETHER = 1000
Fields = dict[str, object]


@dataclass(frozen=True)
class Size:
    """How much there is.

    Args:
        cases: one recording each.
        gearboxes: that cases and waiting recordings are of.
        waiting: recordings whose diagnosis is open, a third of them likely faults.
        heard: recordings of one gearbox, each diagnosed.
        others: investigations, jobs, messages and notes, a tenth as many alarms, ten times as many audit entries.
    """

    cases: int = 10_000
    gearboxes: int = 1200
    waiting: int = 5000
    heard: int = 3000
    others: int = 500


def fill(session: Session, size: Size) -> str:
    """Put it into the tables of a library that has an axis and a diagnosis, like which all others are.

    Returns:
        The id of a job.
    """
    axis = session.scalars(select(AxisRevision).limit(1)).one().document
    diagnosis = session.scalars(select(StoredDiagnosis).limit(1)).one().document
    count, version = size.cases + size.waiting + size.heard, count_change(session)
    if session.get(Extractor, EXTRACTOR_VERSION) is None:
        session.add(Extractor(version=EXTRACTOR_VERSION, names=list(NAMES)))
        session.flush()
    session.execute(
        insert(AxisRevision),
        [
            {"name": f"a{one}", "revision": 1, "document": {**axis, "name": f"a{one}"}, "created_by": "large"}
            for one in range(AXES)
        ],
    )
    _insert(session, StoredRecording, (_recording(size, number) for number in range(count)))
    _insert(session, Case, (_case(number, version) for number in range(size.cases)))
    _insert(session, FeatureRow, _features(count))
    _insert(session, StoredDiagnosis, (_diagnosis(size, number, diagnosis) for number in range(size.cases, count)))
    _others(session, size)
    return session.scalars(select(StoredJob.id).limit(1)).one()


def _insert(session: Session, table: type, rows: Iterator[Fields]) -> None:
    while some := list(islice(rows, TOGETHER)):
        session.execute(insert(table), some)


def _others(session: Session, size: Size) -> None:
    investigation = session.scalars(select(StoredInvestigation).limit(1)).first()
    if investigation is not None:
        copied = {
            "state": "done",
            "axis": investigation.axis,
            "axis_document": investigation.axis_document,
            "inputs": {},
            "document": investigation.document,
            "report": investigation.report,
            "finished_at": now(),
            "created_by": "large",
        }
        rows = ({**copied, "id": (one := new_id()), "job_id": one} for _ in range(size.others // 5))
        _insert(session, StoredInvestigation, rows)
    result = {"new": 1, "known": 0, "counts": {"normal": 1}}
    finished = {"kind": "simulations", "parameters": {}, "state": "done", "result": result, "finished_at": now()}
    _insert(session, StoredJob, ({**finished, "id": new_id()} for _ in range(size.others)))
    rule = session.scalars(select(AlarmRule).limit(1)).first()
    if rule is not None:
        alarms = ({"rule_id": rule.id, "axis": "a1", "gearbox": f"old {one}"} for one in range(size.others // 10))
        _insert(session, Alarm, alarms)
    message = {"kind": "state", "rule": "any fault", "axis": "a1", "gearbox": "g1", "verdict": "diagnosed"}
    message |= {"label": "notch", "probability": 0.9, "calibrated": True, "size_rad": None}
    message |= {"heard_at": now().isoformat(), "diagnosis_id": None}
    sent = {"receiver_id": "0" * 32, "receiver_name": "team", "message": message, "state": "sent", "attempts": 1}
    _insert(session, Delivery, ({**sent, "id": new_id()} for _ in range(size.others)))
    entry = {"actor": "large", "action": "case.retained", "subject_kind": "case", "before": {}, "after": {}}
    _insert(session, AuditEntry, ({**entry, "subject_id": f"{one:032x}"} for one in range(10 * size.others)))
    noted = {"kind": "note", "text": "greased", "created_by": "large"}
    noted |= {"axis": LONG[0], "gearbox": LONG[1]}
    marks = ({**noted, "id": new_id(), "at": now() - timedelta(days=30 * one)} for one in range(size.others // 10))
    _insert(session, MaintenanceMark, marks)


def _features(count: int) -> Iterator[Fields]:
    random = np.random.default_rng(1)
    middle = random.normal(size=(len(LABELS), len(NAMES)))
    for number in range(count):
        yield {
            "recording_id": f"{number:032x}",
            "extractor_version": EXTRACTOR_VERSION,
            "finite": (middle[number % 3] + random.normal(size=len(NAMES))).astype(np.float32),
            "missing": bytes(-(-len(NAMES) // 8)),
            "motion": {},
            "events": [],
        }


def _diagnosis(size: Size, number: int, given: Mapping[str, object]) -> Fields:
    identity = new_id()
    daily = number >= size.cases + size.waiting
    verdict = "diagnosed" if daily else ("ambiguous", "not_in_library", "diagnosed")[number % 3]
    label = None if verdict == "not_in_library" else "normal" if daily and number % 100 else "notch"
    faults = [{"label": label, "probability": 0.95}] if label == "notch" else []
    said = {"verdict": verdict, "label": label, "faults": faults, "probability": 0.95}
    return {
        "id": identity,
        "recording_id": f"{number:032x}",
        "document": {**given, **said, "id": identity},
        "state": "open",
        "version": 1,
        "created_by": "large",
        **{name: said[name] for name in ("verdict", "label", "probability")},
    }


def _recording(size: Size, number: int) -> Fields:
    key, daily = f"{number:032x}", number >= size.cases + size.waiting
    back = size.cases + size.waiting + size.heard - number if daily else 1 + number % 25
    gearbox = number % size.gearboxes
    axis, name = LONG if daily else (f"a{gearbox % AXES}", f"g{gearbox}")
    return {
        "id": key,
        "fingerprint": f"{number:064x}",
        "samples_sha256": f"{number:064x}",
        "sound_id": key,
        "file_sha256": f"{number:064x}",
        "file_name": f"recording {number}.wav",
        "media_type": "audio/wav",
        "byte_count": 96_044,
        "sample_rate_hz": 8000.0,
        "channel": 0,
        "channels": 1,
        "duration_s": 6.0,
        "unit": "1",
        "usable": True,
        "quality": [],
        "axis": axis,
        "gearbox": name,
        "payload_kg_m2": 40.0,
        "speed_rad_s": 2.5,
        "recorded_at": now() - timedelta(days=back),
        "description": {},
        "created_by": "large",
    }


def _case(number: int, version: int) -> Fields:
    key = f"{number:032x}"
    return {
        "id": key,
        "recording_id": key,
        "label": LABELS[number % 3],
        "origin": "measured" if number % 5 else "simulated",
        "state": "confirmed",
        "labelled_by": "large",
        "parameters": {},
        "version": 1,
        "library_version": version,
    }
