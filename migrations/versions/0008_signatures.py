"""Whether anything changed of a gearbox is read from indexes alone: a document is long, and lies before the version."""

from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    for table in ("cases", "diagnoses"):
        op.create_index(f"ix_{table}_recording_version", table, ["recording_id", "version"])
        op.drop_index(f"ix_{table}_recording_id", table)


def downgrade() -> None:
    for table in ("diagnoses", "cases"):
        op.create_index(f"ix_{table}_recording_id", table, ["recording_id"])
        op.drop_index(f"ix_{table}_recording_version", table)
