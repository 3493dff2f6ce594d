"""Every way in which a delivery can fail, through a worker and real sockets: an attempt, its words, ten tries."""

import ssl
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from threading import Event

import pytest
from sqlalchemy import text

from app.alarms import sending
from app.fleet import settle
from app.jobs.runner import Worker
from app.settings import settings_of
from benchmarks.harness.inside import Inside
from casebase.alarms import outbox
from casebase.alarms.outbox import RETRIES
from casebase.library import CaseLibrary
from casebase.store.models import Delivery, StoredJob, now
from tests.app.alarms.receivers import Talk, endless, free_port, mail, reset, says, server, silence, wait_for, webhook

HERE = {"WEBHOOK_NETWORKS": "127.0.0.1/32"}
SLOW = "did not take it"
DELIVERIES = "/api/v1/alarms/deliveries"
SMTP = {"SMTP_URL": "smtp://user:pass-word@127.0.0.1:{port}"}
MQTT = {"MQTT_URL": "mqtt://127.0.0.1:{port}"}
AUTH = b"250-here\r\n250 AUTH PLAIN"
FACTS = {
    "kind": "silence",
    "rule": "r",
    "axis": "bench",
    "gearbox": None,
    "heard_at": now().isoformat(),
    "silent_days": 1,
}


@dataclass(frozen=True)
class Failure:
    """What is at a port of this machine, where the message is to go, what is set, and what is said in the end."""

    address: str
    words: str
    talk: Talk | None = None
    given: Mapping[str, str] = field(default_factory=dict)
    secret: str | None = None
    timeout_s: float = 30.0


def hook(words: str, talk: Talk | None, address: str = "http://127.0.0.1:{port}/secret-path") -> Failure:
    return Failure(address, words, talk, HERE, timeout_s=0.1 if words == "in time" else 30.0)


def post(words: str, talk: Talk | None, url: str = SMTP["SMTP_URL"]) -> Failure:
    return Failure("team@example.com", words, talk, {"SMTP_URL": url}, timeout_s=0.1 if words == SLOW else 30.0)


FAILURES = {
    "name without address": Failure("http://nobody.invalid/", "no address"),
    "name that cannot be": Failure("http://xn--a.example/", "a webhook is"),
    "number that cannot be": Failure("http://1.2.3.256/", "a webhook is"),
    "address that is not public": Failure("http://127.0.0.1:{port}/", "not public", says(b"HTTP/1.1 204 No\r\n\r\n")),
    "refused": hook("connect call failed", None),
    "reset": hook("reset by peer", reset),
    "no answer": hook("in time", silence),
    "closed": hook("did not answer", says(b"")),
    "no HTTP": hook("did not answer", says(b"220 mail.example.com\r\n")),
    "no TLS": hook("did not answer", says(b"HTTP/1.1 204 No\r\n\r\n"), "https://127.0.0.1:{port}/"),
    "head without end": hook("in time", endless(b"HTTP/1.1 200 OK\r\n", b"a: b\r\n")),
    "answers without end": hook("in time", endless(b"", b"HTTP/1.1 100 Continue\r\n\r\n")),
    "large head": hook("did not answer", says(b"HTTP/1.1 200 OK\r\na: " + b"b" * 2**20)),
    "redirect": hook("302", says(b"HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1/\r\n\r\n")),
    "not taken": hook("503", says(b"HTTP/1.1 503 Unavailable\r\n\r\n")),
    "secret that cannot be read": Failure("http://127.0.0.1:{port}/", "Gearcase failed", silence, HERE, secret="a"),
    "no mail server": Failure("team@example.com", "GEARCASE_SMTP_URL"),
    "mail server that cannot be": post("GEARCASE_SMTP_URL", None, "smtp://[::1"),
    "credentials that cannot be read": post("GEARCASE_SMTP_URL", None, "smtp://user:%ff@127.0.0.1"),
    "credentials that cannot be sent": post("ASCII", mail(EHLO=AUTH), SMTP["SMTP_URL"].replace("pass", "%C3%A4")),
    "mail refused": post("refused", None),
    "mail without answer": post(SLOW, silence),
    "mail answer without end": post(SLOW, endless(b"", b"220-later\r\n")),
    "mail login": post("535", mail(EHLO=AUTH, AUTH=b"535 no")),
    "mail sender": post("550", mail(EHLO=AUTH, AUTH=b"235 in", MAIL=b"550 no \0\x1b")),
    "mail recipient": post("450", mail(EHLO=AUTH, AUTH=b"235 in", RCPT=b"450 later")),
    "mail without STARTTLS": post("STARTTLS", mail(), "smtp+starttls://127.0.0.1:{port}"),
    "mail without TLS": post("SSL", mail(), "smtps://127.0.0.1:{port}"),
    "no broker": Failure("alarms", "GEARCASE_MQTT_URL"),
    "broker refused": Failure("alarms", "refused", None, MQTT),
    "broker without answer": Failure("alarms", SLOW, silence, MQTT, timeout_s=0.1),
    "broker login": Failure("alarms", "Not authorized", says(b"\x20\x02\x00\x05"), MQTT, timeout_s=0.3),
}


@pytest.fixture
def work(service: Inside, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Do all that is to be done, as a worker with these settings does it."""

    def done(**given: str) -> None:
        for name, value in given.items():
            monkeypatch.setenv(f"GEARCASE_{name}", value)
        settings_of.cache_clear()
        library = CaseLibrary(service.service.library.engine, service.service.library.data_dir)
        worker = Worker.begin(library, (sending.deliveries(library),), "test", Event())
        with ThreadPoolExecutor(1) as apart:  # a browser test before may have left its loop running in this thread
            apart.submit(lambda: [None for _ in iter(lambda: worker.do_one(("plan", "finish")), False)]).result()

    yield done
    settings_of.cache_clear()


def posted(service: Inside, address: str, secret: str | None = None, **facts: object) -> str:
    """Put a message into the outbox; its id."""
    kind = "webhook" if ":" in address else "email" if "@" in address else "mqtt"
    with service.service.library.transaction("test") as session:
        receiver = outbox.add_receiver(session, address, kind, address)
        receiver.secret = secret or receiver.secret
        return outbox.post(session, [receiver.id], FACTS | facts)[0].id


def state(service: Inside, delivery: str, *, due_after: int | None = None) -> Delivery:
    """Return a delivery; with a number of attempts it has had these, and the next one is due."""
    with service.service.library.transaction("test") as session:
        row = session.get_one(Delivery, delivery)
        if due_after is not None:
            row.attempts = due_after
            session.get_one(StoredJob, row.job_id).not_before = None
        return row


@pytest.mark.parametrize("name", FAILURES)
def test_every_failure_is_tried_ten_times_and_listed(
    service: Inside, work: Callable[..., None], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    failure = FAILURES[name]
    for each in ("MAIL_TIMEOUT_S", "MQTT_TIMEOUT_S", "WEBHOOK_TIMEOUT_S"):
        monkeypatch.setattr(sending, each, failure.timeout_s)
    with server(failure.talk or silence) as port:
        port = free_port() if failure.talk is None else port
        delivery = posted(service, failure.address.format(port=port), failure.secret)
        for number in range(1, 11) if name == "refused" else (1, 10):
            state(service, delivery, due_after=number - 1)
            work(**{name: value.format(port=port) for name, value in failure.given.items()})
            found = state(service, delivery)
            assert (found.attempts, failure.words.lower() in str(found.error).lower()) == (number, True), found.error
            assert not [each for each in ("secret-path", "pass-word", "\0") if each in str(found.error)]
            assert found.state == ("waiting" if number < 10 else "failed")
            if found.next_at is not None:
                assert abs((found.next_at - now() - RETRIES[number - 1]).total_seconds()) < 60
    (given_up, *_) = service.ask("GET", f"{DELIVERIES}?state=failed").json()["items"]
    assert (given_up["id"], given_up["attempts"]) == (delivery, 10)
    assert f"/deliveries/{delivery}/retry" in service.browse("GET", "/alarms").text


def test_after_a_repair_a_message_is_sent_now(service: Inside, work: Callable[..., None]) -> None:
    with webhook() as receiver:
        receiver.go_on.set()
        address = f"http://127.0.0.1:{receiver.port}/in"
        waits, given_up = posted(service, address), posted(service, address, kind="of later")
        work()  # the network is not allowed yet
        with service.service.library.transaction("test") as session:
            outbox.failed(session, session.get_one(Delivery, given_up), "no", final=True)
            quiet = outbox.get_receiver(session, session.get_one(Delivery, waits).receiver_id)
            quiet.quiet_from, quiet.quiet_to = "00:00", "23:59"
        assert (state(service, waits).state, state(service, given_up).state) == ("waiting", "failed")
        assert service.browse("POST", f"/alarms/deliveries/{waits}/retry", data={"x": ""}).status_code == 303
        answer = service.ask("POST", f"{DELIVERIES}/{given_up}/retry")
        assert (answer.status_code, answer.json()["attempts"]) == (202, 0)
        assert service.ask("POST", f"{DELIVERIES}/{given_up}/retry").status_code == 409
        work(**HERE)
        assert {headers["webhook-id"] for headers, _ in receiver.taken} == {waits, given_up}


@pytest.mark.parametrize("cancelled", [False, True])
def test_a_job_that_ends_without_an_attempt_is_one(service: Inside, work: Callable[..., None], cancelled: bool) -> None:
    delivery = posted(service, "http://nobody.invalid/")
    library = service.service.library
    with library.transaction("test") as session:
        session.execute(text("CREATE TRIGGER no AFTER UPDATE ON deliveries BEGIN SELECT RAISE(ABORT, 'no'); END"))
    if cancelled:
        service.service.jobs.cancel(str(state(service, delivery).job_id))
    work()
    with library.transaction("test") as session:
        session.execute(text("DROP TRIGGER no"))
    settle(library, service.service.fleet)
    found = state(service, delivery)
    assert (found.state, found.attempts) == ("failed" if cancelled else "waiting", 1)
    assert found.error
    assert (found.next_at is None) == cancelled


@pytest.mark.parametrize("answers", [("127.0.0.1", "127.0.0.2"), ("127.0.0.2", "127.0.0.1")])
def test_the_address_that_was_checked_is_connected_to(
    service: Inside, work: Callable[..., None], monkeypatch: pytest.MonkeyPatch, answers: tuple[str, ...]
) -> None:
    asked = resolving(monkeypatch, *answers)
    with webhook() as receiver:
        receiver.go_on.set()
        delivery = posted(service, f"http://moves.example.com:{receiver.port}/in")
        work(**HERE)
        hosts = [headers["host"] for headers, _ in receiver.taken]
    assert len(asked) == 1
    assert hosts == ([f"moves.example.com:{receiver.port}"] if answers[0] == "127.0.0.1" else [])
    assert state(service, delivery).state == ("sent" if hosts else "waiting")


def test_a_certificate_is_asked_for_by_the_name_as_given(
    service: Inside, work: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, names = resolving(monkeypatch, "127.0.0.1"), []
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.sni_callback = lambda _socket, name, _context: names.append(name)

    def talk(connection: object) -> None:
        with suppress(ssl.SSLError):
            context.wrap_socket(connection, server_side=True)  # type: ignore[arg-type]

    with server(talk) as port:
        posted(service, f"https://xn--strae-oqa.example:{port}/")
        work(**HERE)
        wait_for(lambda: names, "the handshake")
    assert set(names) == set(asked) == {"xn--strae-oqa.example"}


def resolving(monkeypatch: pytest.MonkeyPatch, *answers: str) -> list[str]:
    """Let the names of example have these addresses, one after the other; what was asked."""
    asked: list[str] = []
    real = sending.socket.getaddrinfo

    def resolve(host: str, *more: object, **others: object) -> object:
        if "example" in host:
            asked.append(host)
            host = answers[min(len(asked), len(answers)) - 1]
        return real(host, *more, **others)  # type: ignore[arg-type]

    monkeypatch.setattr("socket.getaddrinfo", resolve)
    return asked
