"""Every step of a person is taken back for real: rows, table and figures are those from before it."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.diagnoses import get_diagnosis, revise_diagnosis
from casebase.errors import ConflictError, DuplicateError, NotFoundError
from casebase.library import CaseLibrary
from casebase.reasoning.evaluation import evaluate
from casebase.search.case_table import CaseTable
from casebase.steps import last_step, newest_of, step_name, undo
from casebase.store.models import AuditEntry, Case, FeatureRow, StoredDiagnosis
from tests.casebase.made import VERSION, add_case
from tests.casebase.test_diagnoses import diagnose, features, fill

Work = Callable[[Session], object]
MOVING = {"version", "updated_at", "library_version"}
"""What counts changes, and so goes on when one is taken back."""


def state(library: CaseLibrary) -> dict[str, object]:
    """Return all that a step may change, byte for byte; cases that are in no search are no part of it."""
    with library.reading() as session:
        table = library.retrieve.table(session, VERSION)
        rows: dict[str, object] = {}
        for model in (Case, StoredDiagnosis, FeatureRow):
            columns = [column for column in model.__table__.columns if column.name not in MOVING]
            found = session.execute(select(*columns)).all()
            rows[model.__tablename__] = sorted(
                str([each.tobytes() if isinstance(each, np.ndarray) else each for each in row])
                for row in found
                if model is not Case or row.state != "retired"
            )
        return rows | {"table": contents(table)}


def contents(table: CaseTable) -> list[object]:
    return [*(column.tolist() for column in table.text), table.values.tobytes()]


def figures(library: CaseLibrary) -> dict[str, object]:
    """Return the library's own cross-validation, learned from what it is now."""
    with library.reading() as session:
        return evaluate(library.retrieve.table(session, VERSION)).to_document()


def step(library: CaseLibrary, work: Work) -> int:
    """Do something as one step and return its number."""
    name = step_name()
    with library.transaction("otto", name) as session:
        work(session)
        session.flush()
        found = newest_of(session, name)
    assert found is not None
    return found


def take_back(library: CaseLibrary, number: int) -> None:
    with library.transaction("otto") as session:
        undo(session, number)


def test_every_step_is_taken_back_and_all_is_as_before(library: CaseLibrary) -> None:
    """Verdict, other verdict, kept case, case with another label, label renamed: back in the opposite order."""
    fill(library, gearboxes=2)
    found = diagnose(library, features(np.random.default_rng(3), "notch"))
    kept: list[Case] = []

    def keep(session: Session) -> None:
        kept.append(library.retain.diagnosis(session, found.id, verification="opened"))

    def rename(session: Session) -> None:
        for identity in session.scalars(select(Case.id).where(Case.label == "notch")).all():
            library.revise.case(session, identity, {"label": "tooth_breakage"})

    works: tuple[Work, ...] = (
        lambda session: revise_diagnosis(session, found.id, "confirmed", verification="heard", note="at the elbow"),
        lambda session: revise_diagnosis(session, found.id, "corrected", label="play", verified_by="measured by hand"),
        keep,
        lambda session: library.revise.case(session, kept[0].id, {"label": "notch", "verification": "measured"}),
        rename,
    )
    states, before_all = [state(library)], figures(library)
    steps: list[int] = []
    for work in works:
        steps.append(step(library, work))
        states.append(state(library))
    assert all(one != other for one, other in pairwise(states)), "every step changes something"
    for number, before in zip(reversed(steps), reversed(states[:-1]), strict=True):
        take_back(library, number)
        assert state(library) == before
    assert figures(library) == before_all
    with library.reading() as session:
        assert last_step(session, [("diagnosis", found.id), ("case", kept[0].id)]) is None
        actions = session.scalars(select(AuditEntry.action).where(AuditEntry.subject_id == kept[0].id)).all()
        assert actions[0] == "case.retained", "nothing is lost from the audit"
        assert actions[-1] == "case.taken_back"


def test_a_step_is_taken_back_once_and_only_before_those_it_rests_on(library: CaseLibrary) -> None:
    fill(library, gearboxes=2)
    found = diagnose(library, features(np.random.default_rng(3), "notch"))
    first = step(library, lambda session: revise_diagnosis(session, found.id, "confirmed"))
    second = step(library, lambda session: revise_diagnosis(session, found.id, "rejected"))
    with pytest.raises(ConflictError, match="take the later one back first"):
        take_back(library, first)
    take_back(library, second)
    with pytest.raises(ConflictError, match="already"):
        take_back(library, second)
    take_back(library, first)
    with library.reading() as session:
        assert get_diagnosis(session, found.id).state == "open"
    with pytest.raises(NotFoundError):
        take_back(library, 10**6)


def test_what_was_kept_by_mistake_can_be_kept_again_but_what_was_retired_cannot(library: CaseLibrary) -> None:
    fill(library, gearboxes=2)
    found = diagnose(library, features(np.random.default_rng(3), "notch"))

    def keep(session: Session) -> None:
        library.retain.diagnosis(session, found.id, label="play")

    take_back(library, step(library, keep))
    with library.transaction("anna") as session:
        case = library.retain.diagnosis(session, found.id, label="notch", verification="opened")
        assert (case.label, case.state, case.verification) == ("notch", "confirmed", "opened")
        library.revise.retire(session, case.id)
    with library.transaction("anna") as session, pytest.raises(DuplicateError, match="retired"):
        library.retain.diagnosis(session, found.id, label="notch")


def test_a_case_that_was_added_with_its_recording_is_taken_back_too(library: CaseLibrary) -> None:
    fill(library, gearboxes=2)
    before = state(library)["table"]
    added = step(library, lambda session: add_case(library, session, [1.0] * 12, "play", seed=99))
    assert state(library)["table"] != before
    take_back(library, added)
    assert state(library)["table"] == before
