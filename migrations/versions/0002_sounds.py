"""Which recordings are of the same sound, and which were erased.

Recordings of equal samples are of one sound at once; the fingerprints are taken with the features, from the audio.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Column

from casebase.database import UtcDateTime

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

ADDED = ("sound_id", "sound", "erased_at", "erased_by")


def upgrade() -> None:
    op.add_column("recordings", Column("sound_id", sa.String(length=32), nullable=False, server_default=""))
    op.add_column("recordings", Column("sound", sa.LargeBinary(), nullable=True))
    op.add_column("recordings", Column("erased_at", UtcDateTime(), nullable=True))
    op.add_column("recordings", Column("erased_by", sa.String(length=200), nullable=True))
    op.execute(
        "UPDATE recordings SET sound_id = "
        "(SELECT min(first.id) FROM recordings AS first WHERE first.samples_sha256 = recordings.samples_sha256)"
    )
    op.create_index(op.f("ix_recordings_sound_id"), "recordings", ["sound_id"], unique=False)
    op.create_table(
        "sound_keys",
        Column("word", sa.Integer(), nullable=False),
        Column("recording_id", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(
            ["recording_id"],
            ["recordings.id"],
            name=op.f("fk_sound_keys_recording_id_recordings"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("word", "recording_id", name=op.f("pk_sound_keys")),
    )
    op.create_index(op.f("ix_sound_keys_recording_id"), "sound_keys", ["recording_id"], unique=False)


def downgrade() -> None:
    op.drop_table("sound_keys")
    op.drop_index(op.f("ix_recordings_sound_id"), "recordings")
    for name in reversed(ADDED):
        op.drop_column("recordings", name)
