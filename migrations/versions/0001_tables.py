"""The tables of a library."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Column
from sqlalchemy.dialects.postgresql import JSONB

from casebase.store.database import FloatVector, UtcDateTime

revision = "3"
down_revision = None

JSON = sa.JSON().with_variant(JSONB(), "postgresql")
ACTIVE, STANDING, UNFINISHED = (sa.text(words) for words in ("active", "ended_at IS NULL", "finished_at IS NULL"))
SQLITE_TRIGGERS = tuple(
    f"CREATE TRIGGER audit_no_{verb.lower()} BEFORE {verb} ON audit "
    "BEGIN SELECT RAISE(ABORT, 'the audit table is append-only'); END"
    for verb in ("UPDATE", "DELETE")
)
POSTGRESQL_TRIGGERS = (
    "CREATE FUNCTION audit_append_only() RETURNS trigger LANGUAGE plpgsql AS "
    "$$ BEGIN RAISE EXCEPTION 'the audit table is append-only'; END $$",
    "CREATE TRIGGER audit_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON audit "
    "FOR EACH STATEMENT EXECUTE FUNCTION audit_append_only()",
)


def upgrade() -> None:
    on_postgresql = op.get_bind().dialect.name == "postgresql"
    if on_postgresql:
        op.execute("CREATE EXTENSION IF NOT EXISTS vector")
    create_tables()
    op.execute("INSERT INTO library_counter (id, value) VALUES (1, 0)")
    for statement in POSTGRESQL_TRIGGERS if on_postgresql else SQLITE_TRIGGERS:
        op.execute(statement)


def create_tables() -> None:
    op.create_table(
        "alarm_receivers",
        Column("id", sa.String(length=32), nullable=False),
        Column("name", sa.String(length=200), nullable=False),
        Column("kind", sa.String(length=20), nullable=False),
        Column("address", sa.Text(), nullable=False),
        Column("secret", sa.String(length=100)),
        Column("quiet_from", sa.String(length=5)),
        Column("quiet_to", sa.String(length=5)),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarm_receivers")),
    )
    op.create_table(
        "alarm_rules",
        Column("id", sa.String(length=32), nullable=False),
        Column("name", sa.String(length=200), nullable=False),
        Column("kind", sa.String(length=20), nullable=False),
        Column("axis", sa.String(length=200)),
        Column("gearbox", sa.String(length=200)),
        Column("verdict", sa.String(length=20)),
        Column("label", sa.String(length=100)),
        Column("least_probability", sa.Double()),
        Column("least_size_rad", sa.Double()),
        Column("silent_days", sa.Double()),
        Column("receivers", JSON, nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarm_rules")),
    )
    op.create_table(
        "api_keys",
        Column("id", sa.String(length=32), nullable=False),
        Column("name", sa.String(length=200), nullable=False),
        Column("role", sa.String(length=20), nullable=False),
        Column("key_sha256", sa.String(length=64), nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        Column("last_used_at", UtcDateTime()),
        Column("revoked_at", UtcDateTime()),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_api_keys")),
        sa.UniqueConstraint("key_sha256", name=op.f("uq_api_keys_key_sha256")),
    )
    op.create_table(
        "artifacts",
        Column("kind", sa.String(length=100), nullable=False),
        Column("version", sa.Integer(), nullable=False),
        Column("content", JSON, nullable=False),
        Column("score", sa.Double()),
        Column("score_detail", JSON, nullable=False),
        Column("active", sa.Boolean(), nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.PrimaryKeyConstraint("kind", "version", name=op.f("pk_artifacts")),
    )
    op.create_index(
        "uq_artifacts_active", "artifacts", ["kind"], unique=True, sqlite_where=ACTIVE, postgresql_where=ACTIVE
    )
    op.create_table(
        "audit",
        Column("id", sa.Integer(), autoincrement=True, nullable=False),
        Column("at", UtcDateTime(), nullable=False),
        Column("actor", sa.String(length=200), nullable=False),
        Column("action", sa.String(length=100), nullable=False),
        Column("subject_kind", sa.String(length=50), nullable=False),
        Column("subject_id", sa.String(length=200), nullable=False),
        Column("before", JSON, nullable=False),
        Column("after", JSON, nullable=False),
        Column("request_id", sa.String(length=100)),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_audit")),
    )
    op.create_index("ix_audit_subject", "audit", ["subject_kind", "subject_id", "id"], unique=False)
    op.create_table(
        "deliveries",
        Column("id", sa.String(length=32), nullable=False),
        Column("receiver_id", sa.String(length=32), nullable=False),
        Column("receiver_name", sa.String(length=200), nullable=False),
        Column("message", JSON, nullable=False),
        Column("state", sa.String(length=20), nullable=False),
        Column("attempts", sa.Integer(), nullable=False),
        Column("job_id", sa.String(length=100)),
        Column("next_at", UtcDateTime()),
        Column("sent_at", UtcDateTime()),
        Column("error", sa.Text()),
        Column("created_at", UtcDateTime(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_deliveries")),
    )
    op.create_table(
        "extractors",
        Column("version", sa.String(length=100), nullable=False),
        Column("names", JSON, nullable=False),
        sa.PrimaryKeyConstraint("version", name=op.f("pk_extractors")),
    )
    op.create_table(
        "idempotency",
        Column("actor", sa.String(length=200), nullable=False),
        Column("key", sa.String(length=255), nullable=False),
        Column("request_sha256", sa.String(length=64), nullable=False),
        Column("status", sa.Integer()),
        Column("headers", JSON, nullable=False),
        Column("body", sa.LargeBinary()),
        Column("created_at", UtcDateTime(), nullable=False),
        sa.PrimaryKeyConstraint("actor", "key", name=op.f("pk_idempotency")),
    )
    op.create_index(op.f("ix_idempotency_created_at"), "idempotency", ["created_at"], unique=False)
    op.create_table(
        "investigations",
        Column("id", sa.String(length=32), nullable=False),
        Column("job_id", sa.String(length=100)),
        Column("state", sa.String(length=20), nullable=False),
        Column("axis", sa.String(length=200)),
        Column("robot", sa.String(length=200)),
        Column("axis_document", JSON, nullable=False),
        Column("inputs", JSON, nullable=False),
        Column("document", JSON),
        Column("report", sa.Text()),
        Column("error", sa.Text()),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("finished_at", UtcDateTime()),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_investigations")),
        sa.UniqueConstraint("job_id", name=op.f("uq_investigations_job_id")),
    )
    op.create_index(op.f("ix_investigations_axis"), "investigations", ["axis"], unique=False)
    op.create_index(op.f("ix_investigations_robot"), "investigations", ["robot"], unique=False)
    op.create_table(
        "jobs",
        Column("id", sa.String(length=100), nullable=False),
        Column("kind", sa.String(length=100), nullable=False),
        Column("parameters", JSON, nullable=False),
        Column("state", sa.String(length=20), nullable=False),
        Column("progress", JSON, nullable=False),
        Column("result", JSON),
        Column("error", sa.Text()),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("finished_at", UtcDateTime()),
        Column("submitted_by", sa.String(length=200)),
        Column("not_before", UtcDateTime()),
        Column("worker", sa.String(length=100)),
        Column("started_at", UtcDateTime()),
        Column("started_fraction", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_jobs")),
    )
    op.create_table(
        "job_steps",
        Column("job_id", sa.String(length=100), nullable=False),
        Column("number", sa.Integer(), autoincrement=False, nullable=False),
        Column("step", sa.String(length=20), nullable=False),
        Column("parameters", sa.JSON(), nullable=False),
        Column("lease", sa.String(length=100)),
        Column("lost", sa.Integer(), nullable=False),
        Column("fraction", sa.Double(), nullable=False),
        Column("done", sa.Boolean(), nullable=False),
        Column("result", sa.JSON()),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_job_steps_job_id_jobs")),
        sa.PrimaryKeyConstraint("job_id", "number", name=op.f("pk_job_steps")),
    )
    op.create_table(
        "job_events",
        Column("job_id", sa.String(length=100), nullable=False),
        Column("number", sa.Integer(), autoincrement=False, nullable=False),
        Column("progress", JSON, nullable=False),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_job_events_job_id_jobs")),
        sa.PrimaryKeyConstraint("job_id", "number", name=op.f("pk_job_events")),
    )
    op.create_index(
        "ix_jobs_unfinished", "jobs", ["id"], unique=False, sqlite_where=UNFINISHED, postgresql_where=UNFINISHED
    )
    op.create_table(
        "library_counter",
        Column("id", sa.Integer(), autoincrement=False, nullable=False),
        Column("value", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_library_counter")),
    )
    op.create_table(
        "maintenance_marks",
        Column("id", sa.String(length=32), nullable=False),
        Column("axis", sa.String(length=200), nullable=False),
        Column("gearbox", sa.String(length=200)),
        Column("at", UtcDateTime(), nullable=False),
        Column("kind", sa.String(length=20), nullable=False),
        Column("successor", sa.String(length=200)),
        Column("text", sa.Text(), nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_maintenance_marks")),
    )
    op.create_index("ix_maintenance_marks_axis", "maintenance_marks", ["axis", "at"], unique=False)
    op.create_table(
        "recordings",
        Column("id", sa.String(length=32), nullable=False),
        Column("fingerprint", sa.String(length=64), nullable=False),
        Column("samples_sha256", sa.String(length=64), nullable=False),
        Column("sound_id", sa.String(length=32), nullable=False),
        Column("sound", sa.LargeBinary(), nullable=False),
        Column("file_sha256", sa.String(length=64), nullable=False),
        Column("file_name", sa.String(length=255), nullable=False),
        Column("media_type", sa.String(length=100), nullable=False),
        Column("byte_count", sa.Integer(), nullable=False),
        Column("sample_rate_hz", sa.Double(), nullable=False),
        Column("channel", sa.Integer(), nullable=False),
        Column("channels", sa.Integer(), nullable=False),
        Column("duration_s", sa.Double(), nullable=False),
        Column("unit", sa.String(length=20), nullable=False),
        Column("usable", sa.Boolean(), nullable=False),
        Column("quality", JSON, nullable=False),
        Column("axis", sa.String(length=200)),
        Column("gearbox", sa.String(length=200)),
        Column("payload_kg_m2", sa.Double()),
        Column("speed_rad_s", sa.Double()),
        Column("recorded_at", UtcDateTime()),
        Column("description", JSON, nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        Column("erased_at", UtcDateTime()),
        Column("erased_by", sa.String(length=200)),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_recordings")),
        sa.UniqueConstraint("fingerprint", name=op.f("uq_recordings_fingerprint")),
    )
    op.create_index("ix_recordings_axis_gearbox", "recordings", ["axis", "gearbox", "id"], unique=False)
    op.create_index(op.f("ix_recordings_file_sha256"), "recordings", ["file_sha256"], unique=False)
    op.create_index(op.f("ix_recordings_samples_sha256"), "recordings", ["samples_sha256"], unique=False)
    op.create_index(op.f("ix_recordings_sound_id"), "recordings", ["sound_id"], unique=False)
    op.create_table(
        "workers",
        Column("id", sa.String(length=100), nullable=False),
        Column("beats", sa.Integer(), nullable=False),
        Column("lease_s", sa.Double(), nullable=False),
        Column("started_at", UtcDateTime(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_workers")),
    )
    op.create_table(
        "alarms",
        Column("id", sa.String(length=32), nullable=False),
        Column("rule_id", sa.String(length=32), nullable=False),
        Column("axis", sa.String(length=200), nullable=False),
        Column("gearbox", sa.String(length=200), nullable=False),
        Column("began_at", UtcDateTime(), nullable=False),
        Column("ended_at", UtcDateTime()),
        sa.ForeignKeyConstraint(
            ["rule_id"], ["alarm_rules.id"], name=op.f("fk_alarms_rule_id_alarm_rules"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarms")),
    )
    op.create_index(
        "uq_alarms_standing",
        "alarms",
        ["rule_id", "axis", "gearbox"],
        unique=True,
        sqlite_where=STANDING,
        postgresql_where=STANDING,
    )
    op.create_table(
        "axes",
        Column("name", sa.String(length=200), nullable=False),
        Column("revision", sa.Integer(), nullable=False),
        Column("document", JSON, nullable=False),
        Column("note", sa.Text()),
        Column("investigation_id", sa.String(length=32)),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(
            ["investigation_id"], ["investigations.id"], name=op.f("fk_axes_investigation_id_investigations")
        ),
        sa.PrimaryKeyConstraint("name", "revision", name=op.f("pk_axes")),
    )
    op.create_table(
        "diagnoses",
        Column("id", sa.String(length=32), nullable=False),
        Column("recording_id", sa.String(length=32), nullable=False),
        Column("verdict", sa.String(length=20), nullable=False),
        Column("label", sa.String(length=100)),
        Column("probability", sa.Double()),
        Column("document", JSON, nullable=False),
        Column("state", sa.String(length=20), nullable=False),
        Column("revised_label", sa.String(length=100)),
        Column("verified_by", sa.String(length=500)),
        Column("verification", sa.String(length=20)),
        Column("note", sa.Text()),
        Column("revised_by", sa.String(length=200)),
        Column("revised_at", UtcDateTime()),
        Column("version", sa.Integer(), nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(["recording_id"], ["recordings.id"], name=op.f("fk_diagnoses_recording_id_recordings")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_diagnoses")),
    )
    op.create_index("ix_diagnoses_recording_version", "diagnoses", ["recording_id", "version"], unique=False)
    op.create_index("ix_diagnoses_state", "diagnoses", ["state", "id"], unique=False)
    op.create_index("ix_diagnoses_verdict", "diagnoses", ["verdict", "id"], unique=False)
    op.create_table(
        "features",
        Column("recording_id", sa.String(length=32), nullable=False),
        Column("extractor_version", sa.String(length=100), nullable=False),
        Column("finite", FloatVector(), nullable=False),
        Column("missing", sa.LargeBinary(), nullable=False),
        Column("motion", JSON, nullable=False),
        Column("events", JSON, nullable=False),
        sa.ForeignKeyConstraint(
            ["extractor_version"], ["extractors.version"], name=op.f("fk_features_extractor_version_extractors")
        ),
        sa.ForeignKeyConstraint(
            ["recording_id"], ["recordings.id"], name=op.f("fk_features_recording_id_recordings"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("recording_id", "extractor_version", name=op.f("pk_features")),
    )
    op.create_index(op.f("ix_features_extractor_version"), "features", ["extractor_version"], unique=False)
    op.create_table(
        "robots",
        Column("name", sa.String(length=200), nullable=False),
        Column("revision", sa.Integer(), nullable=False),
        Column("document", JSON, nullable=False),
        Column("urdf", sa.Text(), nullable=False),
        Column("note", sa.Text()),
        Column("investigation_id", sa.String(length=32)),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(
            ["investigation_id"], ["investigations.id"], name=op.f("fk_robots_investigation_id_investigations")
        ),
        sa.PrimaryKeyConstraint("name", "revision", name=op.f("pk_robots")),
    )
    op.create_table(
        "sessions",
        Column("token_sha256", sa.String(length=64), nullable=False),
        Column("key_id", sa.String(length=32), nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("expires_at", UtcDateTime(), nullable=False),
        sa.ForeignKeyConstraint(["key_id"], ["api_keys.id"], name=op.f("fk_sessions_key_id_api_keys")),
        sa.PrimaryKeyConstraint("token_sha256", name=op.f("pk_sessions")),
    )
    op.create_table(
        "sound_keys",
        Column("word", sa.Integer(), autoincrement=False, nullable=False),
        Column("recording_id", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(
            ["recording_id"], ["recordings.id"], name=op.f("fk_sound_keys_recording_id_recordings"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("word", "recording_id", name=op.f("pk_sound_keys")),
    )
    op.create_index(op.f("ix_sound_keys_recording_id"), "sound_keys", ["recording_id"], unique=False)
    op.create_table(
        "cases",
        Column("id", sa.String(length=32), nullable=False),
        Column("key", sa.String(length=200)),
        Column("recording_id", sa.String(length=32), nullable=False),
        Column("diagnosis_id", sa.String(length=32)),
        Column("label", sa.String(length=100), nullable=False),
        Column("origin", sa.String(length=20), nullable=False),
        Column("state", sa.String(length=20), nullable=False),
        Column("mechanism", sa.String(length=100)),
        Column("location", sa.String(length=100)),
        Column("severity", sa.Double()),
        Column("parameters", JSON, nullable=False),
        Column("model_version", sa.String(length=100)),
        Column("batch", sa.String(length=100)),
        Column("labelled_by", sa.String(length=200), nullable=False),
        Column("verified_by", sa.String(length=500)),
        Column("verification", sa.String(length=20)),
        Column("quarantine_reason", sa.Text()),
        Column("note", sa.Text()),
        Column("version", sa.Integer(), nullable=False),
        Column("library_version", sa.Integer(), nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("updated_at", UtcDateTime(), nullable=False),
        sa.ForeignKeyConstraint(["diagnosis_id"], ["diagnoses.id"], name=op.f("fk_cases_diagnosis_id_diagnoses")),
        sa.ForeignKeyConstraint(["recording_id"], ["recordings.id"], name=op.f("fk_cases_recording_id_recordings")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_cases")),
        sa.UniqueConstraint("key", name=op.f("uq_cases_key")),
    )
    op.create_index(op.f("ix_cases_batch"), "cases", ["batch"], unique=False)
    op.create_index(op.f("ix_cases_diagnosis_id"), "cases", ["diagnosis_id"], unique=False)
    op.create_index("ix_cases_label_origin", "cases", ["label", "origin", "id"], unique=False)
    op.create_index(op.f("ix_cases_library_version"), "cases", ["library_version"], unique=False)
    op.create_index("ix_cases_recording_version", "cases", ["recording_id", "version"], unique=False)
    op.create_index("ix_cases_state", "cases", ["state", "id"], unique=False)
