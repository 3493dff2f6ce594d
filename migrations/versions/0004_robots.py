"""Robots, revision by revision, and investigations by the name of their robot."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Column
from sqlalchemy.dialects.postgresql import JSONB

from casebase.database import UtcDateTime

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

JSON = sa.JSON().with_variant(JSONB(), "postgresql")


def upgrade() -> None:
    op.create_table(
        "robots",
        Column("name", sa.String(length=200), nullable=False),
        Column("revision", sa.Integer(), nullable=False),
        Column("document", JSON, nullable=False),
        Column("urdf", sa.Text(), nullable=False),
        Column("note", sa.Text(), nullable=True),
        Column("investigation_id", sa.String(length=32), nullable=True),
        Column("created_at", UtcDateTime(), nullable=False),
        Column("created_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(
            ["investigation_id"], ["investigations.id"], name=op.f("fk_robots_investigation_id_investigations")
        ),
        sa.PrimaryKeyConstraint("name", "revision", name=op.f("pk_robots")),
    )
    op.add_column("investigations", Column("robot", sa.String(length=200), nullable=True))
    op.create_index(op.f("ix_investigations_robot"), "investigations", ["robot"], unique=False)
    _name_robots()


def _name_robots() -> None:
    """An investigation of no axis is of the robot that its description names."""
    table = sa.table(
        "investigations", sa.column("id"), sa.column("axis"), sa.column("robot"), sa.column("axis_document", JSON)
    )
    connection = op.get_bind()
    for identity, document in connection.execute(
        sa.select(table.c.id, table.c.axis_document).where(table.c.axis.is_(None))
    ).all():
        named = sa.update(table).where(table.c.id == identity).values(robot=str(document["name"]))
        connection.execute(named)


def downgrade() -> None:
    op.drop_index(op.f("ix_investigations_robot"), "investigations")
    op.drop_column("investigations", "robot")
    op.drop_table("robots")
