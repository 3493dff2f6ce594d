"""Every page of a site, and what it costs: statements, rows and bytes that it reads, bytes that it sends, time."""

import json
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from fastapi.routing import APIRoute
from sqlalchemy import event

from app.main import PAGES as ROUTERS
from benchmarks.harness.inside import Inside
from benchmarks.harness.site import AXIS, EVERY_PAGE, KNOWN, investigated
from benchmarks.harness.sounds import sound
from benchmarks.harness.worked_out import WORKING
from benchmarks.large.library import LONG, Size, fill

SHARE, OVERHEAD_S = 1.5, 0.050
"""A page of a library of 10,000 cases takes at most this share of its SQL, and so much more [s]."""
HEARD_EVERY_DAY = f"/axes/{LONG[0]}/gearboxes/{LONG[1]}"
OF_LARGE = (
    "/",
    "/sign-in",
    "/library?label=notch",
    "/library?axis=a3",
    "/library?axis=a3&label=play&origin=simulated",
    "/library?gearbox=g7",
    "/library?verification=opened",
    "/library?state=retired",
    "/library?first=5000&sort=recording",
    "/library?search=g7+backlash",
    "/library/evaluation?origin=measured",
    "/library/simulate?axis=a3",
    "/diagnoses?verdict=ambiguous",
    "/diagnoses?verdict=diagnosed",
    "/axes/a3",
    "/axes/a3/first-hour",
    "/axes/a3/gearboxes/g3",
    HEARD_EVERY_DAY,
    f"{HEARD_EVERY_DAY}?history=1&before={{daily}}",
    f"{HEARD_EVERY_DAY}?from=2020-01-01&with=g0",
    f"{HEARD_EVERY_DAY}?chart=0",
    "/axes/bench/gearboxes",
    "/axes/bench/axis.toml",
    "/diagnoses?search=g7&sort=gearbox",
    "/fleet?search=g7&sort=last_recording",
    "/audit?search=case&first=1000",
    "/docs",
    "/names/gearbox?axis=a3&search=7",
    "/diagnoses/{diagnosis}/report.html",
    "/investigations/{investigation}/report.html",
    "/recordings/{recording}/plots/waveform",
    "/jobs/{job}",
)
NO_PAGES = {
    "/audit.csv": "all of the log, as a file",
    "/library/export.zip": "all cases, as a file",
    "/investigations/{investigation_id}/work-sheet": "paper",
    "/investigations/{investigation_id}/panels/{part}/{number}": "numbers of one investigation",
    "/recordings/{recording_id}/sound": "a file",
    "/recordings/{recording_id}/spectrogram.png": "a picture of one file",
    "/demonstration.wav": "a file",
    "/simulate/sound.wav": "a file",
    "/robots/{name}": "reads one robot",
    "/robots/{name}/robot.toml": "a file of one robot",
    "/robots/{name}/robot.urdf": "a file of one robot",
}
"""What is asked for like a page and is none of a library, and why."""
Statement = tuple[str, Any]


def routes() -> list[APIRoute]:
    """Every route of the pages that is read."""
    known = (route for router in ROUTERS for route in router.routes)
    return [route for route in known if isinstance(route, APIRoute) and "GET" in (route.methods or ())]


@dataclass(frozen=True)
class Site:
    """A service in this process with a library of some size, and ids of what its pages show."""

    service: Inside
    known: Mapping[str, str]

    @property
    def pages(self) -> dict[str, str]:
        """The addresses of all pages, by what they look like without ids."""
        return {page: page.format(**self.known) for page in (*EVERY_PAGE, *OF_LARGE)}


def built(service: Inside, size: Size) -> Site:
    """Fill a service: an axis with some real sounds, and rows."""

    def sent(path: str, seed: int, label: str, known: Mapping[str, object]) -> dict[str, Any]:
        parts = {"file": (f"{label}.wav", sound(seed, impacts=label == "notch")), "metadata": (None, json.dumps(known))}
        return dict(service.ask("POST", f"/api/v1/{path}", files=parts).raise_for_status().json())

    toml = {"Content-Type": "application/toml"}
    service.ask("POST", "/api/v1/axes", content=AXIS, headers=toml).raise_for_status()
    of_bench = {"axis": "bench", "speed_rad_s": 2.5}
    for seed, label in KNOWN:
        case = sent("cases", seed, label, {**of_bench, "gearbox": f"g{seed % 2}", "label": label})
    sent("diagnoses", 6, "notch", {"axis": "bench"})
    diagnosis = sent("diagnoses", 5, "notch", {**of_bench, "gearbox": "g1"})
    team = {"name": "team", "kind": "email", "address": "team@example.com"}
    told = service.ask("POST", "/api/v1/alarms/receivers", json=team).raise_for_status().json()["id"]
    rule = {"name": "any fault", "kind": "state", "receivers": [told]}
    service.ask("POST", "/api/v1/alarms/rules", json=rule).raise_for_status()
    with service.service.library.transaction("large") as session:
        investigation = investigated(session)
        job = fill(session, size)
    known = {
        "diagnosis": diagnosis["id"],
        "recording": diagnosis["recording"]["id"],
        "case": case["id"],
        "investigation": investigation,
        "daily": f"{size.cases + size.waiting + size.heard // 2:032x}",
        "job": job,
    }
    return Site(service, known)


@dataclass
class Read:
    """What was read from a database while somebody listened."""

    statements: list[Statement]

    def again(self, connection: Any) -> tuple[int, int]:
        """Send it again bare; return how many rows and bytes came."""
        rows = size = 0
        for statement, parameters in self.statements:
            cursor = connection.cursor()
            cursor.execute(statement, parameters)
            for row in cursor.fetchall():
                rows += 1
                size += sum(len(each) if isinstance(each, str | bytes | memoryview) else 8 for each in row)
            cursor.close()
        return rows, size

    def only(self, connection: Any) -> None:
        """Send it again bare, and look at nothing."""
        for statement, parameters in self.statements:
            cursor = connection.cursor()
            cursor.execute(statement, parameters)
            cursor.fetchall()
            cursor.close()


@contextmanager
def listening(service: Inside) -> Iterator[Read]:
    """Collect what a service reads from its database."""
    read = Read([])

    def hear(_connection: Any, _cursor: Any, statement: str, parameters: Any, _context: Any, _many: bool) -> None:
        if statement.startswith(("SELECT", "WITH")):
            read.statements.append((statement, parameters))

    engine = service.service.library.engine
    event.listen(engine, "before_cursor_execute", hear)
    try:
        yield read
    finally:
        event.remove(engine, "before_cursor_execute", hear)


@dataclass(frozen=True)
class Cost:
    """What a page costs once it is there.

    Args:
        first_s: until the first answer, of whatever status [s].
        page_s, sql_s: the best of several rounds [s].
        ready_s: until what is worked out once is there [s]; 0 where nothing is.
        sent: bytes of the page.
    """

    path: str
    first_s: float
    first_status: int
    ready_s: float
    page_s: float
    sql_s: float
    statements: int
    rows: int
    read: int
    sent: int

    @property
    def bound_s(self) -> float:
        """At most so long [s]."""
        return SHARE * self.sql_s + OVERHEAD_S

    @property
    def over(self) -> float:
        """Its time over its bound [1]."""
        return self.page_s / self.bound_s


def cost_of(service: Inside, path: str, *, rounds: int = 7, patience_s: float = 1800.0) -> Cost:
    """Ask for a page: at first, until it is there, and then in turns with its bare SQL."""
    began = time.perf_counter()
    first = service.browse("GET", path)
    first_s = time.perf_counter() - began
    waited = False
    answer = first
    while WORKING in answer.text:
        waited = True
        if time.perf_counter() - began > patience_s:
            raise TimeoutError(path)
        time.sleep(0.1)
        answer = service.browse("GET", path)
    ready_s = time.perf_counter() - began if waited else 0.0
    if answer.status_code >= 400:
        answer.raise_for_status()
    service.browse("GET", path)
    with listening(service) as read:
        sent = len(service.browse("GET", path).content)
    connection = service.service.library.engine.raw_connection()
    rows, size = read.again(connection)
    page_s = sql_s = math.inf
    for number in range(3 * rounds):
        if number >= rounds and page_s <= SHARE * sql_s + OVERHEAD_S:
            break  # what is over is asked oftener: others use the machine as well
        page_s = min(page_s, _seconds(lambda: service.browse("GET", path)))
        sql_s = min(sql_s, _seconds(lambda: read.only(connection)))
    connection.rollback()
    connection.close()
    return Cost(path, first_s, first.status_code, ready_s, page_s, sql_s, len(read.statements), rows, size, sent)


def _seconds(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def is_asked(route: APIRoute, pages: list[str]) -> bool:
    """Whether one of the pages is of a route."""
    return any(route.path_regex.match(re.split(r"[?#]", page)[0]) for page in pages)
