"""Simulations over HTTP: 202, progress live, killed worker, every case once."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import httpx

from benchmarks.harness.live import LiveServer

AXIS = {
    "name": "http-axis",
    "motor": {"inertia_kg_m2": 0.006, "coulomb_friction_n_m": 0.4},
    "stages": [
        {
            "name": "output",
            "driver_teeth": 12,
            "driven_teeth": 600,
            "stiffness_n_m_per_rad": 1.5e5,
            "damping_n_m_s_per_rad": 60.0,
            "backlash_rad": 2e-5,
            "transmission_error_rad": 1.5e-6,
        }
    ],
    "load": {"inertia_kg_m2": 40.0, "coulomb_friction_n_m": 9.0},
    "motion": {"period_s": 4.2, "load_speed_rad_s": 2.7, "acceleration_time_s": 0.3},
}
COUNTS = {"normal": 4, "notch": 3}
PATIENCE_S = 150.0


def _worker(data_dir: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "app", "--data-dir", str(data_dir), "worker"], env={**os.environ, "OMP_NUM_THREADS": "1"}
    )


Event = tuple[str, int | None, dict[str, object]]


def _events(client: httpx.Client, url: str, after: int | None = None) -> list[Event]:
    headers = {} if after is None else {"Last-Event-ID": str(after)}
    out: list[Event] = []
    with client.stream("GET", url, headers=headers, timeout=PATIENCE_S) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        kind, number = "", None
        document: dict[str, object] = {}
        for line in answer.iter_lines():
            name, _, value = line.partition(": ")
            if name == "event":
                kind = value
            elif name == "id":
                number = int(value)
            elif name == "data":
                document = json.loads(value)
            elif not line and kind:
                out.append((kind, number, document))
                kind, number = "", None
    return out


def test_a_killed_worker_neither_loses_nor_doubles_a_case(live_server: LiveServer, admin: httpx.Client) -> None:
    wanted = {"axis": AXIS, "counts": COUNTS, "seed": 11, "duration_s": 3.0}
    answer = admin.post("/api/v1/simulations", json=wanted, headers={"Idempotency-Key": "campaign-11"})
    assert answer.status_code == 202, answer.text
    job = answer.headers["Location"]
    assert job.startswith("/api/v1/jobs/")
    again = admin.post("/api/v1/simulations", json=wanted, headers={"Idempotency-Key": "campaign-11"})
    assert again.headers["Location"] == job, "the same order twice is one job"
    assert admin.get(job).json()["state"] == "queued"
    first = _worker(live_server.data_dir)
    deadline = time.monotonic() + PATIENCE_S
    while admin.get(job).json()["state"] == "queued":
        assert time.monotonic() < deadline
        time.sleep(0.1)
    time.sleep(1.0)  # it is then planning or simulating: right at any moment
    first.kill()
    first.wait()
    second = _worker(live_server.data_dir)
    try:
        events = _events(admin, f"{job}/events")
    finally:
        second.terminate()
        second.wait(60)
    assert events[-1][0] == "end"
    ended = events[-1][2]
    assert (ended["state"], ended["error"]) == ("done", None)
    numbers = [number for kind, number, _ in events if kind == "progress"]
    assert numbers == list(range(len(numbers)))
    late = _events(admin, f"{job}/events", after=len(numbers) - 2)
    assert [(kind, number) for kind, number, _ in late] == [("progress", len(numbers) - 1), ("end", None)]
    listed = admin.get("/api/v1/cases", params={"axis": "http-axis", "limit": 200}).json()["items"]
    assert {label: sum(case["label"] == label for case in listed) for label in COUNTS} == COUNTS
    assert len({case["id"] for case in listed}) == len(listed) == sum(COUNTS.values())
    assert {case["origin"] for case in listed} == {"simulated"}
    cookies = live_server.session("admin")
    page = httpx.get(live_server.url + job.removeprefix("/api/v1"), cookies=cookies, headers={"Accept": "text/html"})
    assert (page.status_code, page.headers["content-type"]) == (200, "text/html; charset=utf-8")


def test_roles_and_wrong_orders(live_server: LiveServer, admin: httpx.Client) -> None:
    wanted = {"axis": AXIS, "per_label": 1}
    with live_server.client("operator") as operator:
        assert operator.post("/api/v1/simulations", json=wanted).status_code == 403
        assert operator.get("/api/v1/jobs/no-such-job/events").status_code == 404
    with live_server.client("viewer") as viewer:
        assert viewer.get("/api/v1/jobs").status_code == 403
    wrong = admin.post("/api/v1/simulations", json={"axis": {**AXIS, "stages": []}, "per_label": 1})
    assert (wrong.status_code, wrong.headers["content-type"]) == (422, "application/problem+json")
    assert "gears" in wrong.json()["detail"]
    rust = admin.post("/api/v1/simulations", json={"axis": AXIS, "counts": {"rust": 1}})
    assert rust.status_code == 422
