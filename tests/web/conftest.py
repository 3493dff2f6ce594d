"""A real browser against a real service whose library holds sounds that say by themselves what they are."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Error,
    Page,
    Request,
    expect,
    sync_playwright,
)
from sqlalchemy.orm import Session

from app.intake import DEMO
from casebase.artifacts import add_artifact
from casebase.description import Labelling
from casebase.library import CaseLibrary
from casebase.models import StoredInvestigation, new_id, now
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.discrepancy.investigation import investigate
from sim.discrepancy.report.html import html_report
from sim.discrepancy.report.summary import story
from sim.discrepancy.results import Investigation
from tests.app.sounds import sound
from tests.live import ROLES, LiveServer, started
from tests.sim.discrepancy.telemetry_of import one_body, swing

COOKIE = "gearcase_key"
expect.set_options(timeout=20_000)  # a busy machine is slow, not wrong
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
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


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """The system's Chromium; skips with the reason where there is none."""
    path = next((found for name in NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser on the path (looked for {', '.join(NAMES)})")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield running
        running.close()


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


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    recording = folder / "axis 4, monday.wav"
    recording.write_bytes(sound(7, seconds=8.0, impacts=True))
    found = Site(started(folder / "data"), recording)
    fill(found)
    yield found
    found.server.stop()


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
    row = StoredInvestigation(
        id=new_id(),
        axis=axis.name,
        axis_document=axis.to_mapping(),
        inputs={},
        state="done",
        document=json.loads(json.dumps({**result.document(), "story": story(result)})),
        report=html_report(result),
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
            client.cookies.set(COOKIE, site.server.keys[role])
        yield client


@dataclass
class Watch:
    """What a page did that it should not have done."""

    home: str
    console: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)

    def on_console(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.console.append(message.text)

    def on_error(self, error: Error) -> None:
        self.console.append(str(error))

    def on_request(self, request: Request) -> None:
        if not request.url.startswith((self.home, "data:", "blob:")):
            self.foreign.append(request.url)

    def check(self) -> None:
        """The console is clean, with no violation of the content security policy, and nothing left the host."""
        assert self.console == []
        assert self.foreign == []


Opened = Callable[..., AbstractContextManager[Page]]
Tab = Callable[[str], AbstractContextManager[Page]]


@pytest.fixture(scope="session")
def contexts(browser: Browser, site: Site) -> Iterator[dict[str | None, BrowserContext]]:
    """A browser context of each role, and of nobody, whose pages share a cache."""
    made: dict[str | None, BrowserContext] = {role: browser.new_context() for role in (None, *ROLES)}
    for role in ROLES:
        sign_in(made[role], site, role)
    yield made
    for context in made.values():
        context.close()


def sign_in(context: BrowserContext, site: Site, role: str) -> None:
    context.add_cookies([{"name": COOKIE, "value": site.server.keys[role], "url": site.url}])


@pytest.fixture
def opened(browser: Browser, site: Site, contexts: dict[str | None, BrowserContext]) -> Opened:
    """Open a page as a role and watch it; with options, in a browser context of its own."""

    @contextmanager
    def open_page(role: str | None = "admin", path: str = "/", **options: object) -> Iterator[Page]:
        context = browser.new_context(**options) if options else contexts[role]  # type: ignore[arg-type]
        if options and role is not None:
            sign_in(context, site, role)
        page = context.new_page()
        with watched(page, site, path):
            yield page
        page.close()
        if options:
            context.close()

    return open_page


@contextmanager
def watched(page: Page, site: Site, path: str) -> Iterator[Page]:
    """Open the path; when the test is done with it, the page has done nothing that it should not."""
    watch = Watch(site.url)
    page.on("console", watch.on_console)
    page.on("pageerror", watch.on_error)
    page.on("request", watch.on_request)
    page.goto(site.url + path)
    yield page
    watch.check()
    page.remove_listener("console", watch.on_console)
    page.remove_listener("pageerror", watch.on_error)
    page.remove_listener("request", watch.on_request)


@pytest.fixture(scope="session")
def only_page(browser: Browser, site: Site) -> Iterator[Page]:
    """One page of an admin for all tests that only look."""
    context = browser.new_context(reduced_motion="reduce")
    sign_in(context, site, "admin")
    yield context.new_page()
    context.close()


@pytest.fixture
def tab(only_page: Page, site: Site) -> Tab:
    """Show a path on the one page for tests that only look: wide, light, and watched."""
    only_page.emulate_media(color_scheme="light")
    only_page.set_viewport_size({"width": 1280, "height": 720})
    return lambda path: watched(only_page, site, path)


def settle(page: Page) -> None:
    """Wait until every plot in sight is drawn."""
    page.wait_for_function(
        """() => [...document.querySelectorAll("[data-plot]")]
            .filter((plot) => plot.checkVisibility() && plot.getBoundingClientRect().top < innerHeight)
            .every((plot) => plot.dataset.ready)"""
    )
