"""The page of a gearbox, the queue of what needs a person and the alarms say the same of it, whatever was heard."""

import json
from collections.abc import Iterator, Sequence
from datetime import timedelta
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from app.fleet import Fleet, settle
from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.sounds import RATE_HZ, hum, wav
from casebase.alarms.rules import standing
from casebase.errors import StaleVersionError
from casebase.store.models import now
from tests.casebase.kept import keep

API = "/api/v1"
LIKELY, WATCH, GOOD = "Fault likely", "Watch", "Good"
SEQUENCE = (("notch", LIKELY, True), ("normal", WATCH, True), ("normal", WATCH, True), ("normal", GOOD, False))
"""What is heard, the state on the page, and whether a fault stands: one that was named once goes with the third."""


def sound(seed: int, label: str) -> bytes:
    """A recording that is quiet at every reversal, as one of a machine in quiet surroundings is."""
    samples = hum(12.0, seed, impacts=label == "notch")
    turning = np.abs(np.sin(np.pi * np.arange(samples.size) / RATE_HZ))
    return wav(samples * np.clip(3 * turning - 0.6, 0.02, 1.0).astype(np.float32))


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    """A library of six good and six notched gearboxes, and a rule for any fault."""
    with inside(tmp_path_factory.mktemp("state") / "data") as found:
        for number in range(6):
            for label in ("normal", "notch"):
                known = {"axis": "known", "gearbox": f"{label} {number}", "speed_rad_s": 2.5, "label": label}
                send(found, "cases", sound(100 * number + (label == "notch"), label), known)
        team = {"name": "team", "kind": "email", "address": "team@example.com"}
        receiver = found.ask("POST", f"{API}/alarms/receivers", json=team).raise_for_status().json()["id"]
        for rule in ({"name": "any fault"}, {"name": "sure", "label": "notch", "least_probability": 0.5}):
            asked = {**rule, "kind": "state", "axis": "arm", "receivers": [receiver]}
            found.ask("POST", f"{API}/alarms/rules", json=asked).raise_for_status()
        yield found


def send(service: Inside, where: str, file: bytes, known: dict[str, object]) -> dict[str, object]:
    parts = {"file": ("heard.wav", file), "metadata": (None, json.dumps(known))}
    return dict(service.ask("POST", f"{API}/{where}", files=parts).raise_for_status().json())


def heard(service: Inside, gearbox: str, *labels: str) -> None:
    """Recordings and diagnoses as rows, one a day, of which the rules are not told."""
    with service.service.library.transaction("test") as session:
        for number, label in enumerate(labels):
            keep(session, "arm", gearbox, now() - timedelta(days=9 - number), {}, label)


def on_page(service: Inside, gearbox: str) -> str:
    """The state that the fleet shows of a gearbox of the axis `arm`."""
    page = service.browse("GET", "/fleet").text
    row = next(one for one in page.split("<tr>") if f'>arm, <span class="whole">{gearbox}</span>' in one)
    return next(words for words in (LIKELY, WATCH, GOOD, "Cannot say") if f"</svg>{words}</span>" in row)


def waiting(service: Inside, gearbox: str) -> list[dict[str, Any]]:
    """The diagnoses of it that the queue has, over HTTP; the page has them too."""
    items = service.ask("GET", f"{API}/queue?limit=200").json()["items"]
    found = [each["diagnosis"] for each in items if each["diagnosis"]["recording"]["gearbox"] == gearbox]
    page = service.browse("GET", "/queue").text
    assert all(each["id"] in page for each in found)
    assert (f'arm,</span> <span class="whole">{gearbox}</span>' in page) == bool(found)
    return found


def alarmed(service: Inside, gearbox: str) -> bool:
    """Whether alarms stand; those of both rules or none."""
    with service.service.library.reading() as session:
        found = [alarm.gearbox for alarm in standing(session)].count(gearbox)
    assert found in (0, 2)
    return bool(found)


def messages(service: Inside, gearbox: str) -> list[object]:
    """What the outbox has of it."""
    given = service.ask("GET", f"{API}/alarms/deliveries?limit=200").raise_for_status().json()["items"]
    return [each["message"]["label"] for each in given if each["message"].get("gearbox") == gearbox]


def agree(service: Inside, gearbox: str, state: str, *, stands: bool) -> None:
    """Page, queue and alarm say this of a gearbox."""
    assert on_page(service, gearbox) == state
    assert (state in (LIKELY, WATCH), bool(waiting(service, gearbox)), alarmed(service, gearbox)) == (stands,) * 3


def look(service: Inside) -> None:
    """What the alarm worker of a process that has just started does."""
    settle(service.service.library, Fleet())


def test_fault_good_good_good_as_recordings_come(service: Inside) -> None:
    for number, (label, state, stands) in enumerate(SEQUENCE):
        at = (now() - timedelta(days=9 - number)).isoformat()
        known = {"axis": "arm", "gearbox": "heard", "speed_rad_s": 2.5, "recorded_at": at}
        made = send(service, "diagnoses", sound(1000 + number, label), known)
        assert (made["verdict"], made["label"]) == ("diagnosed", label)
        for _ in range(2):
            agree(service, "heard", state, stands=stands)
            look(service)
    assert messages(service, "heard") == ["notch"] * 2


def test_fault_good_good_good_by_the_alarm_worker_alone(service: Inside) -> None:
    """What nobody held the rules against, a case or a step taken back say, the next look at all gearboxes tells."""
    for number, (label, state, stands) in enumerate(SEQUENCE):
        with service.service.library.transaction("test") as session:
            keep(session, "arm", "looked at", now() - timedelta(days=9 - number), {}, label)
        for _ in range(2):
            look(service)
            agree(service, "looked at", state, stands=stands)
    assert messages(service, "looked at") == ["notch"] * 2


def test_a_repair_ends_all_three_and_a_fault_after_it_is_told_anew(service: Inside) -> None:
    for gearbox in ("repaired", "beside"):
        heard(service, gearbox, "notch", "normal")
    look(service)
    at = f"{now() - timedelta(days=8) + timedelta(hours=1):%Y-%m-%dT%H:%M}"
    mark = {"text": "new gears", "at": at, "kind": "repair", "gearbox": "repaired", "back": "repaired"}
    assert service.browse("POST", "/axes/arm/marks", data=mark).status_code == 303
    agree(service, "repaired", "Cannot say", stands=False)
    agree(service, "beside", WATCH, stands=True)
    heard(service, "repaired", *["normal"] * 2, "notch")
    look(service)
    agree(service, "repaired", LIKELY, stands=True)
    assert (messages(service, "repaired"), messages(service, "beside")) == (["notch"] * 4, ["notch"] * 2)


def test_a_rejected_fault_is_none_for_all_three_until_that_is_taken_back(service: Inside) -> None:
    heard(service, "rejected", "normal", "notch")
    look(service)
    (fault,) = waiting(service, "rejected")
    said = {"verdict": "rejected"}
    service.ask("PATCH", f"{API}/diagnoses/{fault['id']}", json=said).raise_for_status()
    agree(service, "rejected", GOOD, stands=False)
    (step,) = service.ask("GET", f"{API}/steps?kind=diagnosis&subject={fault['id']}").json()["items"]
    service.ask("POST", f"{API}/steps/{step['number']}/undo").raise_for_status()
    agree(service, "rejected", LIKELY, stands=True)


def undecided(service: Inside, gearbox: str, *left: str, sure: float, quality: Sequence[object] = ()) -> None:
    """A diagnosis that leaves the label open, as a row."""
    with service.service.library.transaction("test") as session:
        present = None if 0.1 < sure < 0.9 else sure > 0.5
        said = {
            "fault": {"present": present, "probability": sure},
            "labels": left,
            "quality": quality,
            "hypotheses": [
                {"label": label, "probability": 0.6, "p_value": 0.5, "support": {"measured": 1, "simulated": 0}}
                for label in left
            ],
        }
        keep(session, "arm", gearbox, now() - timedelta(days=1), {}, left[0], verdict="ambiguous", **said)


def test_a_fault_of_which_only_the_name_is_open_is_one_for_all_three(service: Inside) -> None:
    short = {"name": "too_short_for_motion", "severity": "poor", "reason": "1.1 cycles", "value": 1.1}
    undecided(service, "open", "notch", "play", "normal", sure=0.97, quality=[short])
    look(service)
    agree(service, "open", LIKELY, stands=True)
    assert messages(service, "open") == ["notch", None]
    assert "undecided which: tooth damage or backlash" in service.browse("GET", "/fleet").text
    given = service.ask("GET", f"{API}/alarms/deliveries?limit=200").json()["items"]
    sent = [each["message"] for each in given]
    (told,) = (each for each in sent if each["gearbox"] == "open" and not each["label"])
    assert (told["verdict"], told["labels"], told["probability"]) == ("ambiguous", ["notch", "play"], 0.97)


def test_no_fault_is_good_where_the_label_is_open_and_neither_is_said_of_a_poor_recording(service: Inside) -> None:
    undecided(service, "none", "normal", "healthy", sure=0.03)
    undecided(service, "either", "normal", "notch", sure=0.5)
    poor = {"name": "wind", "severity": "poor", "reason": "wind", "value": 1.0}
    undecided(service, "poor", "notch", "play", sure=0.97, quality=[poor])
    look(service)
    assert [on_page(service, each) for each in ("none", "either", "poor")] == [GOOD, "Cannot say", "Cannot say"]
    assert not any(alarmed(service, each) for each in ("none", "either", "poor"))


def test_an_answer_that_was_broken_off_is_not_remembered(service: Inside) -> None:
    """A rejection that fails changes none of the three."""
    heard(service, "kept", "notch")
    look(service)
    (fault,) = waiting(service, "kept")
    failing = patch("app.web.pages.diagnoses.newest_of", side_effect=StaleVersionError("somebody was faster"))
    with failing:
        service.browse("POST", f"/diagnoses/{fault['id']}/revise", data={"verdict": "rejected", "queue": "1"})
    agree(service, "kept", LIKELY, stands=True)
