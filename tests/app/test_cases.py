"""Cases over HTTP: added once, changed by one at a time, paged without gaps."""

import json
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from benchmarks.harness.live import LiveServer
from benchmarks.harness.sounds import hum, sound, wav

CASES = "/api/v1/cases"


def add(
    client: httpx.Client, content: bytes, headers: Mapping[str, str] | None = None, **metadata: object
) -> httpx.Response:
    files = {"file": ("a sound.wav", content, "audio/wav")}
    data = {"metadata": json.dumps({"label": "normal", **metadata})}
    return client.post(CASES, files=files, data=data, headers=dict(headers or {}))


def test_added_case_is_where_location_says(admin: httpx.Client) -> None:
    answer = add(
        admin, sound(10), gearbox="g1", speed_rad_s=2.5, payload_kg_m2=40, recorded_at="2026-11-20T14:03:00+01:00"
    )
    assert answer.status_code == 201
    case = admin.get(answer.headers["location"])
    assert case.json() == answer.json()
    assert case.headers["etag"] == answer.headers["etag"]
    recording = case.json()["recording"]
    assert (recording["gearbox"], recording["speed_rad_s"], recording["payload_kg_m2"]) == ("g1", 2.5, 40.0)
    assert recording["recorded_at"] == "2026-11-20T13:03:00Z"
    assert (recording["sample_rate_hz"], recording["duration_s"]) == (8000.0, 6.0)


def test_same_bytes_and_metadata_are_one_recording_and_one_case(admin: httpx.Client) -> None:
    first, again = (add(admin, sound(11), gearbox="g1") for _ in range(2))
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json()["id"] == first.json()["id"]
    assert again.json()["recording"]["id"] == first.json()["recording"]["id"]


@pytest.mark.parametrize("change", [{"gearbox": "g2"}, {"label": "notch"}])
def test_same_sound_of_another_gearbox_or_label_is_a_conflict_that_names_the_case(
    admin: httpx.Client, live_server: LiveServer, change: dict[str, str]
) -> None:
    first = add(admin, sound(12), gearbox="g1").json()
    there = sorted((live_server.data_dir / "audio").glob("*/*"))
    quieter = wav(0.5 * hum(6.0, 12))
    answer = add(admin, quieter, **{"gearbox": "g1", **change})
    assert answer.status_code == 409
    assert answer.json()["case"] == {"id": first["id"], "label": "normal", "gearbox": "g1"}
    assert first["id"] in answer.json()["detail"]
    assert sorted((live_server.data_dir / "audio").glob("*/*")) == there


def test_idempotency_key_answers_the_same_bytes(admin: httpx.Client) -> None:
    headers = {"Idempotency-Key": "case-14"}
    first = add(admin, sound(14), headers)
    again = add(admin, sound(14), headers)
    assert (again.status_code, again.content) == (201, first.content)
    assert again.headers["location"] == first.headers["location"]
    assert again.headers["idempotent-replay"] == "true"
    assert "idempotent-replay" not in first.headers


@pytest.mark.parametrize("change", [{"gearbox": "g2"}, {"seed": 16}])
def test_idempotency_key_with_other_content_is_refused(admin: httpx.Client, change: dict[str, object]) -> None:
    headers = {"Idempotency-Key": f"case-15-{json.dumps(change)}"}
    add(admin, sound(15), headers, gearbox="g1").raise_for_status()
    seed = change.pop("seed", 15)
    answer = add(admin, sound(int(str(seed))), headers, **{"gearbox": "g1", **change})
    assert answer.status_code == 422
    assert "Idempotency-Key" in answer.json()["detail"]


def test_idempotency_key_after_a_failure_does_the_work(admin: httpx.Client) -> None:
    headers = {"Idempotency-Key": "case-17"}
    assert add(admin, b"no sound", headers).status_code == 415
    assert add(admin, sound(17), headers).status_code == 201


def test_idempotency_keys_of_two_clients_are_two(live_server: LiveServer, admin: httpx.Client) -> None:
    other = admin.post("/api/v1/keys", json={"name": "second admin", "role": "admin"}).json()
    headers = {"Idempotency-Key": "shared-word"}
    one = add(admin, sound(18), headers, gearbox="g1")
    with httpx.Client(base_url=live_server.url, headers={"Authorization": f"Bearer {other['key']}"}) as second:
        two = add(second, sound(36), headers, gearbox="g2")
    assert two.status_code == 201
    assert one.json()["id"] != two.json()["id"]
    admin.delete(f"/api/v1/keys/{other['id']}").raise_for_status()


def test_idempotency_key_sent_at_once_does_the_work_once(live_server: LiveServer) -> None:
    def send(_: int) -> httpx.Response:
        with live_server.client() as client:
            return add(client, sound(19), {"Idempotency-Key": "case-19"}, gearbox="g19")

    with ThreadPoolExecutor(6) as pool:
        answers = list(pool.map(send, range(6)))
    assert {answer.status_code for answer in answers} == {201}
    assert len({answer.content for answer in answers}) == 1


def test_change_with_the_current_etag(admin: httpx.Client) -> None:
    made = add(admin, sound(20))
    path, etag = made.headers["location"], made.headers["etag"]
    changed = admin.patch(path, json={"label": "play", "verified_by": "opened"}, headers={"If-Match": etag})
    assert changed.status_code == 200
    assert (changed.json()["label"], changed.json()["verified_by"]) == ("play", "opened")
    assert changed.headers["etag"] != etag
    had, has = (admin.get(path, headers={"If-None-Match": tag}) for tag in (etag, changed.headers["etag"]))
    assert (had.status_code, has.status_code, has.content) == (200, 304, b"")


@pytest.mark.parametrize("stale", ['"999"', '"1"', "W/x", "nonsense"])
def test_change_with_a_stale_etag_is_refused(admin: httpx.Client, stale: str) -> None:
    path = add(admin, sound(21)).headers["location"]
    admin.patch(path, json={"note": "first"}).raise_for_status()
    before = admin.get(path).json()
    answer = admin.patch(path, json={"note": "second"}, headers={"If-Match": stale})
    assert answer.status_code == 412
    assert answer.json()["detail"]
    assert admin.delete(path, headers={"If-Match": stale}).status_code == 412
    assert admin.get(path).json() == before


def test_of_two_changes_at_once_one_wins(live_server: LiveServer, admin: httpx.Client) -> None:
    made = add(admin, sound(22))
    path, etag = made.headers["location"], made.headers["etag"]

    def change(number: int) -> int:
        with live_server.client() as client:
            return client.patch(path, json={"note": f"note {number}"}, headers={"If-Match": etag}).status_code

    with ThreadPoolExecutor(5) as pool:
        codes = list(pool.map(change, range(5)))
    assert sorted(codes) == [200, 412, 412, 412, 412]


def test_pages_cover_every_case_once_while_more_arrive(admin: httpx.Client) -> None:
    made = [add(admin, sound(300 + n, seconds=1.0), gearbox=f"p{n}", axis="pages").json()["id"] for n in range(7)]
    seen: list[str] = []
    cursor: str | None = None
    for round_ in range(20):
        query = {"axis": "pages", "limit": "2", **({"cursor": cursor} if cursor else {})}
        page = admin.get(CASES, params=query).json()
        seen += [item["id"] for item in page["items"]]
        add(admin, sound(400 + round_, seconds=1.0), gearbox=f"late {round_}", axis="pages")
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert seen == made[::-1]
