"""Leases: who fell silent loses what it had in hand, whatever its clock says, and writes nothing of it."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as some

from casebase.errors import LeaseLostError
from casebase.library import CaseLibrary
from casebase.store import leases
from casebase.store.leases import BEATS, Silence
from casebase.store.models import AxisRevision, WorkerLease


def axis(library: CaseLibrary) -> AxisRevision | None:
    with library.reading() as session:
        return session.get(AxisRevision, ("written", 1))


def write(library: CaseLibrary) -> None:
    with library.transaction("worker") as session:
        session.add(AxisRevision(name="written", revision=1, document={}, created_by="worker"))


def test_a_worker_writes_while_it_holds_its_lease_and_not_after(library: CaseLibrary) -> None:
    worker = CaseLibrary(library.engine, library.data_dir)
    with library.transaction("test") as session:
        worker.lease = leases.take(session, "w")
    with library.transaction("test") as session:
        assert leases.end(session, worker.lease)
        assert not leases.end(session, worker.lease)
    with pytest.raises(LeaseLostError, match="has ended"):
        write(worker)
    assert axis(library) is None
    with library.transaction("test") as session:
        worker.lease = leases.take(session, "w")
    write(worker)
    assert axis(library) is not None


def test_no_lease_is_ended_that_beat_in_between(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        lease = leases.take(session, "w")
        leases.beat(session, lease)
    with library.transaction("test") as session:
        assert not leases.end(session, lease, beats=0)
        assert leases.end(session, lease, beats=1)
        with pytest.raises(LeaseLostError):
            leases.beat(session, lease)


@pytest.mark.postgres
def test_nobody_waits_for_a_worker_that_stands_still_while_it_writes(
    postgres_database_url: str, tmp_path: Path
) -> None:
    """It holds its lease until it has written: others come back to it, and beat meanwhile."""
    library = CaseLibrary.open(tmp_path, postgres_database_url)
    with library.transaction("test") as session:
        still, other = leases.take(session, "still"), leases.take(session, "other")
    with library.transaction("still") as writing:
        leases.hold(writing, still)
        with library.transaction("other") as session:
            leases.beat(session, other)
            assert not leases.end(session, still, beats=0)
            leases.beat(session, still)
    library.close()


@given(
    lease_s=some.floats(1.0, 60.0),
    own_s=some.floats(1.0, 60.0),
    last=some.integers(1, 20),
    away=some.lists(some.booleans(), max_size=60),
)
def test_silence_is_over_after_a_lease_of_ones_own_beats(
    lease_s: float, own_s: float, last: int, away: list[bool]
) -> None:
    """Never while the other beats, never because one could not look oneself, and never later than the whole lease."""
    silence = Silence(own_s / BEATS)
    other = WorkerLease(id="other", beats=0, lease_s=lease_s)
    for number in range(1, last + 1):
        other.beats = number
        assert silence.after_beat([other]) == [] or lease_s <= silence.beat_s
    looked = 0
    for missed in away + [False] * 400:
        if missed:
            continue
        looked += 1
        if silence.after_beat([other]):
            break
    assert looked * silence.beat_s <= max(lease_s, silence.beat_s)
    assert looked * silence.beat_s > lease_s - 2 * silence.beat_s
