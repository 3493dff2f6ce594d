"""Rules of alarms, their receivers, the alarms that stand, the outbox; jobs that begin later."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Column
from sqlalchemy.dialects.postgresql import JSONB

from casebase.database import UtcDateTime

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

JSON = sa.JSON().with_variant(JSONB(), "postgresql")
STANDING = sa.text("ended_at IS NULL")


def upgrade() -> None:
    op.add_column("jobs", Column("not_before", UtcDateTime(), nullable=True))
    op.create_table(
        "alarm_receivers",
        Column("id", sa.String(length=32), nullable=False),
        Column("name", sa.String(length=200), nullable=False),
        Column("kind", sa.String(length=20), nullable=False),
        Column("address", sa.Text(), nullable=False),
        Column("secret", sa.String(length=100), nullable=True),
        Column("quiet_from", sa.String(length=5), nullable=True),
        Column("quiet_to", sa.String(length=5), nullable=True),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarm_receivers")),
    )
    op.create_table(
        "alarm_rules",
        Column("id", sa.String(length=32), nullable=False),
        Column("name", sa.String(length=200), nullable=False),
        Column("kind", sa.String(length=20), nullable=False),
        Column("axis", sa.String(length=200), nullable=True),
        Column("gearbox", sa.String(length=200), nullable=True),
        Column("verdict", sa.String(length=20), nullable=True),
        Column("label", sa.String(length=100), nullable=True),
        Column("least_probability", sa.Double(), nullable=True),
        Column("least_size_rad", sa.Double(), nullable=True),
        Column("silent_days", sa.Double(), nullable=True),
        Column("receivers", JSON, nullable=False),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarm_rules")),
    )
    op.create_table(
        "alarms",
        Column("id", sa.String(length=32), nullable=False),
        Column("rule_id", sa.String(length=32), nullable=False),
        Column("axis", sa.String(length=200), nullable=False),
        Column("gearbox", sa.String(length=200), nullable=False),
        Column("began_at", UtcDateTime(), nullable=False),
        Column("ended_at", UtcDateTime(), nullable=True),
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
        "deliveries",
        Column("id", sa.String(length=32), nullable=False),
        Column("receiver_id", sa.String(length=32), nullable=False),
        Column("receiver_name", sa.String(length=200), nullable=False),
        Column("message", JSON, nullable=False),
        Column("state", sa.String(length=20), nullable=False),
        Column("attempts", sa.Integer(), nullable=False),
        Column("job_id", sa.String(length=100), nullable=True),
        Column("next_at", UtcDateTime(), nullable=True),
        Column("sent_at", UtcDateTime(), nullable=True),
        Column("error", sa.Text(), nullable=True),
        Column("created_at", UtcDateTime(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_deliveries")),
    )


def downgrade() -> None:
    for table in ("deliveries", "alarms", "alarm_rules", "alarm_receivers"):
        op.drop_table(table)
    op.drop_column("jobs", "not_before")
