"""An error on a page is a page, and the page of a job opens whatever the job is and however far."""

import re
from collections.abc import Iterator
from typing import get_args

import pytest
from fastapi.routing import APIRoute

from app.jobs.job import Job, JobState, Json, Progress
from app.jobs.jobs import KINDS
from app.main import PAGES
from app.web.page import visitor
from benchmarks.harness.inside import Inside, ListedJobs, inside
from casebase.store.models import new_id, now
from tests.web.reading import Markup

ROUTES = sorted(
    (method, route.path)
    for router in PAGES
    for route in router.routes
    if isinstance(route, APIRoute)
    for method in route.methods
)
FAULT = "The service failed; this is not your fault"
RESULTS: dict[str, tuple[Json, ...]] = {
    "simulations": ({"new": 3, "known": 1, "simulation_s": 1.5, "counts": {"normal": 4}},),
    "investigations": ({"investigation_id": "0" * 32, "verdict": "named"},),
    "imports": ({"new": ["0" * 32], "known": 1, "refused": {"audio/a.wav": "it is silent"}},),
    "deliveries": ({"state": "sent"},),
}
"""What a job of each kind ends with."""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    with inside(tmp_path_factory.mktemp("pages") / "data") as found:
        found.service.__dict__["jobs"] = ListedJobs(list(jobs()))
        yield found


def jobs() -> Iterator[Job]:
    """A job of every kind in every state."""
    for kind, results in RESULTS.items():
        for state in get_args(JobState):
            for result in results if state == "done" else (None,):
                yield made(kind, state, result)


def made(kind: str, state: JobState, result: Json) -> Job:
    progress = Progress("simulating", 0.4, 2, 5, 12.0) if state == "running" else Progress(state)
    ended, error = (now() if result else None), ("task 0: motor: missing table [motor]" if state == "failed" else None)
    return Job(new_id(), kind, state, progress, now(), ended, "test", None, result, error, "bench")


def fail(*_: object, **__: object) -> None:
    raise RuntimeError("as a test wants it")


def test_every_kind_of_job_has_results_here() -> None:
    assert RESULTS.keys() == KINDS.keys()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("state", get_args(JobState))
def test_the_page_of_every_job_opens_in_every_state(service: Inside, kind: str, state: str) -> None:
    found = [job for job in service.service.jobs.page().items if (job.kind, job.state) == (kind, state)]
    assert found
    for job in found:
        answer = service.browse("GET", f"/jobs/{job.id}")
        assert (answer.status_code, answer.headers["content-type"]) == (200, "text/html; charset=utf-8")
        page = Markup(answer.text)
        assert state in page.text
        assert "{" not in page.text, "what became of it is said in words"
        assert (f"/investigations/{'0' * 32}" in page.links) == (kind == "investigations" and state == "done")
        assert service.ask("GET", f"/api/v1/jobs/{job.id}").json()["result"] == job.result
    assert service.browse("GET", "/jobs").status_code == 200


def address(path: str) -> str:
    """Put something into the holes of a path that fits them."""
    fixed = path.replace("{name}", "waveform" if "plots" in path else "bench").replace("{part}", "overlay")
    return re.sub(r"\{\w+\}", "0" * 32, fixed.replace("{number}", "0"))


@pytest.mark.parametrize(("method", "path"), ROUTES)
def test_a_fault_in_any_page_is_a_page(
    service: Inside, monkeypatch: pytest.MonkeyPatch, method: str, path: str
) -> None:
    """HTML with the words of the problem document, its status, headers and id."""
    for name in ("app.web.pages.admin.principal_of", "app.web.page.signed_in"):
        monkeypatch.setattr(name, fail)
    monkeypatch.setitem(service.app.dependency_overrides, visitor, lambda: fail())
    form = {"data": {"key": "gearcase_x"}} if method == "POST" else {}
    answer = service.browse(method, address(path), **form)
    assert answer.status_code == 500, answer.text
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    text = Markup(answer.text).text
    assert FAULT in text
    assert ("nothing of this request was stored" in text) == (method == "POST")
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-request-id"]
    same = service.browse(method, address(path), headers={"Accept": "application/json"}, **form).json()
    assert (same["status"], same["title"]) == (500, FAULT)
    assert same["detail"].removesuffix(".") in text


def test_a_fault_while_a_page_is_filled_is_a_page_that_still_leads_on(
    service: Inside, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.web.pages.admin.render", fail)
    answer = service.browse("GET", "/jobs")
    assert (answer.status_code, answer.headers["content-type"]) == (500, "text/html; charset=utf-8")
    assert {"/", "/diagnoses", "/library"} <= Markup(answer.text).links


def test_other_errors_of_pages_are_pages(service: Inside) -> None:
    for method, path, status in (
        ("GET", "/nowhere", 404),
        ("GET", f"/jobs/{new_id()}", 404),
        ("GET", f"/diagnoses/{new_id()}", 404),
        ("GET", "/recordings/x/plots/nonsense", 404),
        ("PUT", "/library", 405),
        ("POST", "/library/review", 422),
    ):
        answer = service.browse(method, path, **({"data": {"kind": "none"}} if method == "POST" else {}))
        assert (answer.status_code, answer.headers["content-type"]) == (status, "text/html; charset=utf-8"), path


def test_a_fault_of_the_interface_stays_a_problem_document(service: Inside, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.api.jobs.PageOf", fail)
    answer = service.ask("GET", "/api/v1/jobs", headers={"Accept": "text/html"})
    assert (answer.status_code, answer.headers["content-type"]) == (500, "application/problem+json")
    assert answer.headers["x-request-id"] == answer.json()["request_id"]
    assert answer.headers["x-content-type-options"] == "nosniff"
