"""Histories of gearboxes end at an exchange, baselines at a repair; the state follows from what was said."""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.report.standing_words import named_words, why
from casebase.alarms.state import state_of
from casebase.axes import axis_names
from casebase.diagnoses import revise_diagnosis
from casebase.gearbox_state import Reason, Standing, State, fault_before, standing
from casebase.gearboxes import histories, signatures
from casebase.library import CaseLibrary
from casebase.origins import measured
from casebase.reasoning.trend import FOLLOWED, Trend, trend_of
from casebase.store.models import Case, MaintenanceMark, StoredRecording
from tests.casebase.kept import keep

START = datetime(2026, 1, 1, tzinfo=UTC)
MONTH = timedelta(days=30)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CaseLibrary]:
    opened = CaseLibrary.open(tmp_path_factory.mktemp("gearboxes") / "data")
    yield opened
    opened.close()


@pytest.fixture
def session(kept: CaseLibrary) -> Iterator[Session]:
    with kept.transaction("test") as found:
        yield found


def day(number: float) -> datetime:
    return START + timedelta(days=number)


def heard(session: Session, axis: str, *labels: str | None, gearbox: str = "g") -> None:
    """A recording a day, with this label or, where it is a verdict, without one."""
    for number, label in enumerate(labels):
        verdict = label if label in ("ambiguous", "not_in_library", "unusable") else "diagnosed"
        keep(
            session, axis, gearbox, day(number), {}, None if verdict == label else label, verdict=verdict or "diagnosed"
        )


def mark(session: Session, axis: str, at: float, kind: str, successor: str | None = None) -> None:
    row = MaintenanceMark(axis=axis, gearbox="g", at=day(at), kind=kind, text="done", created_by="test")
    row.successor = successor
    session.add(row)
    session.flush()


def state(session: Session, axis: str, gearbox: str = "g", now: float = 10) -> Standing:
    return standing(histories(session, axis, gearbox)[-1], None, day(now), MONTH)


@pytest.mark.parametrize(
    ("labels", "wanted", "reason", "since"),
    [
        (("normal", "normal"), State.GOOD, Reason.SOUNDS_GOOD, 0),
        (("notch", "normal", "normal"), State.WATCH, Reason.NAMED_BEFORE, 0),
        (("play", "normal", "play"), State.FAULT_LIKELY, Reason.NAMED, 0),
        (("normal", "normal", "play", "ambiguous"), State.WATCH, Reason.NAMED_BEFORE, 2),
        (("notch", "normal", "normal", "normal"), State.GOOD, Reason.SOUNDS_GOOD, 1),
        (("notch", "notch", "normal", "normal", "normal"), State.WATCH, Reason.NAMED_BEFORE, 0),
        (("notch", "normal", "normal", "normal", "play"), State.FAULT_LIKELY, Reason.NAMED, 4),
        (("normal", "play", "play"), State.FAULT_LIKELY, Reason.NAMED, 1),
        (("play", "unusable"), State.FAULT_LIKELY, Reason.NAMED, 0),
        (("normal", "ambiguous", "ambiguous"), State.CANNOT_SAY, Reason.UNDECIDED, 1),
        (("normal", "not_in_library"), State.CANNOT_SAY, Reason.UNLIKE, 1),
        (("unusable",), State.CANNOT_SAY, Reason.UNUSABLE, 0),
        ((None,), State.CANNOT_SAY, Reason.NOT_DIAGNOSED, 0),
    ],
)
def test_the_state_and_since_when(
    session: Session, labels: tuple[str | None, ...], wanted: State, reason: Reason, since: float
) -> None:
    axis = f"said {labels}"
    heard(session, axis, *labels)
    found = state(session, axis)
    assert (found.state, found.reason, found.since) == (wanted, reason, day(since))


def taught(session: Session, axis: str, **times: datetime | None) -> None:
    """Labelled recordings that were never diagnosed, with when they were recorded."""
    for label, at in times.items():
        row = keep(session, axis, "g", at, {})
        told = {"label": label, "origin": "measured", "state": "confirmed", "labelled_by": "ann", "library_version": 1}
        session.add(Case(recording_id=row.id, **told))
    session.flush()


def test_labels_of_unknown_time_or_of_one_day_are_no_state_of_today(session: Session) -> None:
    taught(session, "untimed", normal=None, notch=None, play=None)
    taught(session, "one day", notch=day(1), normal=day(1.1))
    taught(session, "days", notch=day(1), normal=day(3), play=day(5))
    found = [state(session, axis, now=9) for axis in ("untimed", "one day", "days")]
    assert [(each.state, each.since) for each in found] == [
        (State.CANNOT_SAY, None),
        (State.WATCH, day(1)),
        (State.FAULT_LIKELY, day(1)),
    ]
    assert [set(each.labels) for each in found] == [{"normal", "notch", "play"}, {"notch", "normal"}, set()]
    assert "ann" in why(found[2], "UTC")
    trends = [trend_of(session, histories(session, axis, "g")[-1]) for axis in ("untimed", "days")]
    assert [each is not None for each in trends] == [False, True]


def test_cases_taken_back_leave_no_gearbox_and_no_axis(session: Session) -> None:
    taught(session, "ghost", notch=None)
    session.scalars(select(Case).join(Case.recording).where(StoredRecording.axis == "ghost")).one().state = "retired"
    session.flush()
    assert histories(session, "ghost", "g") == []
    assert "ghost" not in axis_names(session)


def test_every_fault_that_was_named_is_said(session: Session) -> None:
    """By the page of the gearbox, the queue and the alarms."""
    heard(session, "both named", "notch", "normal", "play")
    words = why(state(session, "both named"), "UTC")
    assert "backlash" in words
    assert "tooth damage" in words.lower()
    told, fault = state_of(session, "both named", "g"), state(session, "both named").fault
    assert told and told.fault and fault  # noqa: PT018
    assert [label for label, _ in told.fault.faults] == ["play", "notch"]
    assert "2 recordings" not in named_words(fault, "UTC")


def test_silence_is_told_unless_there_is_worse(session: Session) -> None:
    heard(session, "quiet", "normal")
    heard(session, "broken", "play")
    assert state(session, "quiet", now=31).state is State.NOT_HEARD
    assert state(session, "quiet", now=30).state is State.GOOD
    assert state(session, "broken", now=100).state is State.FAULT_LIKELY


def test_what_a_person_says_counts(session: Session) -> None:
    heard(session, "reviewed", "normal", "play")
    newest = histories(session, "reviewed", "g")[-1].heard[-1]
    assert newest.diagnosis_id is not None
    revise_diagnosis(session, newest.diagnosis_id, "rejected")
    assert state(session, "reviewed").state is State.GOOD
    revise_diagnosis(session, newest.diagnosis_id, "corrected", label="notch")
    found = state(session, "reviewed")
    assert (found.state, found.reason, found.recording and found.recording.label) == (
        State.FAULT_LIKELY,
        Reason.FOUND,
        "notch",
    )


def test_a_named_fault_and_a_changed_sound_are_likely_a_fault(session: Session) -> None:
    """Two signs that know nothing of each other weigh more than one recording that names none."""
    heard(session, "both", "normal", "play", "normal")
    history = histories(session, "both", "g")[-1]
    rises = np.repeat([[0.0], [9.0]], 20, axis=0) + np.random.default_rng(1).standard_normal((40, len(FOLLOWED)))
    trend = Trend.of([history.heard[-1]] * 40, rises)
    found = standing(history, trend, day(10), MONTH)
    assert trend.changed
    assert (found.state, found.reason, found.since) == (State.FAULT_LIKELY, Reason.NAMED_BEFORE, day(1))


def test_a_fault_stood_before_a_recording_unless_a_repair_lies_between(session: Session) -> None:
    heard(session, "then", "normal", "play", "normal", "normal")
    mark(session, "then", 2.5, "repair")
    (history,) = histories(session, "then", "g")
    stood = [fault_before(history, one) for one in history.heard]
    assert [each is not None for each in stood] == [False, False, True, False]


def test_an_exchange_ends_the_history_and_begins_that_of_the_next(session: Session) -> None:
    heard(session, "exchanged", "normal", "play", "normal")
    mark(session, "exchanged", 1.5, "exchange")
    old, new = histories(session, "exchanged", "g")
    assert [one.at for one in old.heard] == [day(0), day(1)]
    assert [one.at for one in new.heard] == [day(2)]
    assert (old.until, new.since, new.until) == (day(1.5), day(1.5), None)
    assert state(session, "exchanged").state is State.GOOD


def test_an_exchange_for_one_of_another_name(session: Session) -> None:
    heard(session, "renamed", "play")
    mark(session, "renamed", 1.5, "exchange", "h")
    (old,), (new,) = histories(session, "renamed", "g"), histories(session, "renamed", "h")
    assert (old.until, new.since, new.heard) == (day(1.5), day(1.5), ())
    assert ("renamed", "h") in signatures(session)
    found = state(session, "renamed", "h")
    assert (found.state, found.reason, found.since) == (State.CANNOT_SAY, Reason.NEVER_HEARD, day(1.5))


def test_a_moved_microphone_begins_a_new_trend_and_clears_no_fault(session: Session) -> None:
    heard(session, "heard elsewhere", "play", "normal", "normal")
    mark(session, "heard elsewhere", 0.5, "microphone")
    (history,) = histories(session, "heard elsewhere", "g")
    assert (len(history.heard), len(history.since_renewed), len(history.comparable)) == (3, 3, 2)
    assert state(session, "heard elsewhere").reason is Reason.NAMED_BEFORE


def test_what_was_simulated_was_not_heard(library: CaseLibrary) -> None:
    """Neither the recording of a simulated case nor the same sound in another container, as `measured` has it."""
    with library.transaction("test") as session:
        told = {"label": "play", "origin": "simulated", "state": "confirmed", "labelled_by": "test"}
        simulated = keep(session, "made", "g", day(0), {}, "play")
        session.add(Case(recording_id=simulated.id, library_version=1, **told))
        again = keep(session, "made", "g", day(1), {}, "play")
        again.sound_id = simulated.sound_id
        heard(session, "made", "normal")
        session.flush()
        kept = [one.recording_id for one in histories(session, "made", "g")[-1].heard]
        rows = session.scalars(select(StoredRecording).where(StoredRecording.axis == "made")).all()
        assert kept == [row.id for row in measured(session, rows)]
        assert len(kept) == 1


def test_whatever_changes_a_gearbox_changes_its_signature_alone(library: CaseLibrary) -> None:
    """On either database."""

    def reject(session: Session) -> None:
        newest = histories(session, "signed", "g")[-1].heard[-1]
        revise_diagnosis(session, str(newest.diagnosis_id), "rejected")

    changes: tuple[Callable[[Session], object], ...] = (
        lambda session: heard(session, "signed", "normal"),
        lambda session: mark(session, "signed", 5, "note"),
        reject,
    )
    with library.transaction("test") as session:
        for axis in ("signed", "other"):
            heard(session, axis, "play", "play", "play")
        before = signatures(session)
        for change in changes:
            change(session)
            session.flush()
            after = signatures(session)
            assert {place for place in after if after[place] != before.get(place)} == {("signed", "g")}
            assert signatures(session, "signed") == signatures(session, "signed", "g")
            assert signatures(session, "signed") == {place: after[place] for place in after if place[0] == "signed"}
            before = after
        assert trend_of(session, histories(session, "signed", "g")[-1]) is not None


def test_a_gearbox_changes_when_its_sound_turns_out_to_be_simulated_elsewhere(library: CaseLibrary) -> None:
    """It is then not heard any more, though nothing was added to it."""
    with library.transaction("test") as session:
        here, there = (keep(session, axis, "g", day(0), {}, "play") for axis in ("here", "there"))
        there.sound_id = here.sound_id
        session.flush()
        before = signatures(session)
        told = {"label": "play", "origin": "simulated", "state": "confirmed", "labelled_by": "test"}
        session.add(Case(recording_id=there.id, library_version=1, **told))
        session.flush()
        assert histories(session, "here", "g") == []
        assert signatures(session)["here", "g"] != before["here", "g"]
