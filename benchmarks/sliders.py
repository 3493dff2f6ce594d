"""Moving a slider of the page *Simulate*: over HTTP, and in a browser until the picture is drawn; in half a second.

The reference is the simulated sound's own length: 8 s are made anew at every position.
"""

import shutil
import tempfile
import time
from pathlib import Path

import httpx
import numpy as np
from playwright.sync_api import sync_playwright

from app.web.pages.simulate import sliders
from benchmarks import Row
from benchmarks.harness.live import LiveServer, started
from sim.experiment.paper_axis import PAPER_AXIS

MOVES, SOUND_S, TARGET = 20, 8.0, "target < 500 ms"
PAGE = "/simulate"
SLIDERS = sliders(PAPER_AXIS)
MOVE = """async ([name, value]) => {
    const began = performance.now();
    const drawn = new Promise((done) => addEventListener("htmx:afterSettle", done, { once: true }));
    const slider = document.getElementById(`${name}-range`);
    slider.value = value;
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    await drawn;
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    return (performance.now() - began) / 1000;
}"""
"""Time from the slider's input until its picture stands on the screen [s]."""


def run() -> list[Row]:
    """Ask for the page the moment the service answers, then move every slider anywhere in its range."""
    with tempfile.TemporaryDirectory() as folder:
        server = started(Path(folder) / "data")
        try:
            with page_client(server) as client:
                first = taken(client, {})
                served = [taken(client, {name: value}) for name, value in moves(1)]
                again = [taken(client, {name: value}) for name, value in moves(1)]
            shown = in_browser(server)
        finally:
            server.stop()
    words = f"of the sound's {SOUND_S:g} s"
    return [
        Row("first page, the moment the service answers", first, first / SOUND_S, words),
        *(
            Row(name, seconds, seconds / SOUND_S, words, TARGET)
            for name, seconds in (
                (f"page, median of {MOVES} moves", float(np.median(served))),
                ("page, slowest move", max(served)),
                ("page, median of moving back", float(np.median(again))),
                (f"picture in the browser, median of {MOVES} moves", float(np.median(shown))),
                ("picture in the browser, slowest move", max(shown)),
            )
        ),
    ]


def page_client(server: LiveServer) -> httpx.Client:
    client = server.client("viewer")
    client.headers["Accept"] = "text/html"
    client.cookies.set("gearcase_key", server.keys["viewer"])
    return client


def moves(seed: int) -> list[tuple[str, float]]:
    """Names and values: one slider after the other, anywhere in its range."""
    random = np.random.default_rng(seed)
    wanted = [SLIDERS[k % len(SLIDERS)] for k in range(MOVES)]
    return [(one.name, float(random.uniform(one.low, one.high))) for one in wanted]


def taken(client: httpx.Client, position: dict[str, float]) -> float:
    """Return the time until the page with this position is here [s]."""
    start = time.perf_counter()
    client.get(PAGE, params=position).raise_for_status()
    return time.perf_counter() - start


def in_browser(server: LiveServer) -> list[float]:
    """Return the time of each move in the system's Chromium, with the sound that follows [s]."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        context = browser.new_context()
        context.add_cookies([{"name": "gearcase_key", "value": server.keys["viewer"], "url": server.url}])
        page = context.new_page()
        page.goto(server.url + PAGE, wait_until="networkidle")
        found = []
        for name, value in moves(2):
            found.append(float(page.evaluate(MOVE, [name, value])))
            page.wait_for_timeout(300)
        browser.close()
    return found
