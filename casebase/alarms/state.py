"""What the rules look at: the fault that stands of a gearbox, and its newest diagnosis.

Whether a fault stands is asked of `casebase.gearbox_state`, as the page of the gearbox and the queue do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.gearbox_state import NamedFault, standing_fault
from casebase.gearboxes import OPEN, REJECTED, GearboxRecording, History, histories
from casebase.store.models import StoredDiagnosis


@dataclass(frozen=True)
class Reported:
    """The newest recording that names the fault that stands.

    Args:
        faults: labels of the faults that it names, each with its probability; where only the name is open, None with
            the probability of any, then those that are left. At the end those that were named before it, too.
        size_rad: of the first, at the driven gear [rad]; None where it cannot be said.
        calibrated: whether the probabilities were calibrated on gearboxes.
    """

    heard: GearboxRecording
    faults: tuple[tuple[str | None, float | None], ...]
    size_rad: float | None
    calibrated: bool


@dataclass(frozen=True)
class State:
    """What is known of a gearbox in service.

    Args:
        newest: the newest recording with a diagnosis that nobody rejected.
        verdict: of it; None where it was recorded before the last repair.
        fault: None where none stands.
    """

    axis: str | None
    gearbox: str | None
    newest: GearboxRecording
    verdict: str | None
    fault: Reported | None


def state_of(session: Session, axis: str | None, gearbox: str | None) -> State | None:
    """Return the state of a gearbox; None where it is not in service, or nothing was diagnosed of it."""
    found = histories(session, axis, gearbox)
    return next(iter(states_of(session, found[-1:])), None)


def states_of(session: Session, several: Sequence[History]) -> list[State]:
    """Return the states of those gearboxes that are in service and of which something was diagnosed.

    What was kept as a case and never diagnosed is no news: a library that is imported tells nobody.
    """
    diagnosed = [(history, _newest(history)) for history in several if history.until is None]
    serving = [(history, newest, standing_fault(history)) for history, newest in diagnosed if newest is not None]
    documents = _documents(session, [fault for _, _, fault in serving if fault is not None])
    states = []
    for history, newest, fault in serving:
        renewed = history.renewed
        verdict = newest.verdict if renewed is None or newest.at >= renewed else None
        told = None if fault is None else _told(fault.named[-1], documents.get(fault.named[-1].diagnosis_id or ""))
        if told is not None and fault is not None:
            known = {label for label, _ in told.faults}
            before = {
                str(one.label): one.probability if one.review == OPEN else 1.0
                for one in fault.named
                if not one.left and one.label not in known
            }
            told = replace(told, faults=(*told.faults, *before.items()))
        states.append(State(history.axis, history.gearbox, newest, verdict, told))
    return states


def _newest(history: History) -> GearboxRecording | None:
    said = (one for one in reversed(history.heard) if one.diagnosis_id is not None and one.review != REJECTED)
    return next(said, None)


def _documents(session: Session, faults: Sequence[NamedFault]) -> dict[str, StoredDiagnosis]:
    ids = [fault.named[-1].diagnosis_id for fault in faults]
    if not ids:
        return {}
    return {row.id: row for row in session.scalars(select(StoredDiagnosis).where(StoredDiagnosis.id.in_(ids)))}


def _told(heard: GearboxRecording, row: StoredDiagnosis | None) -> Reported:
    """Say what a recording names; what a person said of it counts, with what was measured of the same fault."""
    document = {} if row is None else row.document
    severity = document.get("severity")
    size_rad = None if severity is None else float(severity["value"])
    calibrated = document.get("provenance", {}).get("gearboxes", 0) > 1
    if row is None or row.revised_label is not None or heard.label != row.label:
        same = row is not None and heard.label == row.label
        return Reported(heard, ((str(heard.label), 1.0),), size_rad if same else None, calibrated)
    if heard.left:
        of = {str(each["label"]): each["probability"] for each in document["hypotheses"]}
        left = tuple((label, of.get(label)) for label in heard.left)
        return Reported(heard, ((None, document["fault"]["probability"]), *left), None, calibrated)
    faults = tuple((str(each["label"]), each["probability"]) for each in document["faults"])
    return Reported(heard, faults, size_rad, calibrated)
