"""Every page of a library of 10,000 cases against the SQL that it sends; plots of 100,000 points in Chromium.

The pages are those that the browser tests open. What a page sends to the database is listened to and sent again bare.
Both are times of the processor in this process, the best of several rounds: other load on the machine changes little.
"""

import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright
from sqlalchemy import event, insert, select
from sqlalchemy.orm import Session

from benchmarks import Row, table
from casebase.models import Case, Extractor, FeatureRow, StoredDiagnosis, StoredRecording, new_id
from casebase.signals.features import EXTRACTOR_VERSION
from tests.app.inside import Inside, inside
from tests.live import LiveServer, started
from tests.web.conftest import Site
from tests.web.conftest import fill as fill_site
from tests.web.test_pages import EVERY_PAGE, address

CASES, WAITING, ROUNDS, WARM = 10_000, 2_000, 7, 3
PATIENCE_S = 1800.0
WORKING = "Being worked out"
"""What a page says while it waits for what is worked out once for a version of the library."""
LABELS = ("normal", "notch", "play")
DEEP = f"{CASES // 2:032x}"
PAGES = (*EVERY_PAGE, "/library?label=notch", "/library?axis=a3", f"/library?cursor={DEEP}", "/axes/a3/first-hour")
Statement = tuple[str, Any]


def run() -> list[Row]:
    """Ask for each page and for the rows behind it, in turns."""
    with tempfile.TemporaryDirectory() as folder:
        site = Site(started(Path(folder) / "data"), Path(folder))
        try:
            fill_site(site)
            library = site.library()
            with library.transaction("benchmark") as session:
                fill(session)
            library.close()
            rows = compared(site)
            return [*rows, *drawn(site.server)]
        finally:
            site.server.stop()


def fill(session: Session) -> None:
    """Put cases of 40 gearboxes of 8 axes into the tables, and recordings that wait for a person."""
    given = session.scalars(select(StoredDiagnosis).limit(1)).one().written
    recordings = [_recording(number) for number in range(CASES + WAITING)]
    session.execute(insert(StoredRecording), recordings)
    session.execute(insert(Case), [_case(number) for number in range(CASES)])
    session.execute(insert(FeatureRow), list(_features(session)))
    session.execute(insert(StoredDiagnosis), [_diagnosis(number, given) for number in range(CASES, CASES + WAITING)])


def _features(session: Session) -> Iterator[dict[str, object]]:
    extractor = session.get(Extractor, EXTRACTOR_VERSION)
    assert extractor is not None
    size = len(extractor.names)
    random = np.random.default_rng(1)
    middle = random.normal(size=(len(LABELS), size))
    for number in range(CASES):
        values = middle[number % 3] + random.normal(size=size)
        yield {
            "recording_id": f"{number:032x}",
            "extractor_version": EXTRACTOR_VERSION,
            "finite": values.astype(np.float32),
            "missing": bytes(-(-size // 8)),
            "motion": {},
            "events": [],
        }


def _diagnosis(number: int, given: dict[str, object]) -> dict[str, object]:
    identity = new_id()
    verdict = ("ambiguous", "not_in_library")[number % 2]
    return {
        "id": identity,
        "recording_id": f"{number:032x}",
        "verdict": verdict,
        "label": None,
        "probability": 0.5,
        "written": {**given, "id": identity, "verdict": verdict, "label": None},
        "state": "open",
        "version": 1,
        "created_by": "benchmark",
    }


def _recording(number: int) -> dict[str, object]:
    key = f"{number:032x}"
    return {
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


def _case(number: int) -> dict[str, object]:
    key = f"{number:032x}"
    return {
        "id": key,
        "recording_id": key,
        "label": LABELS[number % 3],
        "origin": "measured" if number % 5 else "simulated",
        "state": "confirmed",
        "labelled_by": "benchmark",
        "parameters": {},
        "version": 1,
        "library_version": 1,
    }


def compared(site: Site) -> list[Row]:
    """Compare every page with its SQL; what is worked out once for a version of the library is waited for."""
    rows = []
    with inside(site.server.data_dir) as service:
        for path in (address(site, page) for page in PAGES):
            if not _ready(service, path):
                rows.append(Row(f"GET {path}", PATIENCE_S, note="was not ready in time"))
                continue
            with listening(service) as sent:
                service.browse("GET", path).raise_for_status()
            rows.append(_compared(service, path, sent))
    return rows


def _ready(service: Inside, path: str) -> bool:
    """Ask until the page is there, and then some times more."""
    until = time.perf_counter() + PATIENCE_S
    ready = 0
    while ready < WARM and time.perf_counter() < until:
        answer = service.browse("GET", path)
        ready += answer.status_code == 200 and WORKING not in answer.text
        if answer.status_code not in (200, 503):
            answer.raise_for_status()
    return ready == WARM


@contextmanager
def listening(service: Inside) -> Iterator[list[Statement]]:
    """Collect what a service sends to its database."""
    sent: list[Statement] = []

    def hear(_connection: Any, _cursor: Any, statement: str, parameters: Any, _context: Any, _many: bool) -> None:
        if statement.startswith("SELECT"):
            sent.append((statement, parameters))

    engine = service.service.library.engine
    event.listen(engine, "before_cursor_execute", hear)
    yield sent
    event.remove(engine, "before_cursor_execute", hear)


def _compared(service: Inside, path: str, sent: list[Statement]) -> Row:
    connection = service.service.library.engine.raw_connection()

    def plain() -> None:
        for statement, parameters in sent:
            cursor = connection.cursor()
            cursor.execute(statement, parameters)
            cursor.fetchall()
            cursor.close()

    def page() -> None:
        service.browse("GET", path).raise_for_status()

    sql_s, page_s = (min(_processor_s(call) for _ in range(ROUNDS)) for call in (plain, page))
    connection.rollback()
    connection.close()
    bound = 1.5 * sql_s + 0.050
    word = "reached" if page_s <= bound else "NOT reached"
    name = path if len(path) < 48 else f"{path[:45]}..."
    note = f"{len(sent)} statements, {1000 * sql_s:.1f} ms; at most {1000 * bound:.1f} ms: {word}"
    return Row(f"GET {name}", page_s, page_s / max(sql_s, 1e-6), "its SQL", note)


def _processor_s(call: Callable[[], None]) -> float:
    began = time.process_time()
    call()
    return time.process_time() - began


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
