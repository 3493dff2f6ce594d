"""Pages of a library of 10,000 cases, against the plain SQL behind them; plots of 100,000 points in Chromium."""

import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import httpx
from playwright.sync_api import sync_playwright
from sqlalchemy import insert, text
from sqlalchemy.orm import Session

from benchmarks import Row
from casebase.library import CaseLibrary
from casebase.models import Case, StoredRecording
from tests.live import LiveServer, started

CASES, ROUNDS, WARM = 10_000, 25, 3
LABELS = ("normal", "notch", "play")
PAGES: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("/library", "", {}),
    ("/library?label=notch", "WHERE c.label = :label", {"label": "notch"}),
    ("/library?axis=a3", "WHERE r.axis = :axis", {"axis": "a3"}),
    ("/library?cursor={deep}", "WHERE c.id < :deep", {"deep": "{deep}"}),
)
ROWS = "SELECT c.*, r.* FROM cases c JOIN recordings r ON r.id = c.recording_id {where} ORDER BY c.id DESC LIMIT 101"
COUNTS = (
    "SELECT label, origin, count(*) FROM cases WHERE state = 'confirmed' AND quarantine_reason IS NULL "
    "GROUP BY label, origin"
)
COVERAGE = (
    "SELECT r.axis, c.label, c.origin, count(*), count(DISTINCT r.gearbox) FROM cases c "
    "JOIN recordings r ON r.id = c.recording_id WHERE c.state = 'confirmed' AND c.quarantine_reason IS NULL "
    "GROUP BY r.axis, c.label, c.origin"
)


def run() -> list[Row]:
    """Ask for each page and for the rows that it shows, in turns."""
    with tempfile.TemporaryDirectory() as folder:
        server = started(Path(folder) / "data")
        library = CaseLibrary.open(server.data_dir)
        try:
            with library.transaction("benchmark") as session:
                fill(session)
            rows = [row for page in _pages() for row in _compared(server, library, *page)]
            return [*rows, *drawn(server)]
        finally:
            library.close()
            server.stop()


def fill(session: Session) -> None:
    """Put cases of 40 gearboxes of 8 axes into the tables; nothing here looks at their sound."""
    recordings: list[dict[str, object]] = []
    cases: list[dict[str, object]] = []
    for number in range(CASES):
        key, label = f"{number:032x}", LABELS[number % 3]
        recordings.append(
            {
                "id": key,
                "fingerprint": f"{number:064x}",
                "samples_sha256": f"{number:064x}",
                "sound_id": key,
                "file_sha256": f"{number:064x}",
                "file_name": f"recording {number}.wav",
                "media_type": "audio/wav",
                "byte_count": 96_044,
                "sample_rate_hz": 8000.0,
                "channel": 0,
                "channels": 1,
                "duration_s": 6.0,
                "unit": "1",
                "usable": True,
                "quality": [],
                "axis": f"a{number % 8}",
                "gearbox": f"g{number % 40}",
                "payload_kg_m2": 40.0,
                "speed_rad_s": 2.5,
                "description": {},
                "created_by": "benchmark",
            }
        )
        cases.append(
            {
                "id": key,
                "recording_id": key,
                "label": label,
                "origin": "measured" if number % 5 else "simulated",
                "state": "confirmed",
                "labelled_by": "benchmark",
                "parameters": {},
                "version": 1,
                "library_version": 1,
            }
        )
    session.execute(insert(StoredRecording), recordings)
    session.execute(insert(Case), cases)


def _pages() -> list[tuple[str, list[tuple[str, dict[str, str]]]]]:
    deep = f"{CASES // 2:032x}"
    found = [
        (
            path.format(deep=deep),
            [(ROWS.format(where=where), {k: v.format(deep=deep) for k, v in given.items()}), (COUNTS, {})],
        )
        for path, where, given in PAGES
    ]
    return [*found, ("/library/coverage", [(COVERAGE, {})])]


def _compared(
    server: LiveServer, library: CaseLibrary, path: str, queries: list[tuple[str, dict[str, str]]]
) -> list[Row]:
    def plain() -> None:
        with library.reading() as session:
            for statement, given in queries:
                session.execute(text(statement), given).all()

    with server.client(None) as client:
        client.headers["Accept"] = "text/html"
        client.cookies.set("gearcase_key", server.keys["viewer"])

        def page() -> httpx.Response:
            return client.get(path).raise_for_status()

        sql_s, page_s = _medians(plain, page)
    bound = 1.5 * sql_s + 0.050
    word = "reached" if page_s <= bound else "NOT reached"
    name = path if len(path) < 40 else f"{path[:34]}..."
    note = f"target <= {1000 * bound:.1f} ms (1.5 x + 50 ms): {word}"
    return [Row(f"plain SQL of {name}", sql_s), Row(f"GET {name}", page_s, page_s / sql_s, "plain SQL", note)]


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


def _medians(*calls: Callable[[], object]) -> list[float]:
    """Return the median time of each call [s]; they take turns."""
    times: list[list[float]] = [[] for _ in calls]
    for number in range(WARM + ROUNDS):
        for call, found in zip(calls, times, strict=True):
            start = time.perf_counter()
            call()
            if number >= WARM:
                found.append(time.perf_counter() - start)
    return [statistics.median(found) for found in times]


if __name__ == "__main__":
    from benchmarks import table

    print(table("pages", run()))
