"""Every error is problem+json and says what was wrong and what would be right."""

import json
from typing import Any

import httpx
import numpy as np
import pytest

from benchmarks.harness.live import LiveServer
from benchmarks.harness.sounds import lying_wav, sound, wav

CASES = "/api/v1/cases"


def problem(answer: httpx.Response, status: int) -> dict[str, object]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    document: dict[str, object] = answer.json()
    assert document["status"] == status
    assert document["request_id"] == answer.headers["x-request-id"]
    assert document["type"]
    assert document["title"]
    assert document["detail"]
    return document


JSON, FORM = {"content-type": "application/json"}, {"content-type": "multipart/form-data; boundary=x"}
FILE = {"file": ("a.wav", sound(1))}
KEYS = "/api/v1/keys"


@pytest.mark.parametrize(
    ("role", "method", "path", "sent", "status", "words"),
    [
        ("viewer", "GET", "/nowhere", {}, 404, "/docs"),
        ("viewer", "PUT", "/livez", {}, 405, "GET"),
        (None, "GET", CASES, {}, 401, "Authorization"),
        ("viewer", "POST", KEYS, {"json": {"name": "x", "role": "admin"}}, 403, "admin"),
        ("viewer", "GET", f"{CASES}/{'0' * 32}", {}, 404, "0" * 32),
        *(("admin", "GET", f"/api/v1/{noun}/zz", {}, 404, "zz") for noun in ("diagnoses", "cases", "jobs")),
        ("admin", "GET", "/api/v1/investigations/zz", {}, 404, "zz"),
        ("viewer", "GET", CASES, {"params": {"limit": 0}}, 422, "limit"),
        ("viewer", "GET", CASES, {"params": {"cursor": "nonsense"}}, 422, ""),
        ("admin", "POST", KEYS, {"content": b"{", "headers": JSON}, 422, "this is no JSON"),
        ("admin", "POST", KEYS, {"json": {"name": "x", "role": "viewer", "colour": 1}}, 422, "colour"),
        ("admin", "POST", CASES, {"content": sound(1), "headers": {"content-type": "audio/wav"}}, 415, "multipart"),
        ("admin", "POST", CASES, {"files": {"sound": ("a.wav", sound(1))}}, 422, "'file'"),
        ("admin", "POST", CASES, {"content": b"--x\r\n\r\nabc\r\n--x--\r\n", "headers": FORM}, 400, ""),
        ("admin", "POST", CASES, {"files": FILE, "data": {f"field{number}": "1" for number in range(20)}}, 400, ""),
        ("admin", "POST", CASES, {"files": FILE, "data": {"metadata": f'{{"notes": "{"x" * 70_000}"}}'}}, 400, ""),
    ],
)  # fmt: skip
def test_what_is_asked_wrongly_is_refused_with_what_would_be_right(
    live_server: LiveServer, role: str | None, method: str, path: str, sent: dict[str, Any], status: int, words: str
) -> None:
    with live_server.client(role) as client:
        answer = client.request(method, path, **sent)
    assert words in str(problem(answer, status)["detail"])
    assert status != 405 or "GET" in answer.headers["allow"]
    assert status != 401 or answer.headers["www-authenticate"].startswith("Bearer")


@pytest.mark.parametrize("header", ["Bearer nonsense", "Bearer gearcase_" + "x" * 43, "Basic eDp5", "gearcase_x"])
def test_wrong_key(nobody: httpx.Client, header: str) -> None:
    problem(nobody.get(CASES, headers={"Authorization": header}), 401)


def test_a_problem_says_where_it_is(viewer: httpx.Client) -> None:
    document = problem(viewer.get(CASES, params={"limit": 0}), 422)
    assert document["errors"][0]["location"] == "query.limit"  # type: ignore[index]


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"label": "notch", "colour": "red"}, "colour"),
        ({"label": "notch", "recorded_at": "2026-11-20T14:03:00"}, "recorded_at"),
        ({"label": "notch", "recorded_at": "2099-01-01T00:00:00Z"}, "future"),
        ({"label": "notch", "recorded_at": "9999-12-31T23:59:59-14:00"}, "future"),
        ({"label": "notch", "recorded_at": "0001-01-01T00:00:00+14:00"}, "1970"),
        ({"label": "notch", "speed_rad_s": "fast"}, "speed_rad_s"),
        ({"label": "notch", "speed_rad_s": -1}, "speed_rad_s"),
        ({"label": "notch", "motion_period_s": 3e8}, "motion_period_s"),
        ({"label": "notch", "gearbox": "a\0b"}, "gearbox"),
        ({"label": "", "gearbox": "g"}, "label"),
        ({"gearbox": "g"}, "label"),
        ({"label": "notch", "channel": 5}, "channel"),
        ({"label": "notch", "payload_kg_m2": 1e400}, "payload_kg_m2"),
        ([1], "metadata"),
    ],
)
def test_metadata_that_is_wrong(admin: httpx.Client, metadata: object, words: str) -> None:
    data = {"metadata": json.dumps(metadata)}
    answer = admin.post(CASES, files={"file": ("a.wav", sound(1))}, data=data)
    assert words in str(problem(answer, 422)["detail"])


@pytest.mark.parametrize(
    ("content", "status"),
    [
        (b"", 415),
        (b"<html>this is a page</html>", 415),
        (b"PK\x03\x04" + bytes(100), 415),
        (b"ID3\x03" + bytes(100), 415),
        (lying_wav(0xFFFFFFF0), 422),
        (sound(1)[:100], 422),
        (wav(np.zeros(8000, dtype=np.float32)), 422),
        (sound(1, seconds=0.003), 422),
    ],
    ids=["empty", "page", "zip", "mp3", "claims 4 GiB", "cut behind 28 samples", "silent", "3 ms"],
)
def test_file_that_is_no_recording(admin: httpx.Client, content: bytes, status: int) -> None:
    before = admin.get(CASES, params={"limit": 1}).json()
    data = {"metadata": '{"label": "notch"}'}
    problem(admin.post(CASES, files={"file": ("a.wav", content)}, data=data), status)
    assert admin.get(CASES, params={"limit": 1}).json() == before


def test_request_id_is_kept_and_logged_without_keys(live_server: LiveServer, admin: httpx.Client) -> None:
    answer = admin.get("/api/v1/limits", headers={"X-Request-ID": "my-own-id.7"})
    assert answer.headers["x-request-id"] == "my-own-id.7"
    entry = json.loads(live_server.logged("my-own-id.7"))
    assert (entry["status"], entry["path"]) == (200, "/api/v1/limits")
    assert not any(key in live_server.log() for key in live_server.keys.values())


def test_pages_of_others_may_not_use_us(viewer: httpx.Client) -> None:
    headers = viewer.get("/livez").headers
    assert "default-src 'self'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"


@pytest.mark.parametrize(
    ("table", "key", "value"), [("load", "inertia_kg_m2", 1e300), ("motor", "inertia_kg_m2", 1e10)]
)
def test_quantities_beyond_any_axis_are_refused_by_name(
    admin: httpx.Client, table: str, key: str, value: float
) -> None:
    axis = {"name": "vast", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 1.0}, table: {key: value}}
    detail = str(problem(admin.post("/api/v1/axes", json=axis), 422)["detail"])
    assert detail.startswith(f"{table}.{key}: must be")
    assert "<= 1e+09 kg m2" in detail
