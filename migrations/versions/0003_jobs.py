"""Jobs as they are ordered, in the database of what orders them, and the leases of workers.

Jobs that an earlier version ordered are in the job engine alone; a worker adds them as it starts.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Column
from sqlalchemy.dialects.postgresql import JSONB

from casebase.database import UtcDateTime

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

JSON = sa.JSON().with_variant(JSONB(), "postgresql")
UNFINISHED = sa.text("finished_at IS NULL")


def upgrade() -> None:
    op.create_table(
        "jobs",
        Column("id", sa.String(length=100), nullable=False),
        Column("kind", sa.String(length=100), nullable=False),
        Column("parameters", JSON, nullable=False),
        Column("state", sa.String(length=20), nullable=False),
        Column("progress", JSON, nullable=False),
        Column("result", JSON, nullable=True),
        Column("error", sa.Text(), nullable=True),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("finished_at", UtcDateTime(), nullable=True),
        Column("submitted_by", sa.String(length=200), nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_jobs")),
    )
    op.create_index("ix_jobs_created", "jobs", ["created_at", "id"], unique=False)
    op.create_index(
        "ix_jobs_unfinished", "jobs", ["id"], unique=False, sqlite_where=UNFINISHED, postgresql_where=UNFINISHED
    )
    op.create_table(
        "workers",
        Column("id", sa.String(length=100), nullable=False),
        Column("beats", sa.Integer(), nullable=False),
        Column("lease_s", sa.Double(), nullable=False),
        Column("started_at", UtcDateTime(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_workers")),
    )


def downgrade() -> None:
    op.drop_table("workers")
    op.drop_table("jobs")
