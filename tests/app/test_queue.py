"""The queue of what needs a person, labels from a list, how a case was verified, and every step taken back, by page."""

import json
import re
from functools import partial

import pytest

from benchmarks.harness.inside import Inside
from benchmarks.harness.sounds import sound
from benchmarks.harness.worked_out import worked_out

API = "/api/v1"


@pytest.fixture(scope="module")
def waiting(service: Inside) -> list[str]:
    """Ids of three diagnoses of a library that knows nothing, as the queue has them: the newest first."""
    made = []
    for seed in (1, 2, 3):
        known = (None, json.dumps({"gearbox": f"g{seed}"}))
        parts = {"file": (f"{seed}.wav", sound(seed)), "metadata": known}
        made.append(service.ask("POST", f"{API}/diagnoses", files=parts).raise_for_status().json()["id"])
    return made[::-1]


def revise(service: Inside, diagnosis: str, **fields: str) -> str:
    """Send the form of a verdict and return where it leads, or the page that answers."""
    answer = service.browse("POST", f"/diagnoses/{diagnosis}/revise", data=fields)
    return answer.headers.get("location", answer.text)


def undo(service: Inside, page: str) -> str:
    """Press Undo on a page and return where that leads."""
    step = re.search(r'name="step" value="(\d+)"', page)
    assert step is not None, "the page offers no Undo"
    return str(service.browse("POST", "/steps/undo", data={"step": step[1], "queue": "1"}).headers["location"])


def test_after_a_verdict_the_next_one_opens_and_undo_brings_the_last_one_back(
    service: Inside, waiting: list[str]
) -> None:
    first, second, third = waiting
    page = service.browse("GET", "/queue").text
    assert "3 left" in page
    assert "No answer: 3" in page
    assert page.index(first) < page.index(second) < page.index(third)
    assert f"/diagnoses/{third}?queue=1" in service.browse("GET", f"/diagnoses/{second}?queue=1").text
    led = revise(service, first, verdict="corrected play", queue="1")
    assert led.startswith(f"/diagnoses/{second}?queue=1&step=")
    page = service.browse("GET", led).text
    assert "3.wav: corrected as backlash." in page
    assert "1 of 2 to check" in page
    led = undo(service, page)
    assert led.startswith(f"/diagnoses/{first}?")
    assert "1 of 3 to check" in service.browse("GET", led).text
    assert service.ask("GET", f"{API}/diagnoses/{first}").json()["revision"] == {
        "state": "open", "label": None, "verified_by": None, "verification": None, "note": None, "by": None, "at": None
    }  # fmt: skip
    for one in waiting:
        led = revise(service, one, verdict="rejected", queue="1")
    assert led.startswith("/queue?step=")
    page = service.browse("GET", led).text
    assert "Nothing is left" in page
    assert undo(service, page).startswith(f"/diagnoses/{third}?")


def test_a_new_label_that_looks_like_a_known_one_is_asked_about(service: Inside, waiting: list[str]) -> None:
    one = waiting[1]
    page = revise(service, one, verdict="corrected", label="+", another="Notches")
    assert "Did you mean tooth damage?" in page
    assert service.ask("GET", f"{API}/diagnoses/{one}").json()["revision"]["label"] is None
    given = dict(re.findall(r'type="hidden" name="(\w+)" value="([^"]*)"', page))
    revise(service, one, **{**given, "label": "+"})
    assert service.ask("GET", f"{API}/diagnoses/{one}").json()["revision"]["label"] == "notches"
    revise(service, one, **{**given, "label": "notch"})
    assert service.ask("GET", f"{API}/diagnoses/{one}").json()["revision"]["label"] == "notch"
    assert "Choose the right label" in revise(service, one, verdict="corrected", label="")
    revise(service, one, verdict="corrected", label="+", another="Loose mounting")
    assert service.ask("GET", f"{API}/diagnoses/{one}").json()["revision"]["label"] == "loose_mounting"


def test_a_case_is_kept_only_if_it_is_said_how_it_was_verified_and_is_found_by_that(
    service: Inside, waiting: list[str]
) -> None:
    one = waiting[2]
    said = {"verdict": "corrected", "label": "notch", "keep": "1"}
    assert "Say how it was verified" in revise(service, one, **said)
    assert service.ask("GET", f"{API}/diagnoses/{one}").json()["revision"]["state"] != "corrected"
    revise(service, one, **said, verification="opened", verified_by="tooth 12 chipped")
    (case,) = service.ask("GET", f"{API}/cases?verification=opened").json()["items"]
    assert (case["label"], case["verification"], case["verified_by"]) == ("notch", "opened", "tooth 12 chipped")
    assert service.ask("GET", f"{API}/cases?verification=heard").json()["items"] == []
    assert "opened and seen" in service.browse("GET", f"/cases/{case['id']}").text
    assert case["id"] in service.browse("GET", "/library?verification=opened").text
    assert case["id"] not in service.browse("GET", "/library?verification=heard").text
    assert "can be held out" in worked_out(partial(service.browse, "GET"), f"/cases/{case['id']}/taught")

    renamed = service.browse("POST", "/library/rename", data={"old": "notch", "label": "tooth_breakage"})
    page = service.browse("GET", renamed.headers["location"]).text
    assert "1 case labelled tooth breakage." in page
    undo(service, page)
    assert service.ask("GET", f"{API}/cases/{case['id']}").json()["label"] == "notch"
    undo(service, service.browse("GET", f"/diagnoses/{one}").text)
    assert service.ask("GET", f"{API}/cases").json()["items"] == []
    assert service.ask("GET", f"{API}/diagnoses/{one}").json()["revision"]["state"] != "corrected"


def test_requests_of_one_step_are_taken_back_together(service: Inside) -> None:
    made, headers = [], {"X-Request-ID": "step-of-two-files"}
    for seed in (51, 52):
        parts = {"file": (f"{seed}.wav", sound(seed)), "metadata": (None, '{"label": "scuffing"}')}
        made.append(service.ask("POST", f"{API}/cases", files=parts, headers=headers).raise_for_status().json()["id"])
    (step,) = service.ask("GET", f"{API}/steps?kind=case&subject={made[0]}").json()["items"]
    assert step["what"] == "2 cases were kept."
    assert {each["id"] for each in step["subjects"]} == set(made)
    assert service.ask("POST", f"{API}/steps/{step['number']}/undo").json()["role"] == "admin"
    assert service.ask("GET", f"{API}/cases?label=scuffing").json()["items"] == []


def test_a_program_answers_the_queue_and_takes_it_back(service: Inside) -> None:
    """The first waiting diagnosis is answered and kept; the steps with it are undone in the opposite order, once."""
    for seed in (41, 42):
        parts = {"file": (f"{seed}.wav", sound(seed)), "metadata": (None, '{"gearbox": "by program"}')}
        service.ask("POST", f"{API}/diagnoses", files=parts).raise_for_status()
    before = service.ask("GET", f"{API}/queue").raise_for_status().json()
    assert before["count"] == len(before["items"]) >= 2
    assert [each["place"] for each in before["items"]] == list(range(1, before["count"] + 1))
    page = service.ask("GET", f"{API}/queue?limit=1").json()
    rest = service.ask("GET", f"{API}/queue?cursor={page['next_cursor']}").json()
    assert page["items"] + rest["items"] == before["items"]
    first = before["items"][0]
    identity = first["diagnosis"]["id"]
    assert first["reason"] == first["diagnosis"]["verdict"]
    said = {"verdict": "corrected", "label": "pitting", "verification": "opened"}
    service.ask("PATCH", f"{API}/diagnoses/{identity}", json=said).raise_for_status()
    case = service.ask("POST", f"{API}/cases", json={"diagnosis_id": identity}).raise_for_status().json()["id"]
    assert service.ask("GET", f"{API}/queue").json()["count"] == before["count"] - 1
    assert service.ask("GET", f"{API}/queue?cursor={identity}").status_code == 409
    (verdict,) = service.ask("GET", f"{API}/steps?kind=diagnosis&subject={identity}").json()["items"]
    (kept,) = service.ask("GET", f"{API}/steps?kind=case&subject={case}").json()["items"]
    assert (verdict["role"], kept["role"]) == ("operator", "admin")
    assert verdict["subjects"] == [{"kind": "diagnosis", "id": identity}]
    key = {"Idempotency-Key": "undo, once"}
    undone = service.ask("POST", f"{API}/steps/{kept['number']}/undo", headers=key).raise_for_status().json()
    assert undone == {**kept, "stands": False}
    assert service.ask("POST", f"{API}/steps/{kept['number']}/undo", headers=key).json() == undone
    assert service.ask("POST", f"{API}/steps/{kept['number']}/undo").status_code == 409
    assert service.ask("GET", f"{API}/steps/{kept['number']}").json() == undone
    service.ask("POST", f"{API}/steps/{verdict['number']}/undo").raise_for_status()
    assert service.ask("GET", f"{API}/queue").json() == before
    assert service.ask("GET", f"{API}/steps?kind=diagnosis&subject={identity}").json()["items"] == []
    assert service.ask("POST", f"{API}/steps/{2**31 - 1}/undo").status_code == 404
