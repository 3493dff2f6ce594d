"""One attempt at a message: what is held, refused, tried again and given up, with real receivers on this machine."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import select

from app.alarms.sending import attempt, quiet_until
from app.fleet import Fleet, settle
from app.settings import Settings
from casebase.alarms import outbox
from casebase.library import CaseLibrary
from casebase.store.database import create_engine_for
from casebase.store.models import AlarmReceiver, AuditEntry, Delivery, now
from tests.app.alarms.receivers import Mailbox, mail_server, webhook
from tests.casebase.alarms.test_rules import diagnosed, ruled


@pytest.fixture
def library(sqlite_database_url: str, tmp_path: Path) -> Iterator[CaseLibrary]:
    opened = CaseLibrary(create_engine_for(sqlite_database_url), tmp_path / "data")
    yield opened
    opened.close()


Trying = Callable[..., Delivery]


@pytest.fixture
def trying(library: CaseLibrary) -> Trying:
    """Post a message to a receiver, unless it is there, and make one attempt with these settings."""

    def try_once(kind: str, address: str, **settings: object) -> Delivery:
        with library.transaction("test") as session:
            delivery = session.scalar(select(Delivery))
            if delivery is None:
                receiver = outbox.add_receiver(session, "receiver", kind, address)
                message = {"kind": "state", "rule": "r", "axis": "bench", "gearbox": None, "verdict": "unusable"}
                message["heard_at"] = now().isoformat()
                (delivery,) = outbox.post(session, [receiver.id], message)
            assert delivery.job_id is not None
        with ThreadPoolExecutor(1) as apart:  # a browser test before may have left its loop running in this thread
            apart.submit(attempt, library, Settings(**settings), delivery.id, delivery.job_id).result()  # type: ignore[arg-type]
        with library.reading() as session:
            return session.get_one(Delivery, delivery.id)

    return try_once


def of(box: Mailbox) -> dict[str, object]:
    return {"smtp_url": f"smtp://127.0.0.1:{box.port}", "mail_from": "gearcase@example.com"}


def test_a_job_that_was_overtaken_sends_nothing(library: CaseLibrary) -> None:
    with mail_server() as box:
        box.go_on.set()
        with library.transaction("test") as session:
            receiver = outbox.add_receiver(session, "team", "email", "team@example.com")
            delivery = outbox.post_test(session, receiver.id)
            first = str(delivery.job_id)
            outbox.order(session, delivery)
            second = str(delivery.job_id)
        settings = Settings(**of(box))  # type: ignore[arg-type]
        for job in (first, second, second, first):
            attempt(library, settings, delivery.id, job)
        assert len(box.taken) == 1
        assert "asked for by test" in str(box.taken[0].get_payload())


def test_mail_that_is_refused_for_good_is_not_sent_again(trying: Trying) -> None:
    with mail_server() as box:
        box.go_on.set()
        box.answer = "550 no such mailbox"
        found = trying("email", "team@example.com", **of(box))
    assert (found.state, found.attempts) == ("failed", 1)
    assert found.error == "the mail server answered 550 no such mailbox"


@pytest.mark.parametrize(("status", "state"), [(200, "sent"), (410, "failed")])
def test_what_a_webhook_answers_at_once_counts(trying: Trying, status: int, state: str) -> None:
    with webhook() as hook:
        hook.go_on.set()
        hook.status = status
        found = trying("webhook", f"http://127.0.0.1:{hook.port}/in", webhook_networks="127.0.0.0/8")
        assert len(hook.taken) == 1
    assert (found.state, found.attempts) == (state, 1)


@pytest.mark.parametrize(
    ("quiet", "clock", "until"),
    [
        (("22:00", "06:00"), "23:30", "+06:00"),
        (("22:00", "06:00"), "05:59", "06:00"),
        (("22:00", "06:00"), "06:00", None),
        (("12:00", "13:00"), "12:30", "13:00"),
        (("12:00", "13:00"), "11:59", None),
    ],
)
def test_quiet_hours_end_in_the_time_of_the_site(quiet: tuple[str, str], clock: str, until: str | None) -> None:
    """In Stockholm, on a winter's day: an hour ahead of UTC."""
    day, hour = datetime(2026, 1, 15, tzinfo=UTC), timedelta(hours=1)
    receiver = AlarmReceiver(quiet_from=quiet[0], quiet_to=quiet[1])
    at = datetime.fromisoformat(f"2026-01-15T{clock}+01:00")
    expected = None
    if until is not None:
        hours, minutes = until.removeprefix("+").split(":")
        expected = day + timedelta(hours=int(hours), minutes=int(minutes), days=until.startswith("+")) - hour
    assert quiet_until(receiver, at, "Europe/Stockholm") == expected


def test_a_message_waits_for_the_end_of_quiet_hours_and_a_test_does_not(library: CaseLibrary) -> None:
    around = (now() - timedelta(hours=2), now() + timedelta(hours=2))
    with mail_server() as box:
        box.go_on.set()
        settings = Settings(**of(box))  # type: ignore[arg-type]
        with library.transaction("test") as session:
            ruled(session)
            (receiver,) = outbox.list_receivers(session)
            receiver.quiet_from, receiver.quiet_to = (f"{each:%H:%M}" for each in around)
            diagnosed(session, "notch")
            held = session.scalars(select(Delivery)).one()
            test = outbox.post_test(session, receiver.id)
        for each in (held, test):
            attempt(library, settings, each.id, str(each.job_id))
        assert [email["Subject"] for email in box.taken] == ["[Gearcase] This is a test of Gearcase"]
    with library.reading() as session:
        row = session.get_one(Delivery, held.id)
        assert (row.state, row.attempts) == ("waiting", 0)
        assert row.next_at is not None
        assert now() + timedelta(hours=1.9) < row.next_at < now() + timedelta(hours=2.1)


def test_silence_is_noticed_though_nothing_comes(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        diagnosed(session, "normal", recorded_at=now() - timedelta(days=40))
        ruled(session, kind="silence", silent_days=30.0)
        ruled(session, name="change", kind="change")
    for _ in range(2):
        settle(library, Fleet())  # one recording is no trend
    with library.reading() as session:
        (delivery,) = session.scalars(select(Delivery)).all()
        assert delivery.message["kind"] == "silence"
        assert not [row for row in session.scalars(select(AuditEntry)) if row.actor == "alarms"]
