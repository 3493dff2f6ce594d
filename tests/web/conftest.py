"""A real browser against a real service whose library holds sounds that say by themselves what they are."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field

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

from benchmarks.harness.live import ROLES, started
from benchmarks.harness.site import Site, fill
from benchmarks.harness.sounds import sound

expect.set_options(timeout=20_000)  # a busy machine is slow, not wrong
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")


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


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    recording = folder / "axis 4, monday.wav"
    recording.write_bytes(sound(7, seconds=8.0, impacts=True))
    found = Site(started(folder / "data"), recording)
    fill(found)
    yield found
    found.server.stop()


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
    session = site.server.session(role)
    context.add_cookies([{"name": name, "value": value, "url": site.url} for name, value in session.items()])


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
