"""A watch folder: each finished recording is sent once, through kills of either side."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from app.commands import record
from app.recordings.watch_folder import MEMORY, Memory, Sent, WatchFolder
from benchmarks.harness.live import LiveServer, gearcase
from benchmarks.harness.sounds import sound
from tests.app.alarms.receivers import free_port, wait_for


@pytest.fixture
def server(tmp_path: Path) -> Iterator[LiveServer]:
    """A service that is not started yet, on a port of its own, and a key to it."""
    server = LiveServer(tmp_path / "data", port=free_port())
    made = gearcase("keys", "create", "--role", "operator", "--name", "recorder", data_dir=server.data_dir)
    server.keys["operator"] = made.stdout.strip()
    server.url = f"http://127.0.0.1:{server.port}"
    yield server
    if server.running:
        server.kill()


def diagnoses(server: LiveServer) -> list[str]:
    with server.client("operator") as client:
        return [each["recording"]["file_name"] for each in client.get("/api/v1/diagnoses").json()["items"]]


def test_each_recording_is_sent_once(server: LiveServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    whole, half = sound(1), sound(2)
    (folder / "a.wav").write_bytes(whole)
    (folder / "b.wav").write_bytes(half[: len(half) // 2])
    (folder / "notes.txt").write_text("not a recording")
    monkeypatch.setenv("GEARCASE_KEY", server.keys["operator"])
    words = ["watch", str(folder), "--url", server.url, "--axis", "bench", "--gearbox", "g1", "--settle", "0.2"]
    log = tmp_path / "watch.log"
    with log.open("w") as said:
        watcher = subprocess.Popen(
            [sys.executable, "-m", "app", *words], stdout=said, stderr=said, env={**os.environ, "PYTHONUNBUFFERED": "1"}
        )
    wait_for(lambda: "does not answer" in log.read_text(), "an attempt while the service is away")
    server.start()
    wait_for(lambda: "a.wav: " in log.read_text(), "the first recording's diagnosis")
    watcher.kill()
    watcher.wait()
    assert diagnoses(server) == ["a.wav"], "what is half written waits"
    assert server.keys["operator"] not in log.read_text()

    (folder / "b.wav").write_bytes(half)
    (folder / "a under another name.wav").write_bytes(whole)
    (folder / "c.wav").write_bytes(b"no sound" * 400)
    done = gearcase(*words, "--once", data_dir=tmp_path / "elsewhere")
    assert done.code == 2, done.stderr
    assert diagnoses(server) == ["b.wav", "a.wav"]
    assert "c.wav: refused: the service answered 415" in done.stdout

    # killed after the service took it and before that was remembered
    remembered = (folder / MEMORY).read_text().splitlines(keepends=True)
    (folder / MEMORY).write_text("".join(line for line in remembered if "b.wav" not in line) + '{"name": "b.w')
    done = gearcase(*words, "--once", "--move-to", tmp_path / "sent", data_dir=tmp_path / "elsewhere")
    assert done.code == 0, done.stderr
    assert diagnoses(server) == ["b.wav", "a.wav"]
    assert "c.wav" not in done.stdout, "what was refused is not sent again"
    assert sorted(each.name for each in (tmp_path / "sent").iterdir()) == [
        "a under another name.wav",
        "a.wav",
        "b.wav",
    ]
    done = gearcase(*words, "--once", data_dir=tmp_path / "elsewhere")
    assert done.stdout == ""


def test_once_gives_up_where_the_service_stays_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GEARCASE_KEY", "gearcase_any")
    monkeypatch.setattr(record, "EVERY_S", 0.01)
    monkeypatch.setattr(record, "LONGEST_ONCE_S", 0.05)
    (tmp_path / "a.wav").write_bytes(sound(1))
    away = f"http://127.0.0.1:{free_port()}"
    done = gearcase("watch", tmp_path, "--url", away, "--settle", "0", "--once", data_dir=tmp_path / "data")
    assert done.code == 1
    assert away in done.stderr.splitlines()[-1]


def test_a_key_that_is_none_ends_it_with_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GEARCASE_KEY", raising=False)
    done = gearcase("watch", tmp_path, "--once", data_dir=tmp_path / "data")
    assert done.code == 2
    assert "GEARCASE_KEY" in done.stderr


def test_a_file_that_grows_is_not_finished(tmp_path: Path) -> None:
    """However short the looks are apart, a file is as old as its last change; a header tells what is still to come."""
    content = sound(1, seconds=1.0)
    path = tmp_path / "a.wav"
    watched = WatchFolder(tmp_path, Memory(tmp_path / MEMORY), settled_s=0.05)
    for end in (100, 2000, len(content) - 1):
        path.write_bytes(content[:end])
        assert list(watched.look()) == []
        assert watched.unsettled == 1
        time.sleep(0.06)
        assert list(watched.look()) == []
        assert watched.incomplete == {"a.wav"}
    path.write_bytes(content)
    assert list(watched.look()) == []
    time.sleep(0.06)
    ((found, sent),) = watched.look()
    assert found == path
    watched.memory.add(replace(sent, diagnosis_id="1"))
    assert list(watched.look()) == []


def test_a_memory_that_was_broken_off_loses_only_that_line(tmp_path: Path) -> None:
    memory = Memory(tmp_path / MEMORY)
    memory.add(Sent("a.wav", 1, 2, "aa", "1"))
    with memory.path.open("a") as file:
        file.write(json.dumps({"name": "b.wav"})[:5])
    Memory(memory.path).add(Sent("c.wav", 1, 2, "cc", refused="no sound"))
    found = Memory(memory.path)
    assert found.by_content("aa") == Sent("a.wav", 1, 2, "aa", "1")
    assert found.by_file("c.wav", 1, 2) == Sent("c.wav", 1, 2, "cc", refused="no sound")
