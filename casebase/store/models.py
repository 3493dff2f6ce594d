"""The library's tables; a row is the noun. Times are UTC, quantities SI, documents JSON."""

import os
import time
from datetime import UTC, datetime
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import JSON, ForeignKey, Index, MetaData, String, Text, text
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

from casebase.store.database import FloatVector, UtcDateTime

type_json = JSON().with_variant(JSONB(), "postgresql")

ORIGINS = ("measured", "simulated")
CASE_STATES = ("proposed", "confirmed", "retired")
DIAGNOSIS_STATES = ("open", "confirmed", "corrected", "rejected")
VERIFICATIONS = ("opened", "measured", "heard", "unverified")
"""How a label was verified, the surest first: opened and seen, measured, by ear only, not at all."""
ROLES = ("viewer", "operator", "admin")
ALARM_KINDS = ("state", "change", "silence")
RECEIVER_KINDS = ("email", "webhook", "mqtt")


def new_id() -> str:
    """Return a fresh id: 32 hexadecimal digits that sort by time of creation (UUID version 7)."""
    milliseconds = time.time_ns() // 1_000_000
    random = int.from_bytes(os.urandom(10), "big")
    value = (milliseconds << 80) | (7 << 76) | (random & ((1 << 76) - 1))
    value = (value & ~(0b11 << 62)) | (0b10 << 62)
    return f"{value:032x}"


def now() -> datetime:
    """Return this instant with its offset."""
    return datetime.now(UTC)


class Base(DeclarativeBase):
    """Common metadata; constraint names are fixed so that migrations can speak of them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map: ClassVar = {
        datetime: UtcDateTime,
        dict[str, object]: type_json,
        list[object]: type_json,
    }


class Identified:
    """A row with an id of its own, before all else."""

    id: Mapped[str] = mapped_column(String(32), primary_key=True, default=new_id, sort_order=-1)


class Created:
    """A row that says, behind all else, when it came and who brought it."""

    created_at: Mapped[datetime] = mapped_column(default=now, sort_order=1)
    created_by: Mapped[str] = mapped_column(String(200), sort_order=1)


class Revision(Created):
    """One revision of a description by its name; the highest number is the current one."""

    name: Mapped[str] = mapped_column(String(200), primary_key=True, sort_order=-1)
    revision: Mapped[int] = mapped_column(primary_key=True, sort_order=-1)
    document: Mapped[dict[str, object]] = mapped_column(sort_order=-1)
    note: Mapped[str | None] = mapped_column(Text)
    investigation_id: Mapped[str | None] = mapped_column(ForeignKey("investigations.id"))


class StoredRecording(Identified, Created, Base):
    """One channel of sound or vibration, how it was taken, and where its bytes lie."""

    __tablename__ = "recordings"

    fingerprint: Mapped[str] = mapped_column(String(64), unique=True)
    """SHA-256 of the file's bytes, channel and description: the same twice is one recording."""
    samples_sha256: Mapped[str] = mapped_column(String(64), index=True)
    sound_id: Mapped[str] = mapped_column(String(32), index=True)
    """Id of the first recording of the same sound: its own, or one that differs in container, rate, gain or coding."""
    sound: Mapped[bytes] = mapped_column(deferred=True, default=b"")
    """Words of the fingerprint, little-endian uint32; empty where there is none."""
    file_sha256: Mapped[str] = mapped_column(String(64), index=True)
    file_name: Mapped[str] = mapped_column(String(255))
    media_type: Mapped[str] = mapped_column(String(100))
    byte_count: Mapped[int]
    sample_rate_hz: Mapped[float]
    channel: Mapped[int]
    channels: Mapped[int]
    duration_s: Mapped[float]
    unit: Mapped[str] = mapped_column(String(20))
    usable: Mapped[bool]
    quality: Mapped[list[object]]
    axis: Mapped[str | None] = mapped_column(String(200))
    gearbox: Mapped[str | None] = mapped_column(String(200))
    payload_kg_m2: Mapped[float | None]
    speed_rad_s: Mapped[float | None]
    recorded_at: Mapped[datetime | None]
    description: Mapped[dict[str, object]]
    """Everything that was said of it when it came in."""
    erased_at: Mapped[datetime | None]
    """Since when the audio is not kept any more; rows, features and audit stay."""
    erased_by: Mapped[str | None] = mapped_column(String(200))

    features: Mapped[list["FeatureRow"]] = relationship(back_populates="recording", cascade="all, delete-orphan")

    __table_args__ = (Index("ix_recordings_axis_gearbox", "axis", "gearbox", "id"),)


class SoundKey(Base):
    """Words by which a sound is looked up; see `signals.fingerprint`."""

    __tablename__ = "sound_keys"

    word: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    recording_id: Mapped[str] = mapped_column(
        ForeignKey("recordings.id", ondelete="CASCADE"), primary_key=True, index=True
    )


class FeatureRow(Base):
    """The features of a recording by one version of the extractor; versions are never mixed."""

    __tablename__ = "features"

    recording_id: Mapped[str] = mapped_column(ForeignKey("recordings.id", ondelete="CASCADE"), primary_key=True)
    extractor_version: Mapped[str] = mapped_column(ForeignKey("extractors.version"), primary_key=True, index=True)
    finite: Mapped[NDArray[np.float32]] = mapped_column(FloatVector)
    """(n,) with zero where the feature could not be computed (pgvector knows no NaN)."""
    missing: Mapped[bytes]
    """One bit per feature, set where it could not be computed."""
    motion: Mapped[dict[str, object]]
    events: Mapped[list[object]]

    recording: Mapped[StoredRecording] = relationship(back_populates="features")


class Extractor(Base):
    """The names, in order, that a version of the extractor computes."""

    __tablename__ = "extractors"

    version: Mapped[str] = mapped_column(String(100), primary_key=True)
    names: Mapped[list[object]]


class Case(Identified, Base):
    """A recording with a label: what the library knows."""

    __tablename__ = "cases"

    key: Mapped[str | None] = mapped_column(String(200), unique=True)
    """Given by whoever generates cases, so that doing it twice makes one."""
    recording_id: Mapped[str] = mapped_column(ForeignKey("recordings.id"))
    diagnosis_id: Mapped[str | None] = mapped_column(ForeignKey("diagnoses.id"), index=True)
    label: Mapped[str] = mapped_column(String(100))
    origin: Mapped[str] = mapped_column(String(20))
    state: Mapped[str] = mapped_column(String(20))
    mechanism: Mapped[str | None] = mapped_column(String(100))
    location: Mapped[str | None] = mapped_column(String(100))
    severity: Mapped[float | None]
    parameters: Mapped[dict[str, object]] = mapped_column(default=dict)
    """Of the simulator and its mechanism, contract names; empty for a measured case."""
    model_version: Mapped[str | None] = mapped_column(String(100))
    batch: Mapped[str | None] = mapped_column(String(100), index=True)
    """The job, import or campaign that brought it."""
    labelled_by: Mapped[str] = mapped_column(String(200))
    verified_by: Mapped[str | None] = mapped_column(String(500))
    """How the label was verified: gearbox opened, teeth counted, ..."""
    verification: Mapped[str | None] = mapped_column(String(20))
    """The same as one of VERIFICATIONS; None where nobody said it."""
    quarantine_reason: Mapped[str | None] = mapped_column(Text)
    note: Mapped[str | None] = mapped_column(Text)
    version: Mapped[int] = mapped_column(default=1)
    """The ETag; goes up with every change."""
    library_version: Mapped[int] = mapped_column(index=True)
    """The library's counter when this row changed last."""
    created_at: Mapped[datetime] = mapped_column(default=now)
    updated_at: Mapped[datetime] = mapped_column(default=now)

    recording: Mapped[StoredRecording] = relationship(lazy="joined", innerjoin=True)

    __table_args__ = (
        Index("ix_cases_label_origin", "label", "origin", "id"),
        Index("ix_cases_state", "state", "id"),
        Index("ix_cases_recording_version", "recording_id", "version"),
    )
    __mapper_args__ = {  # noqa: RUF012
        "version_id_col": version
    }


class StoredDiagnosis(Identified, Created, Base):
    """A diagnosis as it was given, and what became of it."""

    __tablename__ = "diagnoses"

    recording_id: Mapped[str] = mapped_column(ForeignKey("recordings.id"))
    verdict: Mapped[str] = mapped_column(String(20))
    label: Mapped[str | None] = mapped_column(String(100))
    probability: Mapped[float | None]
    document: Mapped[dict[str, Any]] = mapped_column(type_json)
    state: Mapped[str] = mapped_column(String(20), default="open")
    revised_label: Mapped[str | None] = mapped_column(String(100))
    verified_by: Mapped[str | None] = mapped_column(String(500))
    verification: Mapped[str | None] = mapped_column(String(20))
    note: Mapped[str | None] = mapped_column(Text)
    revised_by: Mapped[str | None] = mapped_column(String(200))
    revised_at: Mapped[datetime | None]
    version: Mapped[int] = mapped_column(default=1)

    recording: Mapped[StoredRecording] = relationship(lazy="joined", innerjoin=True)

    __table_args__ = (
        Index("ix_diagnoses_verdict", "verdict", "id"),
        Index("ix_diagnoses_state", "state", "id"),
        Index("ix_diagnoses_recording_version", "recording_id", "version"),
    )
    __mapper_args__ = {  # noqa: RUF012
        "version_id_col": version
    }


class AxisRevision(Revision, Base):
    """One revision of an axis description; the highest number is the current one."""

    __tablename__ = "axes"
    noun: ClassVar = "axis"


class RobotRevision(Revision, Base):
    """One revision of a robot's description with the axes of its joints; the highest number is the current one."""

    __tablename__ = "robots"
    noun: ClassVar = "robot"

    urdf: Mapped[str] = mapped_column(Text, deferred=True)
    """Its links and joints; what else a URDF has is not kept."""


class StoredInvestigation(Identified, Base):
    """What was given, what came out, and its report."""

    __tablename__ = "investigations"

    job_id: Mapped[str | None] = mapped_column(String(100), unique=True)
    state: Mapped[str] = mapped_column(String(20), default="queued")
    axis: Mapped[str | None] = mapped_column(String(200), index=True)
    robot: Mapped[str | None] = mapped_column(String(200), index=True)
    """Instead of an axis: the robot whose joints are investigated."""
    axis_document: Mapped[dict[str, object]]
    inputs: Mapped[dict[str, object]]
    """File names and SHA-256 of telemetry and sound, kept content-addressed like recordings."""
    document: Mapped[dict[str, Any] | None] = mapped_column(type_json)
    """What came out; None while nothing has."""
    report: Mapped[str | None] = mapped_column(Text, deferred=True)
    error: Mapped[str | None] = mapped_column(Text)
    created_at: Mapped[datetime] = mapped_column(default=now)
    finished_at: Mapped[datetime | None]
    created_by: Mapped[str] = mapped_column(String(200))

    @property
    def diagnosis_id(self) -> str | None:
        """The diagnosis from which it was started."""
        found = self.inputs.get("diagnosis_id")
        return None if found is None else str(found)

    @property
    def subject(self) -> str | None:
        """Name of the axis or robot."""
        return self.robot or self.axis


class StoredJob(Base):
    """A job: what was ordered, how far it is and how it ended.

    It is stored in the transaction of what orders it, so that there is a job exactly if that was acknowledged.
    """

    __tablename__ = "jobs"

    id: Mapped[str] = mapped_column(String(100), primary_key=True, default=new_id)
    kind: Mapped[str] = mapped_column(String(100))
    parameters: Mapped[dict[str, object]] = mapped_column(deferred=True)
    state: Mapped[str] = mapped_column(String(20), default="queued")
    """`queued`, `running`; `done`, `failed`, `cancelled` once it is over."""
    progress: Mapped[dict[str, object]] = mapped_column(default=dict)
    result: Mapped[Any | None] = mapped_column(type_json)
    error: Mapped[str | None] = mapped_column(Text)
    created_at: Mapped[datetime] = mapped_column(default=now)
    finished_at: Mapped[datetime | None]
    submitted_by: Mapped[str | None] = mapped_column(String(200))
    not_before: Mapped[datetime | None]
    """No worker begins it sooner; at once where there is none."""
    worker: Mapped[str | None] = mapped_column(String(100))
    """The lease of the worker that last began something of it, while it runs."""
    started_at: Mapped[datetime | None]
    started_fraction: Mapped[float] = mapped_column(default=0.0)
    """When it began to run, or to go on, and how far it was then: by these the remaining time is estimated."""
    steps: Mapped[list["JobStep"]] = relationship()

    __table_args__ = (
        Index(
            "ix_jobs_unfinished",
            "id",
            sqlite_where=text("finished_at IS NULL"),
            postgresql_where=text("finished_at IS NULL"),
        ),
    )


class JobStep(Base):
    """A piece of a job that one worker does: `plan`, then the tasks that it cut the job into, then `finish`.

    A step that nobody does has no lease, or one that has ended. The steps of a job that is done or failed are removed.
    """

    __tablename__ = "job_steps"

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False, default=-1)
    """Of a task from 0 on."""
    step: Mapped[str] = mapped_column(String(20), default="plan")
    parameters: Mapped[dict[str, Any]] = mapped_column(JSON, default=dict)
    """Of a task; text in either database, so that the order of its names stays."""
    lease: Mapped[str | None] = mapped_column(String(100))
    lost: Mapped[int] = mapped_column(default=0)
    """Workers that died, or were cut off, while at it."""
    fraction: Mapped[float] = mapped_column(default=0.0)
    done: Mapped[bool] = mapped_column(default=False)
    result: Mapped[Any | None] = mapped_column(JSON)


class StoredJobEvent(Base):
    """One entry of a job's history: how far it was; `number` counts from 0 without gaps."""

    __tablename__ = "job_events"

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    progress: Mapped[dict[str, object]]


class WorkerLease(Base):
    """A worker that lives, as far as anybody knows; see `casebase.store.leases`."""

    __tablename__ = "workers"

    id: Mapped[str] = mapped_column(String(100), primary_key=True)
    beats: Mapped[int]
    lease_s: Mapped[float]
    """Others end the lease after so long without a beat [s]."""
    started_at: Mapped[datetime] = mapped_column(default=now)


class MaintenanceMark(Identified, Created, Base):
    """Something that was done to an axis or a gearbox of it: a repair begins a new baseline, an exchange a new one."""

    __tablename__ = "maintenance_marks"

    axis: Mapped[str] = mapped_column(String(200))
    gearbox: Mapped[str | None] = mapped_column(String(200))
    at: Mapped[datetime]
    kind: Mapped[str] = mapped_column(String(20), default="note")
    """`note`, `repair`, `exchange` or `microphone`: that was moved."""
    successor: Mapped[str | None] = mapped_column(String(200))
    """Of an exchange: what the new gearbox is called, if not as the old one."""
    text: Mapped[str] = mapped_column(Text)

    __table_args__ = (Index("ix_maintenance_marks_axis", "axis", "at"),)


class AlarmReceiver(Identified, Created, Base):
    """Where messages go: an e-mail address, a webhook or an MQTT topic."""

    __tablename__ = "alarm_receivers"

    name: Mapped[str] = mapped_column(String(200))
    kind: Mapped[str] = mapped_column(String(20))
    address: Mapped[str] = mapped_column(Text)
    secret: Mapped[str | None] = mapped_column(String(100), deferred=True)
    """Of a webhook: what its messages are signed with; shown once, when it is made."""
    quiet_from: Mapped[str | None] = mapped_column(String(5))
    quiet_to: Mapped[str | None] = mapped_column(String(5))
    """Quiet hours, HH:MM in the time of the site: messages wait for their end."""


class AlarmRule(Identified, Created, Base):
    """What somebody is told of: a state of a gearbox, a change of its sound, or its silence."""

    __tablename__ = "alarm_rules"

    name: Mapped[str] = mapped_column(String(200))
    kind: Mapped[str] = mapped_column(String(20))
    axis: Mapped[str | None] = mapped_column(String(200))
    gearbox: Mapped[str | None] = mapped_column(String(200))
    """Of which axis and gearbox; of any where None."""
    verdict: Mapped[str | None] = mapped_column(String(20))
    label: Mapped[str | None] = mapped_column(String(100))
    """Of a state: any fault where None."""
    least_probability: Mapped[float | None]
    least_size_rad: Mapped[float | None]
    silent_days: Mapped[float | None]
    receivers: Mapped[list[object]]
    """Ids of receivers."""


class Alarm(Identified, Base):
    """A rule that holds of a gearbox, since when and until when; who was told once is not told again meanwhile."""

    __tablename__ = "alarms"

    rule_id: Mapped[str] = mapped_column(ForeignKey("alarm_rules.id", ondelete="CASCADE"))
    axis: Mapped[str] = mapped_column(String(200))
    gearbox: Mapped[str] = mapped_column(String(200))
    """Empty where it is not known."""
    began_at: Mapped[datetime] = mapped_column(default=now)
    ended_at: Mapped[datetime | None]

    __table_args__ = (
        Index(
            "uq_alarms_standing",
            "rule_id",
            "axis",
            "gearbox",
            unique=True,
            sqlite_where=text("ended_at IS NULL"),
            postgresql_where=text("ended_at IS NULL"),
        ),
    )


class Delivery(Base):
    """One message to one receiver: the outbox, written in the transaction of what is told."""

    __tablename__ = "deliveries"

    id: Mapped[str] = mapped_column(String(32), primary_key=True, default=new_id)
    """The id of the message too, by which a receiver knows one that comes twice."""
    receiver_id: Mapped[str] = mapped_column(String(32))
    receiver_name: Mapped[str] = mapped_column(String(200))
    message: Mapped[dict[str, object]]
    state: Mapped[str] = mapped_column(String(20), default="waiting")
    attempts: Mapped[int] = mapped_column(default=0)
    job_id: Mapped[str | None] = mapped_column(String(100))
    """The job that is to send it next: no other one may."""
    next_at: Mapped[datetime | None]
    sent_at: Mapped[datetime | None]
    error: Mapped[str | None] = mapped_column(Text)
    """Why the last attempt failed."""
    created_at: Mapped[datetime] = mapped_column(default=now)


class ApiKey(Identified, Created, Base):
    """A key is known by its SHA-256 alone."""

    __tablename__ = "api_keys"

    name: Mapped[str] = mapped_column(String(200))
    role: Mapped[str] = mapped_column(String(20))
    key_sha256: Mapped[str] = mapped_column(String(64), unique=True)
    last_used_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]


class BrowserSession(Base):
    """Somebody who signed in with a key; the token in the cookie is known by its SHA-256 alone."""

    __tablename__ = "sessions"

    token_sha256: Mapped[str] = mapped_column(String(64), primary_key=True)
    key_id: Mapped[str] = mapped_column(ForeignKey("api_keys.id"))
    created_at: Mapped[datetime] = mapped_column(default=now)
    expires_at: Mapped[datetime]


class AuditEntry(Base):
    """Who did what to which; triggers keep it append-only."""

    __tablename__ = "audit"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=True)
    at: Mapped[datetime] = mapped_column(default=now)
    actor: Mapped[str] = mapped_column(String(200))
    action: Mapped[str] = mapped_column(String(100))
    subject_kind: Mapped[str] = mapped_column(String(50))
    subject_id: Mapped[str] = mapped_column(String(200))
    before: Mapped[dict[str, object]]
    after: Mapped[dict[str, object]]
    request_id: Mapped[str | None] = mapped_column(String(100))

    __table_args__ = (Index("ix_audit_subject", "subject_kind", "subject_id", "id"),)


class Artifact(Created, Base):
    """Something learned, with the score that it earned; at most one of a kind is active."""

    __tablename__ = "artifacts"

    kind: Mapped[str] = mapped_column(String(100), primary_key=True)
    version: Mapped[int] = mapped_column(primary_key=True)
    content: Mapped[dict[str, object]]
    score: Mapped[float | None]
    score_detail: Mapped[dict[str, object]] = mapped_column(default=dict)
    active: Mapped[bool]

    __table_args__ = (
        Index(
            "uq_artifacts_active",
            "kind",
            unique=True,
            sqlite_where=text("active"),
            postgresql_where=text("active"),
        ),
    )


class IdempotencyRecord(Base):
    """The answer that was given to a POST with this Idempotency-Key."""

    __tablename__ = "idempotency"

    actor: Mapped[str] = mapped_column(String(200), primary_key=True)
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    request_sha256: Mapped[str] = mapped_column(String(64))
    status: Mapped[int | None]
    headers: Mapped[dict[str, object]] = mapped_column(default=dict)
    body: Mapped[bytes | None]
    created_at: Mapped[datetime] = mapped_column(default=now, index=True)


class LibraryCounter(Base):
    """One row; goes up in the transaction of every change that retrieval must see."""

    __tablename__ = "library_counter"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    value: Mapped[int]
