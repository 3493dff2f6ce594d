"""POST /diagnoses of a 30 s recording, against the sum of its parts in this process."""

import json
import tempfile
import time
from pathlib import Path

import httpx
import numpy as np

from benchmarks import Row
from benchmarks.harness.live import started
from benchmarks.harness.sounds import hum, wav
from casebase.library import CaseLibrary
from signals.features import extract
from signals.fingerprint import fingerprints
from signals.reading.decode import read_recording, warm_up

SECONDS, CASES, ROUNDS, WARM, SETTLE = 30, 20, 23, 3, 60


def run() -> list[Row]:
    """Let the two take turns on recordings that neither has seen."""
    with tempfile.TemporaryDirectory() as folder:
        server = started(Path(folder) / "data")
        library = CaseLibrary.open(server.data_dir)
        try:
            with server.client() as client:
                _fill(client)
                served, alone = _measure(client, library, Path(folder) / "x.wav")
        finally:
            library.close()
            server.stop()
    bound = 1.5 * alone + 0.010
    reference = "decode + fingerprint + features + retrieval in process"
    note = f"target <= {1000 * bound:.1f} ms (1.5 x + 10 ms)"
    return [Row(reference, alone), Row("POST /diagnoses of 30 s, 8 kHz", served, served / alone, reference, note)]


def _fill(client: httpx.Client) -> None:
    for number in range(CASES):
        notch = number % 2 == 1
        data = {"metadata": json.dumps({"label": "notch" if notch else "normal", "gearbox": f"g{number // 4}"})}
        content = wav(hum(6, number, impacts=notch))
        client.post("/api/v1/cases", files={"file": ("x.wav", content)}, data=data).raise_for_status()


def _measure(client: httpx.Client, library: CaseLibrary, path: Path) -> tuple[float, float]:
    """Return the median times of the service and of the same work in this process [s]."""
    served, alone = [], []
    warm_up()
    for number in range(ROUNDS):
        content = wav(hum(SECONDS, 1000 + number, impacts=True))
        start = time.perf_counter()
        client.post("/api/v1/diagnoses", files={"file": ("x.wav", content)}).raise_for_status()
        served.append(time.perf_counter() - start)
        path.write_bytes(content)
        with library.reading() as session:
            reasoner = library.reuse.reasoner(session)
        start = time.perf_counter()
        recording = read_recording(path)
        fingerprints(recording)
        reasoner.diagnose(extract(recording))
        alone.append(time.perf_counter() - start)
    return float(np.median(served[WARM:])), float(np.median(alone[WARM:]))
