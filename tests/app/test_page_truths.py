"""What a page says is so: notes can be taken back, keys go on purpose, cases of a reopened diagnosis are named."""

import json
import re
from collections.abc import Iterator

import pytest

from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.sounds import sound

API = "/api/v1"
AXIS = {"name": "bench", "motor": {"inertia_kg_m2": 0.006}, "stages": [{"name": "output", "ratio": 50.0}]}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    with inside(tmp_path_factory.mktemp("truths") / "data") as found:
        found.ask("POST", f"{API}/axes", json={**AXIS, "load": {"inertia_kg_m2": 40.0}}).raise_for_status()
        yield found


def diagnosed(service: Inside, seed: int, axis: str) -> str:
    parts = {"file": (f"{seed}.wav", sound(seed)), "metadata": (None, json.dumps({"axis": axis, "gearbox": "g1"}))}
    return str(service.ask("POST", f"{API}/diagnoses", files=parts).raise_for_status().json()["id"])


def test_a_maintenance_note_can_be_removed_and_the_log_keeps_it(service: Inside) -> None:
    service.browse("POST", "/axes/bench/marks", data={"text": "new grease", "at": "2026-11-20T14:03"})
    page = service.browse("GET", "/axes/bench").text
    found = re.search(r"/axes/bench/marks/([0-9a-f]{32})/remove", page)
    assert found is not None
    assert "new grease" in page
    assert service.browse("POST", f"/axes/other/marks/{found[1]}/remove", data={}).status_code == 404
    assert service.browse("POST", found[0], data={}).status_code == 303
    assert "new grease" not in service.browse("GET", "/axes/bench").text
    assert service.browse("POST", found[0], data={}).status_code == 404
    log = service.browse("GET", "/audit").text
    assert "Maintenance noted" in log
    assert "Maintenance note removed" in log


def test_a_key_is_revoked_on_purpose_only(service: Inside) -> None:
    made = service.ask("POST", f"{API}/keys", json={"name": "shift", "role": "viewer"}).raise_for_status().json()
    refused = service.browse("POST", f"/keys/{made['id']}/revoke", data={})
    assert (refused.status_code, "Nothing was changed" in refused.text) == (422, True)
    assert service.browse("POST", f"/keys/{made['id']}/revoke", data={"sure": "yes"}).status_code == 303
    assert "revoked" in service.browse("GET", "/keys").text


def test_the_page_of_a_gearbox_lists_its_diagnoses_and_that_of_a_diagnosis_says_what_is_not_described(
    service: Inside,
) -> None:
    described, unknown = diagnosed(service, 1, "bench"), diagnosed(service, 2, "nobody knows")
    page = service.browse("GET", "/axes/bench/gearboxes/g1").text
    assert f"/diagnoses/{described}" in page
    assert f"/diagnoses/{unknown}" not in page
    of_axis = service.browse("GET", "/axes/bench").text
    assert "/axes/bench/gearboxes/g1" in of_axis
    assert "was not investigated yet" in of_axis
    assert "(not described)" not in service.browse("GET", f"/diagnoses/{described}").text
    assert "nobody knows (not described)" in service.browse("GET", f"/diagnoses/{unknown}").text


def test_a_diagnosis_that_is_taken_back_names_the_case_that_was_made_of_it(service: Inside) -> None:
    diagnosis = diagnosed(service, 3, "bench")
    address = f"/diagnoses/{diagnosis}"
    right = {"verdict": "corrected", "label": "normal", "verified_by": "gearbox opened"}
    assert service.browse("POST", f"{address}/revise", data=right).status_code == 303
    assert service.browse("POST", f"{address}/retain", data={}).status_code == 422, "how it was verified is asked"
    kept = service.browse("POST", f"{address}/retain", data={"verification": "opened"}).headers["location"]
    case = kept.partition("?")[0]
    page = service.browse("GET", address).text
    assert f'href="{case}"' in page
    assert "still counts" not in page
    assert service.browse("POST", f"{address}/revise", data={"verdict": "open"}).status_code == 303
    page = service.browse("GET", address).text
    assert f'href="{case}"' in page
    assert "still counts" in page
