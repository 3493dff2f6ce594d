"""What needs a person: open diagnoses, in the order in which an answer teaches the library most.

Asked first is where the library knows least: a recording unlike every known kind, then the least probable label
(uncertainty sampling). That no fault is heard needs nobody, nor a sound that is a case or was answered already.

Source: Lewis and Gale, A sequential algorithm for training text classifiers, SIGIR (1994), for asking where the most
probable label is least probable.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import Select, and_, exists, func, or_, select
from sqlalchemy.orm import Session, aliased

from casebase.labels import BASELINES
from casebase.origins import is_measured
from casebase.store.models import Case, StoredDiagnosis, StoredRecording

UNKNOWN, UNDECIDED, FAULT = "not_in_library", "ambiguous", "diagnosed"
Reason = Literal["not_in_library", "ambiguous", "fault"]


@dataclass(frozen=True)
class QueuePosition:
    """Where a diagnosis stands in the queue.

    Args:
        number: from 1; None if it is not in the queue.
        count: how many are in the queue.
        before, after: ids of its neighbours; of one that is not in the queue none and the first.
    """

    number: int | None
    count: int
    before: str | None
    after: str | None


def waiting(session: Session, naming: Collection[str], *, faults_first: bool = False) -> dict[str, str]:
    """Return the diagnoses that need a person, by id with their verdict, the most informative first.

    Of equals the newest stands first.

    Args:
        naming: ids of the recordings that name a fault that stands; see `casebase.gearbox_state`. A fault that was
            outweighed, or ended with a repair or an exchange, waits for nobody.
        faults_first: likely faults, then what is undecided, then what is unknown, for whoever acts on them.
    """
    order = ((StoredDiagnosis.verdict == UNKNOWN).desc(), StoredDiagnosis.probability, StoredDiagnosis.id.desc())
    of_gearbox = or_(StoredRecording.axis.is_not(None), StoredRecording.gearbox.is_not(None))
    columns = (StoredDiagnosis.id, StoredDiagnosis.verdict, StoredDiagnosis.recording_id, of_gearbox)
    rows = [
        (verdict == FAULT or recording_id in naming, identity, verdict)
        for identity, verdict, recording_id, known in session.execute(_open(session, *columns).order_by(*order))
        if verdict != FAULT or not known or recording_id in naming
    ]
    if faults_first:
        rows.sort(key=lambda row: (not row[0], row[2] == UNKNOWN))
    return {identity: verdict for _, identity, verdict in rows}


def proposed(session: Session) -> int:
    """Return how many cases wait to be released."""
    return session.scalar(select(func.count()).where(Case.state == "proposed")) or 0


def _open(session: Session, *columns: Any) -> Select[Any]:
    """Select columns of the diagnoses that need a person."""
    other, twin = aliased(StoredDiagnosis), aliased(StoredRecording)
    answered = and_(
        other.recording_id == StoredDiagnosis.recording_id,
        or_(other.id > StoredDiagnosis.id, other.state.in_(("confirmed", "corrected"))),
    )
    sounds = select(twin.sound_id).join(Case, Case.recording_id == twin.id).where(Case.state != "retired")
    fault = and_(StoredDiagnosis.verdict == FAULT, StoredDiagnosis.label.not_in(BASELINES))
    unknown = StoredDiagnosis.verdict == UNKNOWN
    return (
        select(*columns)
        .join(StoredRecording, StoredRecording.id == StoredDiagnosis.recording_id)
        .where(
            StoredDiagnosis.state == "open",
            or_(unknown, StoredDiagnosis.verdict == UNDECIDED, fault),
            ~exists().where(answered),
            StoredRecording.sound_id.not_in(sounds),  # once for all; asked for each row SQLite reads every case
            *is_measured(session),
        )
    )


def reason_of(verdict: str) -> Reason:
    """Return why a diagnosis with this verdict needs a person; one that names no fault is not in the queue."""
    reasons: dict[str, Reason] = {UNKNOWN: "not_in_library", UNDECIDED: "ambiguous"}
    return reasons.get(verdict, "fault")


def place_in(ids: Sequence[str], diagnosis_id: str) -> QueuePosition:
    """Return where a diagnosis stands.

    >>> place_in(["a", "b", "c"], "b")
    QueuePosition(number=2, count=3, before='a', after='c')
    >>> place_in(["a", "b"], "z")
    QueuePosition(number=None, count=2, before=None, after='a')
    """
    if diagnosis_id not in ids:
        return QueuePosition(None, len(ids), None, ids[0] if ids else None)
    at = ids.index(diagnosis_id)
    return QueuePosition(at + 1, len(ids), ids[at - 1] if at else None, ids[at + 1] if at + 1 < len(ids) else None)
