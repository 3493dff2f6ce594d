"""What earlier versions stored is shown by every page, route, report and command.

The documents in `old_documents` were written by the commits that the files are named for: cases and recordings of
`tests.app.sounds`, an investigation of a body whose friction differs by direction, a campaign that went well and one
that did not. Neighbours, contributions and plotted points were thinned out.
"""

import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import delete

from app.generation import simulations
from app.intake import take_in
from app.jobs.job import Job, Progress
from app.metadata import RecordingMetadata
from casebase.library import CaseLibrary
from casebase.models import FeatureRow, StoredDiagnosis, StoredInvestigation, StoredRecording, new_id
from tests.app.inside import Inside, ListedJobs, inside
from tests.app.sounds import sound
from tests.live import gearcase

OLD = sorted((Path(__file__).parent / "old_documents").glob("*.json"))
SINCE = ("severity", "disturbances", "faults", "detection_limit", "remarks", "quality")
"""Fields of a diagnosis that some earlier version did not have."""


def read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text())
    return found


@pytest.fixture(scope="module", params=OLD, ids=[path.stem for path in OLD])
def old(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Inside, list[str]]]:
    """A service over a database that an earlier version filled, and the paths of all that is in it."""
    folder = tmp_path_factory.mktemp(request.param.stem)
    documents = read(request.param)
    (folder / "sound.wav").write_bytes(sound(5, impacts=True))
    with inside(folder / "data") as service:
        paths = list(filled(service, folder / "sound.wav", documents))
        yield service, paths


def filled(inside: Inside, path: Path, documents: Mapping[str, Any]) -> Iterator[str]:
    """Store these documents as they are, with a recording that has no features of today's extractor."""
    library = inside.service.library
    intake = take_in(library, path, "notch.wav", "audio/wav", RecordingMetadata(axis="bench", gearbox="g1"))
    with library.transaction("old") as session:
        recording = intake.store(library, session)
        session.execute(delete(FeatureRow))
        for each in documents["diagnoses"]:
            row = StoredDiagnosis(
                **{name: each[name] for name in ("verdict", "label", "probability", "state")},
                id=each["document"]["id"],
                recording=session.get(StoredRecording, recording.id),
                written=each["document"],
                created_by="old",
            )
            session.add(row)
            yield f"/diagnoses/{row.id}"
        for each in documents["investigations"]:
            known = {name: each[name] for name in ("state", "axis", "axis_document", "inputs", "error")}
            asked = StoredInvestigation(
                id=new_id(), written=each["document"], report="<p>old</p>", created_by="old", **known
            )
            session.add(asked)
            yield f"/investigations/{asked.id}"
    jobs = [job(each) for each in documents["jobs"]]
    inside.service.__dict__["jobs"] = ListedJobs(jobs)
    yield from (f"/jobs/{each.id}" for each in jobs)


def job(document: Mapping[str, Any]) -> Job:
    times = {name: datetime.fromisoformat(document[name]) for name in ("created_at", "finished_at")}
    return Job(**{**document, **times, "progress": Progress(**document["progress"])})


def test_fixtures_are_of_versions_that_lacked_fields() -> None:
    lacking = [set(SINCE) - set(each["document"]) for path in OLD for each in read(path)["diagnoses"]]
    assert {"severity", "disturbances", "faults", "detection_limit"} <= set.union(*lacking)
    assert len(OLD) >= 3


def test_every_page_shows_it(old: tuple[Inside, list[str]]) -> None:
    inside, paths = old
    for path in ("/diagnoses", "/investigations", "/jobs", "/axes", "/axes/bench", "/audit", "/library", *paths):
        answer = inside.browse("GET", path)
        assert (answer.status_code, answer.headers["content-type"]) == (200, "text/html; charset=utf-8"), path


def test_every_route_answers_it(old: tuple[Inside, list[str]]) -> None:
    inside, paths = old
    for path in ("/diagnoses", "/investigations", "/jobs"):
        assert inside.ask("GET", f"/api/v1{path}").status_code == 200, path
    for path in paths:
        answer = inside.ask("GET", f"/api/v1{path}")
        unfinished = "/investigations/" in path and finished(inside, path) is None
        assert answer.status_code == (409 if unfinished else 200), (path, answer.text)
        if path.startswith("/diagnoses/"):
            document = answer.json()
            assert set(SINCE) <= set(document)
            assert "same_as_case" in document["recording"]
            for accept in ("text/html", "application/json"):
                report = inside.ask("GET", f"/api/v1{path}/report", headers={"Accept": accept})
                assert report.status_code == 200, report.text


def finished(inside: Inside, path: str) -> dict[str, Any] | None:
    with inside.service.library.reading() as session:
        row = session.get(StoredInvestigation, path.rpartition("/")[2])
        assert row is not None
        return row.document


def test_every_report_has_it(old: tuple[Inside, list[str]]) -> None:
    inside, paths = old
    for path in paths:
        done = path.startswith("/investigations/") and finished(inside, path) is not None
        if done or path.startswith("/diagnoses/"):
            assert inside.browse("GET", f"{path}/report.html").status_code == 200


def test_a_diagnosis_of_every_version_has_it_on_paper(
    old: tuple[Inside, list[str]], request: pytest.FixtureRequest
) -> None:
    """One of each version, in turn a fault, a sound gear and one undecided: drawing takes longest of all."""
    inside, paths = old
    diagnoses = [path for path in paths if path.startswith("/diagnoses/")]
    paper = inside.browse("GET", f"{diagnoses[OLD.index(request.node.callspec.params['old']) % 3]}/report.pdf")
    assert (paper.status_code, paper.content[:5]) == (200, b"%PDF-")


def test_it_can_be_revised_and_stays_as_it_was_written(old: tuple[Inside, list[str]]) -> None:
    inside, paths = old
    path = paths[0]
    change = {"verdict": "corrected", "label": "notch"}
    assert inside.ask("PATCH", f"/api/v1{path}", json=change).status_code == 200
    with inside.service.library.reading() as session:
        row = session.get(StoredDiagnosis, path.rpartition("/")[2])
        assert row is not None
        assert "faults" not in row.written
        assert "faults" in row.document


def test_a_backup_of_it_is_taken_and_brought_back(old: tuple[Inside, list[str]], tmp_path: Path) -> None:
    inside, _ = old
    data = inside.service.settings.data_dir
    assert gearcase("backup", tmp_path / "out", data_dir=data).code == 0
    assert gearcase("restore", tmp_path / "out", data_dir=tmp_path / "new").code == 0


def test_a_campaign_that_an_earlier_version_began_is_finished(tmp_path: Path) -> None:
    """Its tasks did not say how long they took."""
    kind = simulations(CaseLibrary.open(tmp_path))
    found = kind.finish(
        {"counts": {"normal": 2}}, [{"new": 1, "known": 0}, {"new": 1, "known": 0, "simulation_s": 2.0}]
    )
    assert found == {"new": 2, "known": 0, "simulation_s": 2.0, "counts": {"normal": 2}}
