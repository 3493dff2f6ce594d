"""Moving a slider of the paper's axis beside a recording, over HTTP: simulation, features and page, in 300 ms.

The reference is the simulated sound's own length: 8 s are made anew at every position.
"""

import json
import os
import tempfile
import time
from pathlib import Path

import httpx
import numpy as np

from app.web.pages.model import SLIDERS
from app.web.trial import SHOWN_S
from benchmarks import Row
from sim.experiment.paper_axis import PAPER_AXIS
from tests.app.sounds import sound
from tests.live import LiveServer, started

POSITIONS, SETTLE_S, TARGET = 60, 10.0, "target < 300 ms"
PAGE = f"/axes/{PAPER_AXIS.name}/try"


def run() -> list[Row]:
    """Ask for the page the moment the service answers, after a restart that is left alone, and at many positions."""
    with tempfile.TemporaryDirectory() as folder:
        server = started(Path(folder) / "data")
        try:
            with page_client(server) as client:
                client.post("/api/v1/axes", json=PAPER_AXIS.to_mapping()).raise_for_status()
                at_once = taken(client, {})
                known = {"axis": PAPER_AXIS.name, "speed_rad_s": PAPER_AXIS.motion.load_speed_rad_s}
                files = {"file": ("x.wav", sound(1, seconds=20.0, impacts=True))}
                client.post("/api/v1/diagnoses", files=files, data={"metadata": json.dumps(known)}).raise_for_status()
            server.stop()
            server.start()
            time.sleep(SETTLE_S)
            with page_client(server) as client:
                before = processor_s(server)
                first = taken(client, {})
                worked = processor_s(server)
                opened = worked - before
                moved = [taken(client, position) for position in positions()]
                worked = (processor_s(server) - worked) / len(moved)
        finally:
            server.stop()
    words = "of the sound's 8 s"
    return [
        Row("first page, the moment the service answers", at_once, at_once / SHOWN_S, words),
        Row(f"first page {SETTLE_S:g} s after the start", first, first / SHOWN_S, words, TARGET),
        Row(f"median of {POSITIONS} positions", median := float(np.median(moved)), median / SHOWN_S, words, TARGET),
        Row("slowest position", max(moved), max(moved) / SHOWN_S, words, TARGET),
        Row("processor time of the service, first page", opened, opened / SHOWN_S, words, "as on an idle machine"),
        Row("processor time of the service, a position", worked, worked / SHOWN_S, words, "as on an idle machine"),
    ]


def processor_s(server: LiveServer) -> float:
    """Return the processor time that the service has taken so far [s]; Linux alone says it."""
    assert server.process is not None
    user, system = Path(f"/proc/{server.process.pid}/stat").read_text().rpartition(") ")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def page_client(server: LiveServer) -> httpx.Client:
    client = server.client("admin")
    client.headers["Accept"] = "text/html"
    client.cookies.set("gearcase_key", server.keys["admin"])
    return client


def positions() -> list[dict[str, float]]:
    """All sliders anywhere in their ranges."""
    random = np.random.default_rng(1)
    return [{one.name: float(random.uniform(one.low, one.high)) for one in SLIDERS} for _ in range(POSITIONS)]


def taken(client: httpx.Client, position: dict[str, float]) -> float:
    """Return the time until the page with this position is here [s]."""
    start = time.perf_counter()
    client.get(PAGE, params=position).raise_for_status()
    return time.perf_counter() - start
