"""What was done to a gearbox has a kind: a note, a repair or an exchange, and an exchange names the new one."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Column

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("maintenance_marks", Column("kind", sa.String(length=20), server_default="note", nullable=False))
    op.add_column("maintenance_marks", Column("successor", sa.String(length=200), nullable=True))


def downgrade() -> None:
    op.drop_column("maintenance_marks", "successor")
    op.drop_column("maintenance_marks", "kind")
