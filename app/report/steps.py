"""What a step of a person was, in words, and where it is taken back to."""

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy.orm import Session

from casebase.cycle.retain import RETAINED
from casebase.cycle.revise import CHANGED
from casebase.diagnoses import get_diagnosis
from casebase.steps import entries_of, stands
from casebase.store.models import AuditEntry, Case


@dataclass(frozen=True)
class StepTaken:
    """A step in words.

    Args:
        number: of its entry in the audit.
        words: one sentence.
        path: the page of what it was about, below the root.
        kept: id of the case that was kept by it.
        by_admin: whether only admins take such a step.
    """

    number: int
    words: str
    path: str
    kept: str | None
    by_admin: bool


def told(session: Session, number: int | None) -> StepTaken | None:
    """Return what a step was; None where no such step stands any more."""
    entries = entries_of(session, number) if number else []
    return described(session, entries) if entries and stands(session, entries[0]) else None


def described(session: Session, entries: Sequence[AuditEntry]) -> StepTaken:
    """Return in words what the entries of one step say, the newest first."""
    revised = next((one for one in entries if one.subject_kind == "diagnosis"), None)
    kept = next((one.subject_id for one in entries if one.action == RETAINED), None)
    changed = [one.subject_id for one in entries if one.action == CHANGED]
    words, path = [], "/library"
    if revised is not None:
        words.append(_revised(session, revised))
        path = f"/diagnoses/{revised.subject_id}"
    if kept is not None:
        case = session.get(Case, kept)
        words.append("kept as a case of the library" if revised else "A case was kept")
        if revised is None:
            path = f"/diagnoses/{case.diagnosis_id}" if case and case.diagnosis_id else f"/cases/{kept}"
    if changed:
        labels = dict.fromkeys(
            str(one.after["label"]) for one in entries if one.action == CHANGED and "label" in one.after
        )
        what = f"labelled {', '.join(labels)}" if labels else "changed"
        words.append(f"{len(changed)} {'case' if len(changed) == 1 else 'cases'} {what}")
        path = f"/cases/{changed[0]}" if len(changed) == 1 else "/library"
    return StepTaken(entries[0].id, f"{' and '.join(words)}.", path, kept, kept is not None or bool(changed))


def _revised(session: Session, entry: AuditEntry) -> str:
    name = get_diagnosis(session, entry.subject_id).recording.file_name
    state, label = entry.after["state"], entry.after["label"]
    return f"{name}: {state}{f' as {label}' if label else ''}"
