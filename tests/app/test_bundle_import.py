"""A bundle is imported beside the requests; its file is there until the job is over, and then gone."""

from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import update

from app.http.middleware import Metrics
from app.recordings.bundle_import import imports, order
from app.service import Service
from app.settings import settings_of
from app.upkeep import leftovers
from casebase.errors import BundleError
from casebase.library import CaseLibrary
from casebase.recordings import unspoken
from casebase.search.case_filter import CaseFilter
from casebase.store.bundle import export_cases
from casebase.store.models import StoredJob, now
from tests.casebase.sounds import add_sound, write_sound


def done(_stage: str, _fraction: float) -> None:
    """Whoever follows a job is of no interest here."""


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    library = CaseLibrary.open(tmp_path / "from")
    add_sound(library, write_sound(tmp_path / "a.wav", 1), "normal")
    with library.reading() as session:
        export_cases(library, session, tmp_path / "cases.zip", CaseFilter())
    library.close()
    return tmp_path / "cases.zip"


def test_a_bundle_is_there_while_a_job_may_import_it(bundle: Path, tmp_path: Path) -> None:
    service = Service.open(settings_of(tmp_path / "to"), Metrics())
    library, kind = service.library, imports(service.library)
    content = library.audio.content(bundle)
    jobs = []
    for _ in range(2):
        with library.transaction("anna") as session:
            jobs.append(order(library, session, service.jobs, content, "cases.zip", "anna").id)
    asked = {"sha256": content.sha256, "name": "cases.zip", "actor": "anna"}
    first = kind.finish(asked, [kind.run(asked, done)])
    assert len(first["new"]) == 1
    with library.reading() as session:
        assert unspoken(session, [content.sha256]) == []
    for each in jobs:
        service.jobs.cancel(each)
    service.jobs.resume(jobs[1])
    again = kind.finish(asked, [kind.run(asked, done)])
    assert (again["new"], again["known"]) == ([], 1)
    service.jobs.cancel(jobs[1])
    for age, there in ((timedelta(hours=23), True), (timedelta(hours=25), False)):
        with library.transaction("anna") as session:
            session.execute(update(StoredJob).values(finished_at=now() - age))
        leftovers(library, tmp_path / "incoming", remove=True)
        assert library.audio.path_of(content.sha256).exists() == there
    service.close()


def test_a_bundle_that_breaks_a_rule_does_not_stay(tmp_path: Path) -> None:
    service = Service.open(settings_of(tmp_path / "to"), Metrics())
    library = service.library
    content = library.audio.content(b"PK no bundle")
    with library.transaction("anna") as session:
        order(library, session, service.jobs, content, "x.zip", "anna")
    with pytest.raises(BundleError):
        imports(library).run({"sha256": content.sha256, "name": "x.zip", "actor": "anna"}, done)
    assert not library.audio.path_of(content.sha256).exists()
    service.close()
