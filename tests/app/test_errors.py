"""Every error is problem+json and says what was wrong and what would be right."""

import json

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


def test_unknown_path(viewer: httpx.Client) -> None:
    assert "/docs" in str(problem(viewer.get("/nowhere"), 404)["detail"])


def test_wrong_method_names_the_right_one(viewer: httpx.Client) -> None:
    answer = viewer.put("/livez")
    assert "GET" in str(problem(answer, 405)["detail"])
    assert "GET" in answer.headers["allow"]


def test_no_key(nobody: httpx.Client) -> None:
    answer = nobody.get(CASES)
    assert "Authorization" in str(problem(answer, 401)["detail"])
    assert answer.headers["www-authenticate"].startswith("Bearer")


@pytest.mark.parametrize("header", ["Bearer nonsense", "Bearer gearcase_" + "x" * 43, "Basic eDp5", "gearcase_x"])
def test_wrong_key(nobody: httpx.Client, header: str) -> None:
    problem(nobody.get(CASES, headers={"Authorization": header}), 401)


def test_role_too_low_says_which_is_needed(viewer: httpx.Client) -> None:
    detail = str(problem(viewer.post("/api/v1/keys", json={"name": "x", "role": "admin"}), 403)["detail"])
    assert "admin" in detail
    assert "viewer" in detail


def test_unknown_id(viewer: httpx.Client) -> None:
    assert "0" * 32 in str(problem(viewer.get(f"{CASES}/{'0' * 32}"), 404)["detail"])


@pytest.mark.parametrize("path", ["diagnoses", "cases", "investigations", "jobs"])
def test_word_that_is_no_id(admin: httpx.Client, path: str) -> None:
    assert "zz" in str(problem(admin.get(f"/api/v1/{path}/zz"), 404)["detail"])


def test_query_out_of_range(viewer: httpx.Client) -> None:
    document = problem(viewer.get(CASES, params={"limit": 0}), 422)
    assert document["errors"][0]["location"] == "query.limit"  # type: ignore[index]


def test_unknown_cursor(viewer: httpx.Client) -> None:
    problem(viewer.get(CASES, params={"cursor": "nonsense"}), 422)


def test_body_that_is_no_json(admin: httpx.Client) -> None:
    headers = {"content-type": "application/json"}
    document = problem(admin.post("/api/v1/keys", content=b"{", headers=headers), 422)
    assert "this is no JSON" in str(document["detail"])
    assert "names and texts in double quotes" in str(document["detail"])


def test_unknown_key_of_a_json_document(admin: httpx.Client) -> None:
    document = problem(admin.post("/api/v1/keys", json={"name": "x", "role": "viewer", "colour": 1}), 422)
    assert "colour" in str(document["detail"])


def test_upload_that_is_no_form(admin: httpx.Client) -> None:
    headers = {"content-type": "audio/wav"}
    assert "multipart" in str(problem(admin.post(CASES, content=sound(1), headers=headers), 415)["detail"])


def test_form_without_file(admin: httpx.Client) -> None:
    assert "'file'" in str(problem(admin.post(CASES, files={"sound": ("a.wav", sound(1))}), 422)["detail"])


def test_form_that_is_broken(admin: httpx.Client) -> None:
    headers = {"content-type": "multipart/form-data; boundary=x"}
    problem(
        admin.post(CASES, content=b"--x\r\nContent-Disposition: form-data\r\n\r\nabc\r\n--x--\r\n", headers=headers),
        400,
    )


def test_form_with_too_many_parts(admin: httpx.Client) -> None:
    fields = {f"field{number}": "1" for number in range(20)}
    problem(admin.post(CASES, files={"file": ("a.wav", sound(1))}, data=fields), 400)


def test_metadata_larger_than_its_limit(admin: httpx.Client) -> None:
    data = {"metadata": '{"notes": "' + "x" * 70_000 + '"}'}
    problem(admin.post(CASES, files={"file": ("a.wav", sound(1))}, data=data), 400)


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"label": "notch", "colour": "red"}, "colour"),
        ({"label": "notch", "recorded_at": "2026-11-20T14:03:00"}, "recorded_at"),
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
