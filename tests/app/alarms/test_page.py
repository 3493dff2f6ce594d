"""The page of alarms: what it makes, shows once, and refuses in words."""

import re

import pytest
from sqlalchemy import select

from benchmarks.harness.inside import Inside
from casebase.store.models import AlarmReceiver, AlarmRule, Delivery, now
from tests.casebase.kept import keep

RECEIVERS = "/api/v1/alarms/receivers"
HOOK = "https://tickets.example.com/in/secret-path"


def send(service: Inside, path: str, **data: object) -> str:
    """Send a form and return the page that follows it."""
    answer = service.browse("POST", f"/alarms/{path}", data=data)
    assert answer.status_code in (200, 303), answer.text
    return answer.text if answer.status_code == 200 else service.browse("GET", "/alarms").text


def test_from_a_receiver_to_a_message(service: Inside) -> None:
    page = send(
        service, "receivers", name="tickets", kind="webhook", address=HOOK, quiet_from="22:00", quiet_to="06:00"
    )
    found = re.search(r"whsec_[A-Za-z0-9+/=]+", page)
    assert found, "the secret is shown"
    page = service.browse("GET", "/alarms").text
    assert not [each for each in (found[0], "secret-path") if each in page], "this once"
    assert "https://tickets.example.com/…" in page
    listed = service.ask("GET", RECEIVERS).text
    assert not [each for each in (found[0], "secret-path") if each in listed]
    with service.service.library.reading() as session:
        receiver = session.scalars(select(AlarmReceiver)).one()
    page = send(
        service,
        "rules",
        name="large notches",
        kind="state",
        label="notch",
        least_probability="90",
        least_size_mrad="1,5",
        receivers=receiver.id,
    )
    assert "sure to 90 % at least" in page.replace("\u00a0", " ")
    page = send(service, f"receivers/{receiver.id}/test")
    assert "This is a test of Gearcase" in page
    with service.service.library.reading() as session:
        rule = session.scalars(select(AlarmRule)).one()
        assert session.scalars(select(Delivery)).one().state == "waiting"
    assert (rule.label, rule.least_probability, rule.least_size_rad) == ("notch", 0.9, pytest.approx(1.5e-3))
    named = service.browse("POST", f"/alarms/receivers/{receiver.id}/remove", data={"x": ""})
    assert named.status_code == 409
    assert "large notches" in named.text
    send(service, f"rules/{rule.id}/remove", x="")
    assert "Nobody gets a message" in send(service, f"receivers/{receiver.id}/remove", x="")


def test_a_new_rule_holds_at_once(service: Inside) -> None:
    with service.service.library.transaction("test") as session:
        keep(session, "bench", "g1", now(), {}, "notch")
    send(service, "receivers", name="tickets", kind="webhook", address=HOOK)
    (receiver,) = service.ask("GET", RECEIVERS).json()
    page = send(service, "rules", name="damage", kind="state", label="notch", receivers=receiver["id"])
    assert (page.count("of 1 gearbox<"), page.count("of none<")) == (1, 0)
    for label in ("notch", "play"):
        rule = {"name": label, "kind": "state", "label": label, "receivers": [receiver["id"]]}
        service.ask("POST", "/api/v1/alarms/rules", json=rule).raise_for_status()
    page = service.browse("GET", "/alarms").text
    assert (page.count("of 1 gearbox<"), page.count("of none<")) == (2, 1)


@pytest.mark.parametrize(
    ("path", "data", "words"),
    [
        ("receivers", {"name": "a", "kind": "email", "address": "a@b", "quiet_from": "22:00"}, "quiet hours are two"),
        ("rules", {"name": "a", "kind": "state"}, "Say who gets the message"),
        ("rules", {"name": "a", "kind": "state", "receivers": "0" * 32}, "receivers that are there"),
        ("rules", {"name": "a", "kind": "state", "receivers": "0" * 32, "least_probability": "x"}, "must be a number"),
    ],
)
def test_what_cannot_be_is_refused_in_words(service: Inside, path: str, data: dict[str, str], words: str) -> None:
    answer = service.browse("POST", f"/alarms/{path}", data=data)
    assert answer.status_code == 422
    assert words.lower() in answer.text.lower()
