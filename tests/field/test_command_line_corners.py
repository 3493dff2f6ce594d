"""What shells, editors and pipes put before the command line."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from threading import Thread

import pytest

from app.commands import BAD_INPUT, DONE
from benchmarks.harness.live import gearcase
from benchmarks.harness.sounds import sound
from sim.description.axis_document import read_axis

TOML = 'name = "würze"\r\n[motor]\r\ninertia_kg_m2 = 0.6\r\n[load]\r\ninertia_kg_m2 = 20\r\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sound files among others: what is not sound, hidden, or in a sub-folder does not count."""
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "below").mkdir()
    (folder / "c.wav").mkdir()
    for seed, name in enumerate(("b.wav", "A.WAV", ".hidden.wav", "._a.wav", "below/d.wav", "notes.txt", "plan.toml")):
        (folder / name).write_bytes(sound(seed))
    return folder


def entries(*words: str | Path, data_dir: Path) -> list[dict[str, object]]:
    return list(json.loads(gearcase(*words, "--json", data_dir=data_dir).stdout))


def test_folder_means_its_sound_files(folder: Path, tmp_path: Path) -> None:
    added = gearcase("cases", "add", folder, "--label", "normal", "--json", data_dir=tmp_path)
    assert added.code == DONE
    expected = [str(folder / name) for name in ("A.WAV", "b.wav")]
    assert [each["file"] for each in json.loads(added.stdout)] == expected
    found = entries("diagnose", folder, folder / "below" / "d.wav", data_dir=tmp_path)
    assert [each["file"] for each in found] == [*expected, str(folder / "below" / "d.wav")]
    assert all("verdict" in each for each in found)


def test_pattern_that_the_shell_left_is_read(folder: Path, tmp_path: Path) -> None:
    found = entries("diagnose", folder / "*.wav", folder / "*.mp3", data_dir=tmp_path)
    assert [each["file"] for each in found] == [str(folder / "b.wav"), str(folder / "*.mp3")]
    assert "no such file" in str(found[1]["error"])


def test_folder_without_sound_says_what_would_be_right(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing to hear")
    done = gearcase("diagnose", tmp_path, "--json", data_dir=tmp_path / "data")
    assert done.code == BAD_INPUT
    assert "no sound file in this folder" in json.loads(done.stdout)[0]["error"]


@pytest.mark.parametrize(("name", "piped"), [("-", True), ("/dev/stdin", False), ("/dev/fd/0", True)])
def test_standard_input_is_read(name: str, piped: bool, tmp_path: Path) -> None:
    """Through a pipe and from a file: `/dev/stdin` of the process that decodes would be another."""
    command = [sys.executable, "-m", "app", "--data-dir", str(tmp_path / "data"), "diagnose", name, "--json"]
    content = sound(1)
    (tmp_path / "a.wav").write_bytes(content)
    if piped:
        done = subprocess.run(command, input=content, capture_output=True, check=False)
    else:
        with (tmp_path / "a.wav").open("rb") as file:
            done = subprocess.run(command, stdin=file, capture_output=True, check=False)
    (entry,) = json.loads(done.stdout)
    assert (entry["file"], entry["recording"]["file_name"]) == (name, "stdin.wav"), done.stderr
    assert entry["recording"]["duration_s"] == 6.0


class Standard(io.TextIOWrapper):
    """Standard input with these bytes."""

    def __init__(self, content: bytes, *, terminal: bool = False) -> None:
        super().__init__(io.BytesIO(content))
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


@pytest.mark.parametrize(
    ("content", "terminal", "words"),
    [(b"", False, "nothing came"), (bytes(2000), False, "more than 1000 bytes"), (b"", True, "is a terminal")],
)
def test_standard_input_that_has_no_sound_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: bytes, terminal: bool, words: str
) -> None:
    monkeypatch.setenv("GEARCASE_UPLOAD_BYTES", "1000")
    monkeypatch.setattr(sys, "stdin", Standard(content, terminal=terminal))
    done = gearcase("cases", "add", "-", "--label", "normal", "--json", data_dir=tmp_path)
    assert (done.code, words in json.loads(done.stdout)[0]["error"]) == (BAD_INPUT, True)


def test_pipe_is_read_and_one_without_a_writer_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "nobody")
    reading, writing = os.pipe()
    content = sound(2)  # what a pipe holds does not suffice for it

    def write() -> None:
        with os.fdopen(writing, "wb") as target:
            target.write(content)

    writer = Thread(target=write)
    writer.start()
    found = entries("diagnose", tmp_path / "nobody", f"/dev/fd/{reading}", data_dir=tmp_path / "data")
    os.close(reading)
    writer.join()
    assert "nothing came from this pipe" in str(found[0]["error"])
    assert found[1]["recording"]["duration_s"] == 6.0  # type: ignore[index]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_axis_as_editors_of_windows_write_it(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "axis.toml"
    path.write_bytes(TOML.encode(encoding))
    assert read_axis(path).name == "würze"
    path.write_bytes(json.dumps(read_axis(path).to_mapping(), ensure_ascii=False).encode(encoding))
    assert read_axis(path).name == "würze"
