"""Every page of a library of 10,000 cases against the SQL that it sends; plots of 100,000 points in Chromium.

`python -m benchmarks.large` says the same with more columns, on SQLite or on PostgreSQL.
"""

import shutil
import statistics
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from benchmarks import Row, table
from benchmarks.harness.inside import inside
from benchmarks.harness.live import LiveServer, started
from benchmarks.large.library import Size
from benchmarks.large.pages import Cost, built, cost_of

WARM = 3


def run() -> list[Row]:
    """Ask for each page and for the rows behind it, the worst page first."""
    with tempfile.TemporaryDirectory() as folder:
        with inside(Path(folder) / "data") as service:
            site = built(service, Size())
            costs = sorted((cost_of(service, page) for page in site.pages.values()), key=lambda one: -one.over)
        server = started(Path(folder) / "plots")
        try:
            return [*map(_row, costs), *drawn(server)]
        finally:
            server.stop()


def _row(cost: Cost) -> Row:
    word = "reached" if cost.over <= 1 else "NOT reached"
    name = cost.path if len(cost.path) < 48 else f"{cost.path[:45]}..."
    bound = f"at most {1000 * cost.bound_s:.1f} ms: {word}"
    note = f"{cost.statements} statements, {1000 * cost.sql_s:.1f} ms; {bound}"
    return Row(f"GET {name}", cost.page_s, cost.page_s / max(cost.sql_s, 1e-6), "its SQL", note)


DRAW = """async () => {
    const committed = () => new Promise((done) => queueMicrotask(done));  // uPlot draws in a microtask
    const x = Array.from({length: 100000}, (_, k) => k / 8000);
    const y = x.map((t) => Math.sin(t * 40) * Math.random());
    const host = document.body.appendChild(document.createElement("div"));
    const began = performance.now();
    const plot = new uPlot({width: 900, height: 240, series: [{}, {stroke: "red"}]}, [x, y], host);
    await committed();
    const drawn = performance.now();
    plot.setCursor({left: 300, top: 100});
    const pointed = performance.now();
    plot.setScale("x", {min: 2, max: 4});
    await committed();
    const zoomed = performance.now();
    host.remove();
    return [drawn - began, pointed - drawn, zoomed - pointed];
}"""


def drawn(server: LiveServer) -> list[Row]:
    """Draw, point and zoom in a real browser; nothing where there is none."""
    path = shutil.which("chromium") or shutil.which("google-chrome")
    if path is None:
        return []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page()
        page.goto(f"{server.url}/sign-in")
        page.wait_for_function("() => window.uPlot")
        times = [page.evaluate(DRAW) for _ in range(WARM + 7)][WARM:]
        browser.close()
    names = ("draw 100,000 points", "move the cursor over them", "zoom into them")
    medians = [1e-3 * statistics.median(found) for found in zip(*times, strict=True)]
    return [
        Row(name, took, note=f"target <= 100 ms: {'reached' if took <= 0.1 else 'NOT reached'}")
        for name, took in zip(names, medians, strict=True)
    ]


if __name__ == "__main__":
    print(table("pages", run()))
