"""Busy: who would wait too long for others is asked to come again; the health check knows who is well."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from app.settings import Settings
from benchmarks.harness.live import started
from benchmarks.harness.sounds import sound
from benchmarks.harness.wire import connected, head
from casebase.store.leases import beat_file

PATH = "/api/v1/diagnoses"


def test_who_would_wait_too_long_comes_again(tmp_path: Path) -> None:
    """One upload at once: the first sends nothing of its body, and the next ones do not wait for it."""
    server = started(tmp_path / "data", GEARCASE_UPLOADS_AT_ONCE="1", GEARCASE_LONGEST_WAIT_S="0.2")
    try:
        with connected(server) as slow, server.client() as client:
            kind = "multipart/form-data; boundary=b"
            begin = {"Content_Type": kind, "Content_Length": "1000", "Expect": "100-continue"}
            slow.sendall(head(server, "POST", PATH, "admin", **begin))
            assert b" 100 " in slow.recv(100)  # its body is being read
            files = {"file": ("a.wav", sound(1, seconds=1.0), "audio/wav")}
            answers = [client.post(PATH, files=files)]
            assert answers[-1].status_code == 503
            assert int(answers[-1].headers["retry-after"]) > 0
            assert client.get("/livez").status_code == 200
            slow.close()
            while answers[-1].status_code == 503 and len(answers) < 100:
                answers.append(client.post(PATH, files=files))
            assert answers[-1].status_code == 201
    finally:
        server.stop()


@pytest.mark.parametrize("password", ["qz@qz", "qz/qz", "12/qz", "qz#qz", "qz?qz", "qz[qz", "qz@b/c:qz"])
def test_a_password_that_breaks_the_url_is_shown_in_no_part(password: str) -> None:
    with pytest.raises(ValueError) as refused:
        Settings(database_url=f"postgresql://gearcase:{password}@database:5432/gearcase")
    assert "%40" in str(refused.value)
    assert "qz" not in str(refused.value)
    assert Settings(database_url="postgresql://gearcase:p%40ss%2F@database:5432/gearcase").database_url
    assert Settings(database_url="sqlite:////a/b@c").database_url


def test_the_health_of_a_worker_is_that_it_beats(tmp_path: Path) -> None:
    def health() -> int:
        environment = {**os.environ, "GEARCASE_DATA_DIR": str(tmp_path)}
        return subprocess.run([sys.executable, "-m", "app.health"], env=environment, check=False).returncode

    assert health() == 1
    beat = beat_file(tmp_path)
    beat.parent.mkdir()
    beat.touch()
    assert health() == 0
    os.utime(beat, (0, beat.stat().st_mtime - 60))
    assert health() == 1
