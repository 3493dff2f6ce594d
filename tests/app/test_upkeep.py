"""What goes on beside the requests: the service is ready once no first request waits."""

import subprocess
import sys
from pathlib import Path

import httpx

from benchmarks.harness.live import started
from benchmarks.harness.sounds import sound

PROGRAM = """
import sys
from pathlib import Path
from app.upkeep import diagnose_once
from casebase.library import CaseLibrary
library = CaseLibrary.open(Path(sys.argv[1]))
diagnose_once(library)
with library.reading() as session:
    kept = library.retrieve.counts(session)
print(len(kept), *sys.modules)
"""


def test_what_a_diagnosis_needs_is_loaded_and_nothing_is_kept(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM, tmp_path], capture_output=True, text=True, check=True)
    kept, *modules = done.stdout.split()
    assert kept == "0"
    assert {"numba", "scipy.signal", "scipy.stats", "scipy.optimize"} <= set(modules)


def test_not_ready_is_said_and_then_ready(tmp_path: Path) -> None:
    server = started(tmp_path / "data")
    first = httpx.get(f"{server.url}/readyz")
    if first.status_code == 503:
        assert "still being loaded" in first.json()["detail"]
    server.until_ready()
    with server.client() as client:
        files = {"file": ("a.wav", sound(1), "audio/wav")}
        assert client.post("/api/v1/diagnoses", files=files).status_code == 201
    server.stop()
