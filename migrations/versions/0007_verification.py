"""How a label was verified is one of a few words, beside what was written about it."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Column

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    for table in ("cases", "diagnoses"):
        op.add_column(table, Column("verification", sa.String(length=20), nullable=True))


def downgrade() -> None:
    for table in ("diagnoses", "cases"):
        op.drop_column(table, "verification")
