"""One attempt at a message: what is held, refused, tried again and given up, with real receivers on this machine."""

import ipaddress
import smtplib
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import select

from app.alarms.sending import RETRIES, attempt, is_public, quiet_until
from app.fleet import Fleet, settle
from app.settings import Settings
from casebase.alarms import outbox
from casebase.library import CaseLibrary
from casebase.store.database import create_engine_for
from casebase.store.models import AlarmReceiver, AuditEntry, Delivery, StoredJob, now
from tests.app.alarms.receivers import Hook, Mailbox, free_port, mail_server, webhook
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
        attempt(library, Settings(**settings), delivery.id, delivery.job_id)  # type: ignore[arg-type]
        with library.reading() as session:
            return session.get_one(Delivery, delivery.id)

    return try_once


def mail(box: Mailbox) -> dict[str, object]:
    return {"smtp_url": f"smtp://127.0.0.1:{box.port}", "mail_from": "gearcase@example.com"}


def test_what_fails_is_tried_again_and_given_up_at_last(trying: Trying, library: CaseLibrary) -> None:
    settings = {"smtp_url": f"smtp://user:pass-word@127.0.0.1:{free_port()}"}
    for number, delay in enumerate(RETRIES, 1):
        before = now()
        found = trying("email", "team@example.com", **settings)
        assert (found.state, found.attempts) == ("waiting", number)
        assert found.next_at is not None
        assert before + delay <= found.next_at <= now() + delay
        with library.reading() as session:
            assert session.get_one(StoredJob, found.job_id).not_before == found.next_at
    found = trying("email", "team@example.com", **settings)
    assert found.state == "failed"
    assert "Connection refused" in str(found.error)
    assert "pass-word" not in str(found.error)


def test_a_job_that_was_overtaken_sends_nothing(library: CaseLibrary) -> None:
    with mail_server() as box:
        box.go_on.set()
        with library.transaction("test") as session:
            receiver = outbox.add_receiver(session, "team", "email", "team@example.com")
            delivery = outbox.post_test(session, receiver.id)
            first = str(delivery.job_id)
            outbox.order(session, delivery)
            second = str(delivery.job_id)
        settings = Settings(**mail(box))  # type: ignore[arg-type]
        for job in (first, second, second, first):
            attempt(library, settings, delivery.id, job)
        assert len(box.taken) == 1
        assert "asked for by test" in str(box.taken[0].get_payload())


def test_mail_that_is_refused_for_good_is_not_sent_again(trying: Trying) -> None:
    with mail_server() as box:
        box.go_on.set()
        box.answer = "550 no such mailbox"
        found = trying("email", "team@example.com", **mail(box))
    assert (found.state, found.attempts) == ("failed", 1)
    assert found.error == "the mail server answered 550 no such mailbox"


def test_a_mail_server_without_encryption_gets_no_message_that_asks_for_it(trying: Trying) -> None:
    with mail_server() as box:
        box.go_on.set()
        found = trying("email", "team@example.com", smtp_url=f"smtp+starttls://127.0.0.1:{box.port}")
        assert box.taken == []
    assert found.state == "waiting"
    assert "STARTTLS" in str(found.error)
    assert smtplib.SMTPNotSupportedError.__name__ not in str(found.error)


@pytest.mark.parametrize(
    ("status", "state", "words"),
    [
        (200, "sent", ""),
        (302, "waiting", "redirects are not followed"),
        (500, "waiting", "500"),
        (410, "failed", "410"),
    ],
)
def test_what_a_webhook_answers(trying: Trying, status: int, state: str, words: str) -> None:
    with webhook() as hook, webhook() as other:
        for each in (hook, other):
            each.go_on.set()
        hook.status, hook.headers = status, {"Location": f"http://127.0.0.1:{other.port}/"}
        found = trying("webhook", url(hook), webhook_networks="127.0.0.0/8")
        assert len(hook.taken) == 1
        assert other.taken == [], "a redirect would lead past the check of the address"
    assert found.state == state
    assert words in (found.error or "")


def url(hook: Hook) -> str:
    return f"http://127.0.0.1:{hook.port}/in?token=secret-path"


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::ffff:127.0.0.1]", "0.0.0.0", "169.254.169.254"])
def test_addresses_that_are_not_public_are_not_reached(trying: Trying, host: str) -> None:
    with webhook() as hook:
        hook.go_on.set()
        found = trying("webhook", f"http://{host}:{hook.port}/secret-path")
        assert hook.taken == []
    assert "not public" in str(found.error)
    assert "secret-path" not in str(found.error)


def test_which_addresses_are_public() -> None:
    inside = "10.0.0.1 172.16.0.1 192.168.1.1 127.0.0.1 169.254.1.1 0.0.0.0 100.64.0.1 224.0.0.1 ::1 fe80::1 fc00::1 "
    inside += "::ffff:10.0.0.1 64:ff9b::a00:1 2002:a00:1::1 2001:0:1:1:1:1:f5ff:fffe"  # all four stand for 10.0.0.1
    assert [each for each in inside.split() if is_public(ipaddress.ip_address(each))] == []
    assert all(is_public(ipaddress.ip_address(each)) for each in ("1.1.1.1", "2606:4700::1111", "64:ff9b::101:101"))


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
        settings = Settings(**mail(box))  # type: ignore[arg-type]
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
