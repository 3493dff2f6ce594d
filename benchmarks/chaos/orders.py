"""Every POST that makes something, with a request that does, and what is in the database and on disk afterwards."""

import csv
import io
import json
import math
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.http.keys import Role, create_key
from app.http.sessions import open_session
from app.recordings.intake import RecordingMetadata, take_in
from app.service import Service
from benchmarks.harness.sounds import sound
from casebase.alarms import outbox
from casebase.diagnoses import revise_diagnosis
from casebase.steps import standing
from casebase.store.audio_store import sha256_of
from casebase.store.bundle import SCHEMA
from casebase.store.bundle_worker import MANIFEST
from casebase.store.models import (
    AlarmReceiver,
    AlarmRule,
    ApiKey,
    AuditEntry,
    AxisRevision,
    Case,
    Delivery,
    IdempotencyRecord,
    RobotRevision,
    StoredDiagnosis,
    StoredInvestigation,
    StoredJob,
    StoredRecording,
    new_id,
)

AXIS: dict[str, Any] = {
    "name": "chaos",
    "motor": {"inertia_kg_m2": 0.006, "coulomb_friction_n_m": 0.4},
    "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 600, "stiffness_n_m_per_rad": 1.5e5}],
    "load": {"inertia_kg_m2": 40.0},
    "motion": {"period_s": 4.2, "load_speed_rad_s": 2.7, "acceleration_time_s": 0.3},
}
FREE = {"name": "free", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 1.0}}
ROBOT = b'name = "arm"\n[[joints]]\nname = "turn"'
URDF = b"""<robot name="arm"><link name="base"/><link name="arm"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="turn" type="continuous">
<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>"""
COUNTED = (
    StoredRecording, Case, StoredDiagnosis, AxisRevision, RobotRevision, StoredInvestigation, StoredJob, ApiKey,
    AuditEntry, IdempotencyRecord, AlarmReceiver, AlarmRule, Delivery,
)  # fmt: skip


@dataclass(frozen=True)
class Known:
    """What a database holds: key and session of an admin, a diagnosis, an investigation that found, who is told, and
    the number of a step that stands: a verdict on another diagnosis."""

    key: str
    session: str
    diagnosis: str
    investigation: str
    receiver: str
    step: int


Options = dict[str, Any]
Order = Callable[[Known], tuple[str, Options]]
"""The path and the rest of a request; `data` with a csrf token is added to that of a page."""


def telemetry(size: float = 1.0) -> bytes:
    """Three seconds of the free axis' 1.006 kg m2 that swing at 10 rad/s; `size`: of its torque, 1 as described."""
    out = io.StringIO()
    table = csv.writer(out)
    table.writerow(("time_s", "motor_torque_nm", "motor_speed_rad_s"))
    table.writerows(
        (number / 1000, 10.06 * size * math.cos(number / 100), math.sin(number / 100)) for number in range(3000)
    )
    return out.getvalue().encode()


def upload(seed: int, **metadata: str) -> Options:
    content = sound(seed, seconds=2.0, impacts=metadata.get("label") == "notch")
    return {"files": {"file": (f"{seed}.wav", content)}, "data": {"metadata": json.dumps(metadata)}}


def bundle(seeds: Iterable[int]) -> tuple[list[str], bytes]:
    """A bundle of one case for each seed: the hashes of its sounds, and the ZIP."""
    sounds = {sha256_of(content): content for content in (sound(seed, seconds=2.0) for seed in seeds)}
    entries = [
        {"audio": f"audio/{each}", "sha256": each, "label": "normal", "recording": {"gearbox": "elsewhere"}}
        for each in sounds
    ]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        target.writestr(MANIFEST, json.dumps({"schema": SCHEMA, "cases": entries}))
        for each, content in sounds.items():
            target.writestr(f"audio/{each}", content)
    return list(sounds), packed.getvalue()


def investigation(size: float = 1.0) -> Options:
    return {"files": {"telemetry": ("t.csv", telemetry(size))}, "data": {"axis": json.dumps(FREE)}}


def simulation(seed: int, cases: int = 2, duration_s: float = 1.0) -> Options:
    return {"json": {"axis": AXIS, "counts": {"normal": cases}, "seed": seed, "duration_s": duration_s}}


API = "/api/v1"
TOPIC = "works/gearcase"
"""Of a broker that is not set: the message waits."""
ORDERS: Mapping[str, Order] = {
    "/diagnoses": lambda _: (f"{API}/diagnoses", upload(1, axis="chaos")),
    "/cases": lambda _: (f"{API}/cases", upload(2, label="normal", gearbox="g")),
    "/cases (diagnosis)": lambda known: (
        f"{API}/cases",
        {"json": {"diagnosis_id": known.diagnosis, "label": "notch"}},
    ),
    "/axes": lambda _: (f"{API}/axes", {"json": AXIS}),
    "/robots": lambda _: (f"{API}/robots", {"files": {"robot": ("robot.toml", ROBOT), "urdf": ("arm.urdf", URDF)}}),
    "/simulations": lambda _: (f"{API}/simulations", simulation(1)),
    "/keys": lambda _: (f"{API}/keys", {"json": {"name": "new", "role": "viewer"}}),
    "/investigations": lambda _: (f"{API}/investigations", investigation()),
    "/alarms/receivers": lambda _: (
        f"{API}/alarms/receivers",
        {"json": {"name": "hall 3", "kind": "mqtt", "address": TOPIC}},
    ),
    "/alarms/rules": lambda known: (
        f"{API}/alarms/rules",
        {"json": {"name": "any fault", "kind": "state", "receivers": [known.receiver]}},
    ),
    "/alarms/receivers/{receiver_id}/test": lambda known: (f"{API}/alarms/receivers/{known.receiver}/test", {}),
    "/investigations/{investigation_id}/accept": lambda known: (
        f"{API}/investigations/{known.investigation}/accept",
        {},
    ),
    "/steps/{number}/undo": lambda known: (f"{API}/steps/{known.step}/undo", {}),
}
PAGES: Mapping[str, Order] = {
    "page /investigations/new": lambda _: (
        "/investigations/new",
        {"files": {"telemetry": ("t.csv", telemetry()), "axis": ("axis.json", json.dumps(FREE).encode())}, "data": {}},
    ),
    "page /library/simulate": lambda _: ("/library/simulate", {"data": {"axis": "paper", "count": ["1", "1", "1"]}}),
}
"""Forms that order jobs; they have no Idempotency-Key, and are to leave all or nothing."""
MAKES_NOTHING = ("/jobs/{job_id}/resume", "/alarms/deliveries/{delivery_id}/retry", "/retrievals")


def fill(service: Service) -> Known:
    """Put into an empty library what the orders need."""
    library = service.library
    path = library.data_dir / "first.wav"
    path.write_bytes(sound(100, seconds=2.0))
    intake = take_in(library, path, "first.wav", "audio/wav", RecordingMetadata(gearbox="g0"))
    with library.transaction("chaos") as session:
        row, key = create_key(session, name="chaos", role=Role.ADMIN)
        signed_in = open_session(session, row.id)
        diagnosis = intake.diagnose(library, session)
        session.add(AxisRevision(name="paper", revision=1, document={**AXIS, "name": "paper"}, created_by="chaos"))
        extended = {**FREE, "motor": {"inertia_kg_m2": 0.006, "coulomb_friction_n_m": 0.4}}
        found = StoredInvestigation(
            id=new_id(), state="done", axis="free", axis_document=FREE, inputs={}, created_by="chaos",
            document={"verdict": "named", "extended_axis": extended},
        )  # fmt: skip
        session.add(found)
        receiver = outbox.add_receiver(session, "maintenance", "mqtt", TOPIC).id
        session.flush()
        rejected = revise_diagnosis(session, intake.diagnose(library, session).id, "rejected")
        (step,) = standing(session, ("diagnosis", rejected.id))
        number = step.id
    path.unlink()
    return Known(key, signed_in, diagnosis.id, found.id, receiver, number)


def counts(session: Session) -> dict[str, int]:
    """Rows by table."""
    return {table.__tablename__: session.scalar(select(func.count()).select_from(table)) or 0 for table in COUNTED}


def ghosts(service: Service) -> Iterator[str]:
    """What is there by half: nothing, if all is well."""
    library = service.library
    with library.reading() as session:
        jobs = set(session.scalars(select(StoredJob.id).where(StoredJob.kind == "investigations")))
        asked = set(session.scalars(select(StoredInvestigation.id).where(StoredInvestigation.job_id.is_not(None))))
        yield from (f"investigation {each} has no job" for each in asked - jobs)
        yield from (f"job {each} has no investigation" for each in jobs - asked)
        for record in session.scalars(select(IdempotencyRecord).where(IdempotencyRecord.status.is_(None))):
            yield f"key {record.key} has no answer"
        spoken = set(session.scalars(select(StoredRecording.file_sha256).where(StoredRecording.erased_at.is_(None))))
        for inputs in session.scalars(select(StoredInvestigation.inputs)):
            for kept in inputs.values():
                spoken |= {str(one["sha256"]) for one in (kept if isinstance(kept, list) else [kept]) if is_file(one)}
    there = set(library.audio.hashes())
    yield from (f"audio {each[:12]} is missing" for each in spoken - there)
    yield from (f"audio {each[:12]} is nobody's" for each in there - spoken)
    yield from (f"{path} was left" for path in left(service.settings.data_dir))


def is_file(kept: object) -> bool:
    return isinstance(kept, dict) and "sha256" in kept


def left(data_dir: Path) -> Iterator[Path]:
    """Files that were under way."""
    yield from (data_dir / "audio").glob(".*")
    yield from (data_dir / "incoming").glob("*")
