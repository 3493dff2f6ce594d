"""Where two people are wanted, no label is searched by the word of one: kept, labelled, restored, taken back."""

import json
from collections.abc import Iterator
from dataclasses import replace

import pytest

from app.keys import Role, create_key
from tests.app.inside import Inside, inside
from tests.app.sounds import sound

API = "/api/v1"


@pytest.fixture(scope="module")
def anna(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GEARCASE_TWO_PEOPLE", "true")
        with inside(tmp_path_factory.mktemp("two_people") / "data") as found:
            yield found


@pytest.fixture(scope="module")
def otto(anna: Inside) -> Inside:
    """The same service with the key of another admin."""
    with anna.service.library.transaction("test") as session:
        _, key = create_key(session, name="otto", role=Role.ADMIN)
    return replace(anna, key=key)


def kept(who: Inside, seed: int, label: str = "normal") -> str:
    parts = {"file": (f"{seed}.wav", sound(seed)), "metadata": (None, json.dumps({"label": label, "gearbox": "g"}))}
    case = who.ask("POST", f"{API}/cases", files=parts).raise_for_status().json()
    assert case["state"] == "proposed"
    return str(case["id"])


def searched(who: Inside) -> int:
    return len(who.ask("GET", f"{API}/cases", params={"state": "confirmed"}).json()["items"])


def change(who: Inside, case: str, **fields: str) -> tuple[int, str]:
    """Change a case and return the status, and its state or what was said against it."""
    answer = who.ask("PATCH", f"{API}/cases/{case}", json=fields)
    return answer.status_code, answer.json().get("state") or answer.json()["detail"]


def test_a_case_is_searched_once_another_admin_has_released_it(anna: Inside, otto: Inside) -> None:
    case = kept(anna, 1)
    assert searched(anna) == 0
    code, said = change(anna, case, state="confirmed")
    assert code == 409
    assert "another admin has to release it" in said
    assert change(otto, case, state="confirmed") == (200, "confirmed")
    assert searched(anna) == 1


def test_with_another_label_it_is_proposed_anew_by_who_gave_it(anna: Inside, otto: Inside) -> None:
    case = kept(anna, 2)
    change(otto, case, state="confirmed")
    assert change(otto, case, label="play", state="confirmed") == (200, "proposed")
    assert change(otto, case, state="confirmed")[0] == 409
    assert change(anna, case, note="looks right", state="confirmed") == (200, "confirmed")


def test_what_was_retired_comes_back_by_another_one_only(anna: Inside, otto: Inside) -> None:
    case = kept(anna, 3)
    change(anna, case, state="retired")
    assert change(anna, case, label="play") == (200, "retired")
    assert change(anna, case, state="confirmed")[0] == 409
    assert change(otto, case, state="confirmed") == (200, "confirmed")


def test_a_label_that_is_renamed_stays_searched_and_all_is_taken_back(anna: Inside, otto: Inside) -> None:
    case = kept(anna, 4, "fan_hum")
    change(otto, case, state="confirmed")
    renamed = {"old": "fan_hum", "label": "+", "another": "fan", "sure": "1"}
    assert anna.browse("POST", "/library/rename", data=renamed).status_code == 303
    now = anna.ask("GET", f"{API}/cases/{case}").json()
    assert (now["state"], now["label"]) == ("confirmed", "fan")
    assert change(anna, case, label="play") == (200, "proposed")
    for _ in range(2):
        page = anna.browse("GET", f"/cases/{case}").text
        step = page.split('name="step" value="')[1].split('"')[0]
        anna.browse("POST", "/steps/undo", data={"step": step})
    now = anna.ask("GET", f"{API}/cases/{case}").json()
    assert (now["state"], now["label"]) == ("confirmed", "fan_hum")
    assert now["labelled_by"].startswith("test#")


def test_the_pages_say_who_has_to_do_what(anna: Inside, otto: Inside) -> None:
    case = kept(anna, 5)
    assert "1 case waits for an admin to release it" in otto.browse("GET", "/queue").text
    own, other = (who.browse("GET", f"/cases/{case}").text for who in (anna, otto))
    assert "An admin other than the one who labelled it has to release it" in own
    assert 'value="release"' not in own
    assert 'value="release"' in other
    assert otto.browse("POST", "/library/change", data={"action": "release", "case_id": case}).status_code == 303
    assert "waits for an admin" not in otto.browse("GET", "/queue").text
    refused = otto.browse("POST", "/library/change", data={"action": "release", "case_id": case})
    assert refused.status_code == 409


def test_a_diagnosis_that_is_kept_waits_too_and_is_asked_about_no_more(anna: Inside, otto: Inside) -> None:
    parts = {"file": ("6.wav", sound(6, impacts=True))}
    diagnosis = anna.ask("POST", f"{API}/diagnoses", files=parts).raise_for_status().json()["id"]
    made = anna.ask("POST", f"{API}/cases", json={"diagnosis_id": diagnosis, "label": "play"}).raise_for_status().json()
    assert made["state"] == "proposed"
    assert diagnosis not in anna.browse("GET", "/queue").text
    assert change(otto, made["id"], state="confirmed") == (200, "confirmed")
