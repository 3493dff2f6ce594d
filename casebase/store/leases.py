"""Leases of workers: whose results may still be written.

A worker holds one lease while it lives, and says so again and again: a beat. Another worker that beat through a whole
lease itself, and saw no beat of the first, ends that lease. Silence is so counted in beats of one's own: no clock is
compared with another, and while the database is away nobody beats, so that nobody falls silent.

What a worker writes is committed only while its lease is there, which is looked up, and held, in the transaction that
writes: its id is a fencing token. To end the lease of one that lives after all costs work, never a result.
"""

import math
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from casebase.errors import LeaseLostError
from casebase.store.models import WorkerLease

LEASE_S = 15.0
"""From the last beat to the end of a lease [s]: more than the 10 s without network or database that are survived."""
BEATS = 5
"""Beats in a lease: so many in a row may fail, each for a reason of its own."""


def take(session: Session, name: str, lease_s: float = LEASE_S) -> str:
    """Begin a lease and return its id, which no worker had before: the name, and a number that is drawn."""
    row = WorkerLease(id=f"{name}-{secrets.token_hex(4)}", beats=0, lease_s=lease_s)
    session.add(row)
    session.flush()
    return row.id


def beat(session: Session, lease: str) -> None:
    """Say that the holder of a lease lives. Raises LeaseLostError."""
    moved = session.execute(update(WorkerLease).where(WorkerLease.id == lease).values(beats=WorkerLease.beats + 1))
    if moved.rowcount == 0:  # type: ignore[attr-defined]
        raise lost(lease)


def beat_file(data_dir: Path) -> Path:
    """Return what a worker of this machine touches at each beat: its health check looks at it."""
    return data_dir / "workers" / socket.gethostname()


def hold(session: Session, lease: str) -> None:
    """See that a lease is there, and keep it from being ended before this transaction is. Raises LeaseLostError."""
    statement = select(WorkerLease.id).where(WorkerLease.id == lease)
    if session.scalar(statement.with_for_update(read=True, key_share=True)) is None:
        raise lost(lease)


def lost(lease: str) -> LeaseLostError:
    return LeaseLostError(f"the lease {lease} has ended: what its worker had in hand is another's, or will be")


def held(session: Session) -> Sequence[WorkerLease]:
    """Return all leases."""
    return session.scalars(select(WorkerLease).order_by(WorkerLease.id)).all()


def end(session: Session, lease: str, beats: int | None = None) -> bool:
    """End a lease and return whether it was there.

    Args:
        beats: end it only if its holder has not beaten since it had beaten so often, and nobody writes under it now.
    """
    statement = select(WorkerLease.id).where(WorkerLease.id == lease)
    if beats is not None:
        statement = statement.where(WorkerLease.beats == beats)
    if session.scalar(statement.with_for_update(skip_locked=beats is not None)) is None:
        return False
    session.execute(delete(WorkerLease).where(WorkerLease.id == lease))
    return True


@dataclass
class Silence:
    """How long other workers were silent, in beats of one's own."""

    beat_s: float
    _seen: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Beats of each when last looked, and how often in a row they were that many."""

    def after_beat(self, leases: Sequence[WorkerLease]) -> list[tuple[str, int]]:
        """Look at all leases after a beat of one's own: those that are over, with the beats that they stand at."""
        known = {lease.id: self._seen.get(lease.id, (-1, 0)) for lease in leases}
        self._seen = {
            lease.id: (lease.beats, known[lease.id][1] + 1 if known[lease.id][0] == lease.beats else 0)
            for lease in leases
        }
        return [
            (lease.id, lease.beats)
            for lease in leases
            if self._seen[lease.id][1] >= math.ceil(lease.lease_s / self.beat_s) - 1  # it may just have beaten before
        ]
