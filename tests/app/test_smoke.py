"""`gearcase smoke` against a real service: all well, a wrong key, nothing there; and nothing is left that counts."""

import json
from pathlib import Path

import httpx
import pytest

from app.commands import smoke
from benchmarks.harness.live import LiveServer, gearcase

STEPS = ["/livez", "/readyz", "key", "axis", "case", "diagnosis", "list of cases"]
CLEARED = ["diagnosis rejected", "diagnosis' audio erased", "case retired", "case's audio erased", "axis removed"]


def left(admin: httpx.Client) -> list[object]:
    """What somebody would come upon: cases, axes, queue, and the audio that was made for a check."""
    documents = [admin.get(f"/api/v1/{noun}").raise_for_status().json() for noun in ("cases", "axes", "queue")]
    newest = admin.get("/api/v1/diagnoses", params={"limit": 1}).json()["items"]
    heard = [admin.get(f"/api/v1/recordings/{each['recording']['id']}/audio").status_code for each in newest]
    return [*documents, heard == [200]]


def test_all_is_well_and_nothing_is_left(
    live_server: LiveServer, admin: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = left(admin)[:3]
    monkeypatch.setenv("GEARCASE_KEY", live_server.keys["admin"])
    done = gearcase("smoke", live_server.url, "--wait", "60", data_dir=tmp_path)
    assert done.code == 0, done.stdout
    assert [line.split("  ")[1] for line in done.stdout.splitlines()] == [*STEPS, *CLEARED]
    assert all(line.startswith("ok  ") and line.endswith(" ms") for line in done.stdout.splitlines())
    assert left(admin) == [*before, False]
    (case,) = admin.get("/api/v1/cases", params={"state": "retired", "limit": 1}).json()["items"]
    steps = [each["action"] for each in admin.get(f"/api/v1/cases/{case['id']}/history").json()["items"]]
    assert steps == ["case.retained", "case.revised"]
    assert not list(tmp_path.iterdir()), "nothing of this machine is touched"


def test_what_was_made_is_cleared_away_though_a_step_failed(
    live_server: LiveServer, admin: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sound, before = smoke._sound, left(admin)[:3]
    sounds = iter([sound(), b"no sound"])
    monkeypatch.setattr(smoke, "_sound", lambda: next(sounds))
    words = ("smoke", live_server.url, "--key", live_server.keys["admin"], "--wait", "60", "--json")
    done = gearcase(*words, data_dir=tmp_path)
    document = json.loads(done.stdout)
    assert (done.code, document["ok"]) == (1, False)
    assert [step["what"] for step in document["steps"]] == [*STEPS[:6], *CLEARED[2:]]
    failed = [step for step in document["steps"] if step["problem"]]
    assert [step["what"] for step in failed] == ["diagnosis"]
    assert "415" in failed[0]["problem"]
    assert left(admin)[:3] == before


@pytest.mark.parametrize(
    ("role", "words"), [("operator", "403: This needs the role admin"), (None, "401: The key is unknown")]
)
def test_a_key_that_does_not_do(live_server: LiveServer, tmp_path: Path, role: str | None, words: str) -> None:
    key = live_server.keys[role] if role else "gearcase_" + "x" * 40
    done = gearcase("smoke", live_server.url, "--key", key, "--wait", "60", data_dir=tmp_path)
    assert done.code == 1
    assert done.stdout.splitlines()[-1].startswith("FAILED key: ")
    assert words in done.stdout
    assert key not in done.stdout + done.stderr
