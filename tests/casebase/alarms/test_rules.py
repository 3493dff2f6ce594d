"""Rules over states and silence: told once when they begin to hold, by recording time, with what a person said."""

from datetime import datetime, timedelta

import pytest
from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.alarms import outbox, rules
from casebase.alarms.rules import Condition
from casebase.alarms.state import state_of
from casebase.diagnoses import revise_diagnosis
from casebase.errors import ConflictError, InvalidRequestError
from casebase.gearboxes import Place, histories
from casebase.library import CaseLibrary
from casebase.store.models import (
    AuditEntry,
    Delivery,
    MaintenanceMark,
    StoredDiagnosis,
    StoredJob,
    StoredRecording,
    now,
)
from tests.casebase.kept import keep


def diagnosed(
    session: Session,
    *labels: str,
    probability: float = 0.95,
    size_rad: float | None = None,
    recorded_at: datetime | None = None,
    gearbox: str | None = "g1",
) -> str:
    """Store a diagnosis of the axis `bench` as it comes in, and hold the rules against it; return its id."""
    recording = keep(session, "bench" if gearbox else None, gearbox, recorded_at, {}, labels[0])
    row = session.get_one(StoredDiagnosis, recording.id)
    row.probability = probability
    faults = [{"label": label, "probability": probability} for label in labels if label != "normal"]
    row.document = {"faults": faults, "severity": None if size_rad is None else {"value": size_rad}}
    session.flush()
    rules.review(session, recording.axis, recording.gearbox)
    return row.id


def settled(session: Session, changed: dict[Place, datetime] | None = None) -> list[Place]:
    """What the alarm worker finds of the gearboxes g1 and g2, and settles."""
    serving = [each for name in ("g1", "g2") for each in histories(session, "bench", name)[-1:]]
    places = rules.unsettled(session, serving, changed or {})
    for axis, gearbox in places:
        rules.review(session, axis, gearbox, changed or {})
    return places


def told(session: Session) -> list[object]:
    """The rules of the messages in the outbox, oldest first."""
    return [row.message["rule"] for row in session.scalars(select(Delivery).order_by(Delivery.id))]


def ruled(session: Session, name: str = "rule", kind: str = "state", **condition: object) -> str:
    team = outbox.add_receiver(session, "team", "email", "team@example.com")
    return rules.add_rule(session, name, Condition(kind, **condition), [team.id]).id  # type: ignore[arg-type]


def test_a_state_is_told_once_until_it_was_over(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        ruled(session)
        for label in ("normal", "notch", "notch", "normal", "normal", "normal", "normal", "play"):
            diagnosed(session, label)
        assert told(session) == ["rule", "rule"]
        assert [(alarm.axis, alarm.gearbox) for alarm in rules.standing(session)] == [("bench", "g1")]
        delivery = session.scalars(select(Delivery).order_by(Delivery.id)).first()
        assert delivery is not None
        assert delivery.message["label"] == "notch"
        jobs = {row.id: row.parameters for row in session.scalars(select(StoredJob))}
        assert jobs[delivery.job_id or ""] == {"delivery": delivery.id, "job": delivery.job_id}


@pytest.mark.parametrize(
    ("condition", "tells"),
    [
        ({"label": "play"}, True),
        ({"label": "crack"}, False),
        ({"least_probability": 0.9}, False),
        ({"least_probability": 0.8}, True),
        ({"label": "notch", "least_size_rad": 1e-3}, True),
        ({"label": "notch", "least_size_rad": 3e-3}, False),
        ({"label": "play", "least_size_rad": 1e-3}, False),  # the size is that of the first fault
        ({"verdict": "not_in_library"}, False),
        ({"axis": "bench", "gearbox": "g1"}, True),
        ({"gearbox": "g2"}, False),
        ({"axis": "other"}, False),
    ],
)
def test_what_a_rule_asks(sqlite_library: CaseLibrary, condition: dict[str, object], tells: bool) -> None:
    with sqlite_library.transaction("test") as session:
        ruled(session, **condition)
        diagnosed(session, "notch", "play", probability=0.85, size_rad=2e-3)
        assert bool(told(session)) == tells


def test_a_recording_counts_for_when_it_was_taken_however_late_it_comes(sqlite_library: CaseLibrary) -> None:
    with sqlite_library.transaction("test") as session:
        ruled(session)
        newest = diagnosed(session, "normal", recorded_at=now() - timedelta(days=1))
        diagnosed(session, "notch", recorded_at=now() - timedelta(days=2))
        state = state_of(session, "bench", "g1")
        assert state is not None
        assert state.newest.diagnosis_id == newest
        assert state.fault is not None
        assert told(session) == ["rule"], "a worn gear does not heal"
        for _ in range(3):
            diagnosed(session, "normal", recorded_at=now() - timedelta(days=3))
        assert len(rules.standing(session)) == 1, "what sounded good before the fault does not outweigh it"
        for _ in range(2):
            diagnosed(session, "normal", recorded_at=now() + timedelta(days=300))  # a clock that is ahead
        assert rules.standing(session) == []
        diagnosed(session, "notch")
        assert told(session) == ["rule", "rule"]


def test_what_a_person_says_counts(sqlite_library: CaseLibrary) -> None:
    with sqlite_library.transaction("test") as session:
        ruled(session, label="notch", least_probability=0.9)
        identity = diagnosed(session, "normal")
        revise_diagnosis(session, identity, "corrected", label="notch")
        assert told(session) == ["rule"]
        revise_diagnosis(session, identity, "rejected")
        assert rules.standing(session) == []


def test_silence_is_told_once_and_ends_when_it_is_heard(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        ruled(session, kind="silence", silent_days=3.0)
        for gearbox, days in (("g1", 5), ("g2", 2)):
            diagnosed(session, "normal", gearbox=gearbox, recorded_at=now() - timedelta(days=days, hours=1))
        assert [alarm.gearbox for alarm in rules.standing(session)] == ["g1"]
        for row in session.scalars(select(StoredRecording).where(StoredRecording.gearbox == "g2")):
            row.recorded_at = now() - timedelta(days=4)
        session.flush()
        assert settled(session) == [("bench", "g2")]
        assert settled(session) == []
        assert told(session) == ["rule", "rule"]
        diagnosed(session, "normal", gearbox="g1")
        assert [alarm.gearbox for alarm in rules.standing(session)] == ["g2"]


def test_a_change_is_told_once_and_ends_with_the_trend(library: CaseLibrary) -> None:
    here: Place = ("bench", "g1")
    there: Place = ("bench", None)
    with library.transaction("test") as session:
        ruled(session, kind="change")
        for changed in ({}, {here: now()}, {here: now(), there: now()}):
            settled(session, changed)
        assert [row.message["gearbox"] for row in session.scalars(select(Delivery).order_by(Delivery.id))] == [
            "g1",
            None,
        ]
        diagnosed(session, "notch")  # which a rule of change does not look at
        assert len(told(session)) == 2
        settled(session)
        assert rules.standing(session) == []


def test_a_gearbox_that_was_exchanged_is_not_missed(sqlite_library: CaseLibrary) -> None:
    with sqlite_library.transaction("test") as session:
        for gearbox in ("g1", "g2"):
            diagnosed(session, "normal", gearbox=gearbox, recorded_at=now() - timedelta(days=5))
        session.add(
            MaintenanceMark(
                axis="bench",
                gearbox="g1",
                kind="exchange",
                successor="g3",
                at=now() - timedelta(days=4),
                text="exchanged",
                created_by="test",
            )
        )
        ruled(session, kind="silence", silent_days=3.0)
        assert settled(session) == [("bench", "g2")]
        rules.review(session, "bench", "g1")
        assert [alarm.gearbox for alarm in rules.standing(session)] == ["g2"]


def test_what_is_told_is_there_exactly_if_the_diagnosis_is(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        ruled(session)

    def broken_off() -> None:
        with library.transaction("test") as session:
            diagnosed(session, "notch")
            assert told(session) == ["rule"]
            raise RuntimeError

    with pytest.raises(RuntimeError):
        broken_off()
    with library.reading() as session:
        assert session.scalars(select(Delivery)).all() == session.scalars(select(StoredJob)).all() == []


def test_a_recording_of_nothing_known_tells_nobody(sqlite_library: CaseLibrary) -> None:
    with sqlite_library.transaction("test") as session:
        ruled(session)
        diagnosed(session, "notch", gearbox=None)
        assert told(session) == []


@pytest.mark.parametrize(
    "condition",
    [
        {"kind": "silence"},
        {"kind": "silence", "silent_days": 1.0, "label": "notch"},
        {"kind": "state", "silent_days": 1.0},
        {"kind": "change", "label": "notch"},
        {"kind": "state", "verdict": "unusable", "least_probability": 0.5},
        {"kind": "state", "label": "normal"},
    ],
)
def test_a_rule_that_contradicts_itself_is_refused(condition: dict[str, object]) -> None:
    with pytest.raises(InvalidRequestError):
        Condition(**condition)  # type: ignore[arg-type]


def test_secrets_are_in_no_log(sqlite_library: CaseLibrary) -> None:
    with sqlite_library.transaction("test") as session:
        row = outbox.add_receiver(session, "hook", "webhook", "https://example.com/token-17?key=18")
        session.flush()
        logged = str([entry.after for entry in session.scalars(select(AuditEntry))])
        assert outbox.shown_address(row) == "https://example.com/…"
        assert "example.com" in logged
        assert row.secret is not None
        assert not [each for each in (row.secret, "token-17", "18") if each in logged]


def test_a_receiver_that_a_rule_names_stays(sqlite_library: CaseLibrary) -> None:
    with sqlite_library.transaction("test") as session:
        rule = ruled(session)
        (team,) = outbox.list_receivers(session)
        with pytest.raises(ConflictError):
            outbox.remove_receiver(session, team.id)
        rules.remove_rule(session, rule)
        outbox.remove_receiver(session, team.id)
