"""Whatever is typed or logged is taken, or refused with what is wrong and what would be right: never our fault."""

import json
from collections.abc import Iterator
from urllib.parse import quote

import httpx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.recordings.intake import RecordingMetadata, take_in
from benchmarks.bombs.bodies import AXIS, BIG, BODIES, ODD, PARTS, places, table, with_value
from benchmarks.harness.inside import Inside, ListedJobs, inside
from benchmarks.harness.sounds import sound
from casebase.description import Labelling
from casebase.library import CaseLibrary

API = "/api/v1"
PART = 4
"""One in so many of the odd values at each place, others at the next: each at one place of a body at least."""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    folder = tmp_path_factory.mktemp("input")
    (folder / "sound.wav").write_bytes(sound(5, seconds=1.0, impacts=True))
    with inside(folder / "data") as found:
        found.service.__dict__["jobs"] = ListedJobs()
        yield found


@pytest.fixture(scope="module")
def known(service: Inside) -> dict[str, str]:
    """Ids of a case and of a diagnosis."""
    library: CaseLibrary = service.service.library
    path = library.data_dir.parent / "sound.wav"
    intake = take_in(library, path, "notch.wav", "audio/wav", RecordingMetadata())
    with library.transaction("test") as session:
        diagnosis = intake.diagnose(library, session)
        case = library.retain.case(session, intake.store(library, session), Labelling("notch"))
        return {"diagnosis": diagnosis.id, "diagnosis_id": diagnosis.id, "case_id": case.id}


def check(service: Inside, answer: httpx.Response, sent: object) -> None:
    """It went well and can be found again, or it says what was wrong."""
    assert answer.status_code < 500, (sent, answer.text)
    document = answer.json()
    if answer.status_code >= 400:
        assert answer.headers["content-type"] == "application/problem+json"
        assert len(document["detail"]) > 20, sent
        assert "nothing" not in document["detail"]
        return
    if where := answer.headers.get("location"):
        assert where.isascii()
        assert not set(where) & set(" ?#")
        assert service.ask("GET", where).status_code == 200, (sent, where)


TEXTS = st.text(st.characters(exclude_categories=()), max_size=20)
VALUES = st.one_of(st.sampled_from(ODD), TEXTS, st.integers(-(10**400), 10**400), st.floats())
JSON_PLACES = [(route, path) for route, body in BODIES.items() for path in places(body)]
PART_PLACES = [(route, path) for route, (_, body) in PARTS.items() for path in places(body)]


def test_every_route_that_takes_a_body_is_in_the_tables(service: Inside) -> None:
    document = service.app.openapi()
    taking = {
        (method.upper(), path.removeprefix(API))
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
        if "requestBody" in operation
    }
    assert taking == {*BODIES, *PARTS, ("POST", "/robots")}  # robots have tables of their own


def send_json(service: Inside, known: dict[str, str], route: tuple[str, str], body: object) -> None:
    method, path = route
    text = json.dumps(body).replace("{diagnosis}", known["diagnosis"]).replace("Infinity", "1e400")
    headers = {"Content-Type": "application/json"}
    check(service, service.ask(method, API + path.format(**known), content=text, headers=headers), text[:300])


@settings(max_examples=120, deadline=None)
@given(st.sampled_from(JSON_PLACES), VALUES)
def test_any_value_anywhere_in_json(
    service: Inside, known: dict[str, str], place: tuple[tuple[str, str], tuple[str | int, ...]], value: object
) -> None:
    route, path = place
    send_json(service, known, route, with_value(BODIES[route], path, value))


@pytest.mark.parametrize("route", BODIES)
def test_odd_values_at_every_place_of_json(service: Inside, known: dict[str, str], route: tuple[str, str]) -> None:
    """Of values and places each has a part of the others; `make bombs` sends far more."""
    found = list(places(BODIES[route]))
    part = min(PART, len(found))
    for number, path in enumerate(found):
        for value in ODD[number % part :: part]:
            send_json(service, known, route, with_value(BODIES[route], path, value))


@settings(max_examples=80, deadline=None)
@given(st.sampled_from(PART_PLACES), VALUES)
def test_any_value_anywhere_in_the_json_of_a_form(
    service: Inside, place: tuple[tuple[str, str], tuple[str | int, ...]], value: object
) -> None:
    route, path = place
    part, document = PARTS[route]
    text = json.dumps(with_value(document, path, value)).replace("Infinity", "1e400")
    telemetry = {"telemetry": ("t.csv", table("temperature_degc").encode())}
    files = telemetry if part == "axis" else {"file": ("x.wav", b"no sound")}
    check(service, service.ask(route[0], API + route[1], files=files, data={part: text}), text[:300])


@pytest.mark.parametrize("name", ["轴一", "a%2Fb", "what? #4"])
def test_an_axis_may_have_a_name_of_any_script(service: Inside, name: str) -> None:
    """It is found under its Location, on its page, by its mark, and in a recording's metadata."""
    answer = service.ask("POST", f"{API}/axes", json={**AXIS, "name": name})
    assert answer.status_code == 201
    assert answer.headers["location"] == f"{API}/axes/{quote(name, safe='')}"
    assert service.ask("GET", answer.headers["location"]).json()["name"] == name
    page = f"/axes/{quote(name, safe='')}"
    for path in (page, f"/simulate?axis={quote(name)}", f"{page}/axis.toml", "/axes"):
        assert service.browse("GET", path).status_code == 200, path
    assert f'href="{page}"' in service.browse("GET", "/axes").text
    mark = service.browse("POST", f"{page}/marks", data={"text": "oiled", "at": "2026-11-20T14:03"})
    assert mark.status_code == 303
    assert "oiled" in service.browse("GET", mark.headers["location"]).text
    assert RecordingMetadata(axis=name).axis == name


@pytest.mark.parametrize("name", ["../keys", "a/b", "a\x85b", " a", "x" * 201])
def test_a_name_that_cannot_stand_in_an_address_is_refused(service: Inside, name: str) -> None:
    telemetry = {"telemetry": ("t.csv", table("temperature_degc").encode())}
    axis = json.dumps({**AXIS, "name": name})
    answers = [
        service.ask("POST", f"{API}/axes", content=axis, headers={"Content-Type": "application/json"}),
        service.ask("POST", f"{API}/simulations", json={"axis": {**AXIS, "name": name}, "per_label": 1}),
        service.ask("POST", f"{API}/investigations", files=telemetry, data={"axis": axis}),
    ]
    if name == name.strip():  # a blank at the end of a word in the metadata is left out
        metadata = {"metadata": json.dumps({"axis": name})}
        answers.append(service.ask("POST", f"{API}/diagnoses", files={"file": ("x.wav", b"")}, data=metadata))
    for answer in answers:
        assert answer.status_code == 422, answer.text
        assert "name" in answer.json()["detail"] or "axis" in answer.json()["detail"]
        assert "200 characters" in answer.json()["detail"]


@pytest.mark.parametrize("kind", ["json", "toml"])
@pytest.mark.parametrize("number", [BIG, f"-{BIG}"])
def test_a_number_of_400_digits_names_its_key_and_range(service: Inside, kind: str, number: str) -> None:
    text = {
        "json": f'{{"name": "big", "motor": {{"inertia_kg_m2": {number}}}, "load": {{"inertia_kg_m2": 1}}}}',
        "toml": f'name = "big"\nmotor.inertia_kg_m2 = {number}\nload.inertia_kg_m2 = 1',
    }[kind]
    answer = service.ask("POST", f"{API}/axes", content=text, headers={"Content-Type": f"application/{kind}"})
    assert answer.status_code == 422
    assert "motor.inertia_kg_m2: must be > 0 and <= 1e+09 kg m2" in answer.json()["detail"]
    assert len(answer.json()["detail"]) < 200


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8", "cp1252"])
def test_a_header_with_degrees_is_read_in_the_encodings_that_controls_write(service: Inside, encoding: str) -> None:
    files = {"telemetry": ("log.csv", table("motor temperature [°C]").encode(encoding), "text/csv")}
    answer = service.ask("POST", f"{API}/investigations", files=files, data={"axis": json.dumps(AXIS)})
    assert answer.status_code == 202, answer.text


def test_a_direct_drive_has_no_mechanisms_to_simulate_and_none_are_offered(service: Inside) -> None:
    direct = {"name": "direct", "motor": {"inertia_kg_m2": 0.1}, "load": {"inertia_kg_m2": 1.0}}
    service.ask("POST", f"{API}/axes", json=direct).raise_for_status()
    assert "/simulate?axis=direct" not in service.browse("GET", "/axes/direct").text
    answer = service.browse("GET", "/simulate?axis=direct")
    assert (answer.status_code, answer.headers["content-type"]) == (422, "text/html; charset=utf-8")
    assert "no gear stage" in answer.text


FORMS = {
    "/keys": {"name": "bench", "role": "viewer"},
    "/axes/bench/marks": {"text": "oiled", "at": "2026-11-20T14:03", "gearbox": "g 1"},
    "/diagnoses/{diagnosis_id}/revise": {
        "verdict": "corrected",
        "label": "notch",
        "verified_by": "opened",
        "verification": "opened",
    },
    "/library/change": {"action": "label", "case_id": "{case_id}", "label": "notch"},
    "/library/review/undo": {"version": "1"},
    "/library/rename": {"old": "normal", "label": "+", "another": "worn"},
    "/steps/undo": {"step": "1"},
}


@pytest.mark.parametrize(
    "odd", ["%ED%A0%80", "%00", "%0A", "%C2%85", "x" * 600, "%D0%9E", BIG, "-1"], ids=lambda odd: odd[:9]
)
@pytest.mark.parametrize("path", FORMS)
def test_any_value_in_a_field_of_a_form(service: Inside, known: dict[str, str], path: str, odd: str) -> None:
    headers = {"Content-Type": "application/x-www-form-urlencoded"}
    token = service.token
    for field in FORMS[path]:
        sent = {**FORMS[path], field: "\N{BULLET}"}
        body = "&".join(f"{name}={quote(value.format(**known))}" for name, value in {**sent, "csrf": token}.items())
        body = body.replace(quote("\N{BULLET}"), odd)
        answer = service.browse("POST", path.format(**known), content=body, headers=headers)
        assert answer.status_code < 500, (field, answer.text)


def test_a_number_of_400_digits_in_a_query(service: Inside) -> None:
    pages = ("/audit?before=", "/library?step=", "/queue?step=", "/library/review?edit=")
    for path in (*pages, f"{API}/audit?cursor=", f"{API}/cases?limit="):
        assert service.browse("GET", path + BIG).status_code < 500, path


def test_what_was_stored_is_said_as_it_is(service: Inside, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing where nothing was, what was where something was, and nothing of it where nothing was asked for."""
    monkeypatch.setattr("app.api.axes.AxisAnswer.model_validate", fail)
    monkeypatch.setattr("app.web.pages.admin.keys.list_keys", fail)
    before = service.ask("POST", f"{API}/axes", json={**AXIS, "name": "never"})
    assert before.json()["detail"].endswith("So far nothing of this request was stored.")
    asked = service.ask("GET", f"{API}/axes")
    assert (asked.status_code, "stored" in asked.json()["detail"]) == (500, False)
    after = service.browse("POST", "/keys", data={"name": "lost", "role": "viewer"}, headers={"Accept": "*/*"})
    assert after.status_code == 500
    assert "Stored before it failed: key.created" in after.json()["detail"]
    monkeypatch.undo()
    assert "lost" in service.browse("GET", "/keys").text
    assert service.ask("GET", f"{API}/axes/never").status_code == 404


def fail(*_: object, **__: object) -> None:
    raise RuntimeError("as a test wants it")
