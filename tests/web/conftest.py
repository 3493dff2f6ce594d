"""A real browser against a real service whose library was filled by the simulator."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, Request, sync_playwright

from tests.app.sounds import sound
from tests.live import LiveServer, gearcase, started

COOKIE = "gearcase_key"
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
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
    """A running service with a demonstration, a described axis and a few measured recordings."""

    server: LiveServer
    recording: Path
    diagnosis: str = ""
    case: str = ""
    recorded: str = ""

    @property
    def url(self) -> str:
        return self.server.url


def parts(name: str, content: bytes, metadata: bytes) -> dict[str, tuple[str | None, bytes]]:
    """The parts of a multipart request: a file and what is known of it."""
    return {"file": (name, content), "metadata": (None, metadata)}


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    data_dir = folder / "data"
    data_dir.mkdir()
    gearcase("starter", "--per-label", "2", data_dir=data_dir)
    recording = folder / "axis 4, monday.wav"
    recording.write_bytes(sound(7, seconds=8.0, impacts=True))
    server = started(data_dir)
    found = Site(server, recording)
    with server.client() as client:
        client.post("/api/v1/axes", content=AXIS, headers={"Content-Type": "application/toml"}).raise_for_status()
        for seed in (1, 2):
            metadata = b'{"axis": "bench", "gearbox": "g1", "speed_rad_s": 2.5, "label": "normal"}'
            files = parts("normal.wav", sound(seed), metadata)
            found.case = client.post("/api/v1/cases", files=files).raise_for_status().json()["id"]
        files = parts("bench.wav", sound(5, impacts=True), b'{"axis": "bench"}')
        diagnosed = client.post("/api/v1/diagnoses", files=files).raise_for_status().json()
        found.diagnosis, found.recorded = diagnosed["id"], diagnosed["recording"]["id"]
    yield found
    server.stop()


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

    def on_request(self, request: Request) -> None:
        if not request.url.startswith((self.home, "data:", "blob:")):
            self.foreign.append(request.url)

    def check(self) -> None:
        """The console is clean, with no violation of the content security policy, and nothing left the host."""
        assert self.console == []
        assert self.foreign == []


Opened = Callable[..., AbstractContextManager[Page]]
Tab = Callable[[str], AbstractContextManager[Page]]


@pytest.fixture
def opened(browser: Browser, site: Site) -> Opened:
    """Open a page as a role and watch it."""

    @contextmanager
    def open_page(role: str | None = "admin", path: str = "/", **options: object) -> Iterator[Page]:
        context: BrowserContext = browser.new_context(**options)  # type: ignore[arg-type]
        if role is not None:
            context.add_cookies([{"name": COOKIE, "value": site.server.keys[role], "url": site.url}])
        with watched(context, site, path) as page:
            yield page
        context.close()

    return open_page


@contextmanager
def watched(context: BrowserContext, site: Site, path: str) -> Iterator[Page]:
    """A page of its own that is closed after having done nothing that it should not."""
    watch = Watch(site.url)
    page = context.new_page()
    page.on("console", watch.on_console)
    page.on("pageerror", lambda error: watch.console.append(str(error)))
    page.on("request", watch.on_request)
    page.goto(site.url + path)
    yield page
    watch.check()
    page.close()


def tabs(browser: Browser, site: Site, **options: object) -> Iterator[Tab]:
    """One browser context of an admin whose pages share a cache, for tests that only look."""
    context: BrowserContext = browser.new_context(**options)  # type: ignore[arg-type]
    context.add_cookies([{"name": COOKIE, "value": site.server.keys["admin"], "url": site.url}])
    yield lambda path: watched(context, site, path)
    context.close()


@pytest.fixture(scope="session")
def tab(browser: Browser, site: Site) -> Iterator[Tab]:
    yield from tabs(browser, site, reduced_motion="reduce")


@pytest.fixture(scope="session")
def plain(browser: Browser, site: Site) -> Iterator[Tab]:
    yield from tabs(browser, site, java_script_enabled=False)
