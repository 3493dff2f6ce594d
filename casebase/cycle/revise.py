"""Revise: a case is corrected, retired and restored; every change is in the audit."""

from collections.abc import Mapping

from sqlalchemy.orm import Session

from casebase.cycle.retrieve import Retrieve
from casebase.description import check_choice, check_label, check_verification
from casebase.errors import ConflictError, InvalidRequestError, StaleVersionError
from casebase.store import audit
from casebase.store.counter import count_change
from casebase.store.models import CASE_STATES, Case, now

REVISABLE = (
    "label",
    "verified_by",
    "verification",
    "note",
    "mechanism",
    "location",
    "severity",
    "quarantine_reason",
    "state",
)

CHANGED = "case.revised"


class Revise:
    """Changes cases that are there."""

    def __init__(self, retrieve: Retrieve) -> None:
        self._retrieve = retrieve

    def case(
        self,
        session: Session,
        case_id: str,
        changes: Mapping[str, object],
        *,
        expected_version: int | None = None,
    ) -> Case:
        """Change label, verification, note, mechanism, location, severity, quarantine or state.

        Raises:
            StaleVersionError: if the case is not at the expected version.
            InvalidRequestError: if a field cannot be changed or its value is none of its values.
        """
        unknown = set(changes) - set(REVISABLE)
        if unknown:
            raise InvalidRequestError(f"cannot change {sorted(unknown)}; changeable are {', '.join(REVISABLE)}")
        if "label" in changes:
            check_label(str(changes["label"]))
        if "state" in changes:
            check_choice("state", str(changes["state"]), CASE_STATES)
        if changes.get("verification") is not None:
            check_verification(str(changes["verification"]))
        case = self._retrieve.case(session, case_id)
        if expected_version is not None and case.version != expected_version:
            raise StaleVersionError(
                f"case {case_id} is at version {case.version}, not {expected_version}; read it again"
            )
        before = {name: getattr(case, name) for name in changes if getattr(case, name) != changes[name]}
        if before:
            case.library_version = count_change(session)
            for name in before:
                setattr(case, name, changes[name])
            case.updated_at = now()
            session.flush()
            after = {name: changes[name] for name in before}
            audit.record(session, CHANGED, ("case", case.id), before=before, after=after)
        return case

    def retire(self, session: Session, case_id: str, *, expected_version: int | None = None) -> Case:
        """Take a case out of every search; it stays readable and can come back."""
        return self.case(session, case_id, {"state": "retired"}, expected_version=expected_version)

    def release(self, session: Session, case_id: str) -> Case:
        """Let a proposed case be searched; raises ConflictError if it is not proposed."""
        if self._retrieve.case(session, case_id).state != "proposed":
            raise ConflictError(f"case {case_id} is not proposed, so there is nothing to release")
        return self.case(session, case_id, {"state": "confirmed"})

    def restore(self, session: Session, case_id: str, *, expected_version: int | None = None) -> Case:
        """Bring a retired case back; raises ConflictError if it is not retired."""
        if self._retrieve.case(session, case_id).state != "retired":
            raise ConflictError(f"case {case_id} is not retired, so there is nothing to restore")
        return self.case(session, case_id, {"state": "confirmed"}, expected_version=expected_version)
