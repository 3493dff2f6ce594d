"""Erased over HTTP, on pages and by command: the sound is gone everywhere, its diagnosis is still shown."""

import json
from pathlib import Path

import httpx
import pytest

from benchmarks.harness.live import LiveServer, sign_in
from benchmarks.harness.sounds import hum, sound, wav
from tests.app.test_cases import add
from tests.app.test_command_line import gearcase

SHOWN = ("audio", "waveform", "spectrum", "spectrogram", "crest")


def diagnosed(client: httpx.Client, content: bytes) -> dict[str, object]:
    files = {"file": ("a sound.wav", content, "audio/wav")}
    answer = client.post("/api/v1/diagnoses", files=files, data={"metadata": json.dumps({"gearbox": "e1"})})
    answer.raise_for_status()
    document: dict[str, object] = answer.json()
    return document


def test_what_shows_the_audio_is_gone_and_what_was_found_stays(admin: httpx.Client) -> None:
    given = diagnosed(admin, sound(901))
    recording = f"/api/v1/recordings/{given['recording']['id']}"  # type: ignore[index]
    etag = admin.get(f"{recording}/audio").headers["etag"]
    answer = admin.delete(recording)
    assert answer.status_code == 200
    assert answer.json()["recordings"] == [given["recording"]["id"]]  # type: ignore[index]
    for name in SHOWN:
        gone = admin.get(f"{recording}/{name}")
        assert (gone.status_code, gone.headers["content-type"]) == (410, "application/problem+json")
        assert "erased on" in gone.json()["detail"]
    assert admin.get(f"{recording}/audio", headers={"If-None-Match": etag}).status_code == 410
    assert admin.head(f"{recording}/audio").status_code == 410
    assert admin.get(f"{recording}/features").status_code == 200
    assert admin.get(recording).json()["erased_at"] == answer.json()["erased_at"]
    assert admin.get(f"/api/v1/diagnoses/{given['id']}").json()["verdict"] == given["verdict"]
    assert admin.delete(recording).json() == answer.json()


def test_reports_and_pages_are_shown_without_the_sound(admin: httpx.Client, live_server: LiveServer) -> None:
    given = diagnosed(admin, sound(903, impacts=True))
    case = add(admin, sound(904, impacts=True), label="notch").json()
    browser = httpx.Client(base_url=live_server.url, follow_redirects=True, timeout=120)
    sign_in(browser, live_server.keys["admin"]).raise_for_status()
    for path, recording in (
        (f"/diagnoses/{given['id']}", given["recording"]["id"]),  # type: ignore[index]
        (f"/cases/{case['id']}", case["recording"]["id"]),
    ):
        page = browser.get(path).text
        assert "/sound" in page
        csrf = page.split('name="csrf" value="')[1].split('"')[0]
        form = {"csrf": csrf, "back": path}
        assert browser.post(f"/recordings/{recording}/erase", data=form).status_code == 422, "without being sure"
        elsewhere = {**form, "sure": "yes", "back": "//elsewhere"}
        assert browser.post(f"/recordings/{recording}/erase", data=elsewhere).status_code == 422
        assert browser.get(f"/recordings/{recording}/sound").status_code == 200
        erased = browser.post(f"/recordings/{recording}/erase", data={**form, "sure": "yes"})
        assert (erased.status_code, erased.url.path) == (200, path)
        assert "The audio was erased" in erased.text
        assert f"/recordings/{recording}/" not in erased.text
        assert browser.get(f"/recordings/{recording}/sound").status_code == 410
        assert browser.get(f"/recordings/{recording}/plots/waveform").status_code == 410
        assert browser.get(f"/recordings/{recording}/spectrogram.png").status_code == 410
    report = browser.get(f"/diagnoses/{given['id']}/report.html")
    assert (report.status_code, "The audio was erased" in report.text) == (200, True)
    browser.close()


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, dict[str, object]]:
    """A data folder with one case."""
    (tmp_path / "a.wav").write_bytes(sound(1))
    done = gearcase(
        "cases", "add", tmp_path / "a.wav", "--label", "notch", "--gearbox", "g1", "--json", data_dir=tmp_path / "data"
    )
    return tmp_path / "data", json.loads(done.stdout)[0]


def test_command_line_erases_once_it_is_sure(recorded: tuple[Path, dict[str, object]]) -> None:
    folder, case = recorded
    identity = str(case["recording"]["id"])  # type: ignore[index]
    assert gearcase("recordings", "erase", identity, "--json", data_dir=folder).code == 2
    assert gearcase("backup", folder.parent / "before", data_dir=folder).code == 0
    done = gearcase("recordings", "erase", identity, "--yes", "--json", data_dir=folder)
    assert json.loads(done.stdout)[0]["recordings"] == [identity]
    assert gearcase("backup", folder.parent / "after", data_dir=folder).code == 0
    new = folder.parent / "new"
    back = gearcase("restore", folder.parent / "before", "--erased", folder.parent / "after", "--json", data_dir=new)
    assert json.loads(back.stdout)["erased_again"] == 1
    assert list((new / "audio").glob("??/*")) == []
    assert gearcase("recordings", "expire", "--yes", data_dir=folder).code == 2
    done = gearcase("recordings", "expire", "--days", "1", "--yes", "--json", data_dir=folder)
    assert json.loads(done.stdout) == {"days": 1, "erased": []}


def test_command_line_says_that_a_sound_is_there(recorded: tuple[Path, dict[str, object]]) -> None:
    folder, case = recorded
    assert case["exists"] is False
    (folder.parent / "quiet.wav").write_bytes(wav(0.5 * hum(6.0, 1)))

    def added(label: str, gearbox: str) -> tuple[int, dict[str, object]]:
        words = ("cases", "add", folder.parent / "quiet.wav", "--label", label, "--gearbox", gearbox, "--json")
        done = gearcase(*words, data_dir=folder)
        return done.code, json.loads(done.stdout)[0]

    code, entry = added("notch", "g1")
    assert (code, entry["id"], entry["exists"]) == (0, case["id"], True)
    for label, gearbox in (("normal", "g1"), ("notch", "g2")):
        code, entry = added(label, gearbox)
        assert (code, entry["case"]) == (2, {"id": case["id"], "label": "notch", "gearbox": "g1"})
