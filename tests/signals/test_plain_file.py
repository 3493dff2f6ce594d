"""Only files are opened, and nothing waits for what is none."""

import os
import socket
from pathlib import Path

import pytest

from benchmarks.harness.live import gearcase
from signals.errors import NoPlainFileError
from signals.reading.plain_file import open_plain, plain_bytes


def odd(path: Path, kind: str) -> Path:
    """Make something that is no file."""
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
    else:
        path.symlink_to({"device": "/dev/zero", "link": path.parent / "elsewhere", "folder": path.parent}[kind])
    return path


@pytest.mark.parametrize("kind", ["pipe", "socket", "device", "folder"])
def test_what_is_no_file_is_refused(tmp_path: Path, kind: str) -> None:
    with pytest.raises(OSError):
        open_plain(odd(tmp_path / kind, kind))


def test_a_link_to_a_file_is_read_and_one_to_a_pipe_is_not(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"words")
    (tmp_path / "good").symlink_to("file")
    (tmp_path / "bad").symlink_to(odd(tmp_path / "pipe", "pipe"))
    assert plain_bytes(tmp_path / "good") == b"words"
    with pytest.raises(NoPlainFileError):
        plain_bytes(tmp_path / "bad")


@pytest.mark.parametrize(
    "words",
    [
        "cases import PIPE",
        "investigate --axis PIPE --telemetry PIPE",
        "investigate --axis AXIS --telemetry PIPE",
        "investigate --axis AXIS --telemetry PIPE --channels PIPE",
        "investigate --robot PIPE --telemetry PIPE",
        "simulate --train PIPE --out OUT",
        "generate --axis AXIS --plan PIPE",
        "restore PIPE",
    ],
)
def test_no_command_waits_for_a_pipe(tmp_path: Path, words: str) -> None:
    axis = tmp_path / "axis.toml"
    axis.write_text('name = "free"\n[motor]\ninertia_kg_m2 = 0.006\n[load]\ninertia_kg_m2 = 1.0\n')
    stands = {"PIPE": odd(tmp_path / "pipe", "pipe"), "AXIS": axis, "OUT": tmp_path / "out"}
    done = gearcase(*(stands.get(word, word) for word in words.split()), data_dir=tmp_path / "data")
    assert (done.code, "Traceback" in done.stderr) == (2, False)
