"""A service with a demonstration, a described axis, cases, diagnoses and an investigation, and all of its pages."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import httpx
import numpy as np
from sqlalchemy.orm import Session

from app.report.investigation_report import investigation_report
from benchmarks.harness.live import LiveServer
from benchmarks.harness.sounds import sound
from benchmarks.harness.telemetry_of import one_body, swing
from casebase.description import Labelling
from casebase.library import CaseLibrary
from casebase.origins import DEMO
from casebase.store.artifacts import add_artifact
from casebase.store.models import StoredInvestigation, new_id, now
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate
from sim.investigation.report.summary import story
from sim.investigation.results import Investigation

KNOWN = ((1, "normal"), (2, "normal"), (3, "normal"), (4, "notch"))
"""Seed and label of measured cases."""
AXIS = """schema = "gearcase-axis/1"
name = "bench"
[motor]
inertia_kg_m2 = 0.006
coulomb_friction_n_m = 0.4
viscous_friction_n_m_s_per_rad = 0.0022
[[stages]]
name = "transfer"
driver_teeth = 12
driven_teeth = 96
inertia_kg_m2 = 0.02
stiffness_n_m_per_rad = 1920
damping_n_m_s_per_rad = 0.15
[[stages]]
name = "output"
driver_teeth = 12
driven_teeth = 150
stiffness_n_m_per_rad = 150000
damping_n_m_s_per_rad = 60
transmission_error_rad = 1.5e-6
[load]
inertia_kg_m2 = 40
"""
VIEWER_PAGES = (
    "/fleet",
    "/axes/bench/gearboxes/g0",
    "/axes/bench/gearboxes/g1",
    "/diagnoses",
    "/diagnoses/{diagnosis}?queue=1",
    "/queue",
    "/diagnoses/{diagnosis}",
    "/diagnoses/{diagnosis}?axis=orders",
    "/library",
    "/library/review",
    "/library/coverage",
    "/library/evaluation",
    "/cases/{case}",
    "/cases/{case}/taught",
    "/axes",
    "/axes/bench",
    "/simulate?axis=bench&gap_mrad=1&diagnose=true",
    "/first-hour",
    "/axes/bench/first-hour",
    "/investigations",
    "/investigations/{investigation}",
    "/investigations/{investigation}/compare?with={investigation}",
)
OPERATOR_PAGES = ("/diagnoses/new", "/investigations/new", "/jobs")
ADMIN_PAGES = (
    "/describe?template=spur",
    "/describe?axis=bench",
    "/describe?copy=bench",
    "/library/add",
    "/library/exchange",
    "/library/simulate",
    "/alarms",
    "/keys",
    "/audit",
)
EVERY_PAGE = (*VIEWER_PAGES, *OPERATOR_PAGES, *ADMIN_PAGES)


@dataclass
class Site:
    """A running service with a demonstration, a described axis, measured and simulated cases, and an investigation."""

    server: LiveServer
    recording: Path
    diagnosis: str = ""
    case: str = ""
    recorded: str = ""
    investigation: str = ""

    @property
    def url(self) -> str:
        return self.server.url

    def library(self) -> CaseLibrary:
        """The library behind the service; close it after use."""
        return CaseLibrary.open(self.server.data_dir)


def parts(name: str, content: bytes, metadata: bytes) -> dict[str, tuple[str | None, bytes]]:
    """The parts of a multipart request: a file and what is known of it."""
    return {"file": (name, content), "metadata": (None, metadata)}


def fill(site: Site, known: Sequence[tuple[int, str]] = KNOWN) -> None:
    """Put these cases, of two gearboxes, two simulated ones, diagnoses and an investigation into the library."""
    with site.server.client() as client:
        client.post("/api/v1/axes", content=AXIS, headers={"Content-Type": "application/toml"}).raise_for_status()
        for seed, label in known:
            metadata = {"axis": "bench", "gearbox": f"g{seed % 2}", "speed_rad_s": 2.5, "label": label}
            files = parts(f"{label}.wav", sound(seed, impacts=label == "notch"), json.dumps(metadata).encode())
            site.case = client.post("/api/v1/cases", files=files).raise_for_status().json()["id"]
        team = {"name": "maintenance team", "kind": "email", "address": "maintenance.of.the.plant@example.com"}
        told = client.post("/api/v1/alarms/receivers", json=team).raise_for_status().json()["id"]
        rule = {"name": "any fault", "kind": "state", "least_probability": 0.9, "receivers": [told]}
        client.post("/api/v1/alarms/rules", json=rule).raise_for_status()
        client.post(f"/api/v1/alarms/receivers/{told}/test").raise_for_status()
        first = client.post("/api/v1/diagnoses", files=parts("demo.wav", sound(6, impacts=True), b'{"axis": "bench"}'))
        known_of_it = b'{"axis": "bench", "gearbox": "g1", "speed_rad_s": 2.5}'
        second = client.post("/api/v1/diagnoses", files=parts("bench.wav", sound(5, impacts=True), known_of_it))
    demo, diagnosed = first.raise_for_status().json(), second.raise_for_status().json()
    site.diagnosis, site.recorded = diagnosed["id"], diagnosed["recording"]["id"]
    library = site.library()
    with library.transaction("test") as session:
        add_artifact(session, DEMO, {"diagnosis_id": demo["id"], "recording_id": demo["recording"]["id"]})
        for recording_id, label in ((demo["recording"]["id"], "notch"), (site.recorded, "normal")):
            library.retain.case(
                session, library.retrieve.recording(session, recording_id), Labelling(label, origin="simulated")
            )
        site.investigation = investigated(session)
    library.close()


@lru_cache
def investigation() -> tuple[Axis, Investigation]:
    """What a real investigation finds: friction that differs by direction, on one body with white noise."""
    motor = {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"name": "one body", "motor": motor, "load": {"inertia_kg_m2": 0.0}})
    _, _, speed, _ = swing()
    return axis, investigate(axis, one_body(0.3, 1.0, 0.02, 7, extra=0.006 * np.abs(speed)))


def investigated(session: Session) -> str:
    """Keep what the investigation finds."""
    axis, result = investigation()
    document = json.loads(json.dumps({**result.document(), "story": story(result)}))
    row = StoredInvestigation(
        id=new_id(),
        axis=axis.name,
        axis_document=axis.to_mapping(),
        inputs={},
        state="done",
        document=document,
        report=investigation_report(document, result.axis),
        created_by="test",
        finished_at=now(),
    )
    row.job_id = row.id
    session.add(row)
    session.flush()
    return row.id


@contextmanager
def browsing(site: Site, role: str | None) -> Iterator[httpx.Client]:
    """What a browser sends, without a browser: asks for HTML, has the cookie, follows nothing."""
    with site.server.client(None, follow_redirects=False) as client:
        client.headers["Accept"] = "text/html"
        if role is not None:
            client.cookies.update(site.server.session(role))
        yield client
