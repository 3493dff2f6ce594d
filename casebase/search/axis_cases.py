"""What the library has of one axis: its cases by label and origin, and its newest recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from casebase.origins import MEASURED, is_measured
from casebase.store.models import Case, StoredDiagnosis, StoredRecording


@dataclass(frozen=True)
class LabelCases:
    """The cases of one label.

    Args:
        measured: those in use, and of them `unnamed` name no gearbox.
        gearboxes: named ones that the measured cases are of.
        simulated: those in use.
        set_aside: simulated ones in quarantine: they lie far from every measured case of the label.
    """

    measured: int = 0
    unnamed: int = 0
    gearboxes: frozenset[str] = frozenset()
    simulated: int = 0
    set_aside: int = 0


@dataclass(frozen=True)
class Taken:
    """A measured recording with its newest diagnosis, if it has one, and the label of its case, if it is one in use."""

    recording: StoredRecording
    diagnosis: StoredDiagnosis | None
    label: str | None


def cases_of_axes(session: Session) -> Mapping[str | None, Mapping[str, LabelCases]]:
    """Return the cases of every axis, and of none, by label: two statements, however many axes there are."""
    quarantined = Case.quarantine_reason.is_not(None)
    counted = (
        select(StoredRecording.axis, Case.label, func.count())
        .join(StoredRecording, StoredRecording.id == Case.recording_id)
        .where(Case.state == "confirmed")
        .group_by(StoredRecording.axis, Case.label)
    )
    measured = (
        counted.add_columns(StoredRecording.gearbox)
        .where(Case.origin == MEASURED, ~quarantined)
        .group_by(StoredRecording.gearbox)
    )
    simulated = counted.add_columns(quarantined).where(Case.origin != MEASURED).group_by(quarantined)
    found: dict[str | None, dict[str, LabelCases]] = {}
    for axis, label, count, gearbox in session.execute(measured):
        known = found.setdefault(axis, {}).get(label, LabelCases())
        found[axis][label] = LabelCases(
            known.measured + count,
            known.unnamed + (0 if gearbox else count),
            known.gearboxes | ({gearbox} if gearbox else set()),
        )
    for axis, label, count, aside in session.execute(simulated):
        known = found.setdefault(axis, {}).get(label, LabelCases())
        used, kept = known.simulated + (0 if aside else count), known.set_aside + (count if aside else 0)
        found[axis][label] = LabelCases(known.measured, known.unnamed, known.gearboxes, used, kept)
    return {axis: dict(sorted(labels.items())) for axis, labels in found.items()}


def gearboxes_known(session: Session) -> int:
    """Return how many named gearboxes the measured cases of the whole library are of."""
    statement = (
        select(func.count(StoredRecording.gearbox.distinct()))
        .join(Case, Case.recording_id == StoredRecording.id)
        .where(Case.origin == MEASURED, Case.state == "confirmed", Case.quarantine_reason.is_(None))
    )
    return session.scalars(statement).one()


def newest_recordings(session: Session, axis: str, most: int) -> Sequence[Taken]:
    """Return the newest measured recordings of an axis, the newest first."""
    statement = select(StoredRecording).where(StoredRecording.axis == axis, *is_measured(session))
    rows = session.scalars(statement.order_by(StoredRecording.id.desc()).limit(most)).all()
    ids = [row.id for row in rows]
    given = select(StoredDiagnosis).where(StoredDiagnosis.recording_id.in_(ids)).order_by(StoredDiagnosis.id)
    newest = {each.recording_id: each for each in session.scalars(given)}
    used = select(Case).where(Case.recording_id.in_(ids), Case.state == "confirmed")
    labels = {case.recording_id: case.label for case in session.scalars(used)}
    return [Taken(row, newest.get(row.id), labels.get(row.id)) for row in rows]
