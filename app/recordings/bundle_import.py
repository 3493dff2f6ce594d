"""Imports of case bundles as jobs: a large one takes minutes. Its file is in the library until the job is over."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sqlalchemy.orm import Session

from app.jobs.job import Job, JobKind, Json, Report
from casebase.library import CaseLibrary
from casebase.recordings import IMPORTS, bundles_under_way
from casebase.store.audio_store import Content
from casebase.store.bundle import import_cases
from casebase.store.counter import lock

if TYPE_CHECKING:
    from app.jobs.jobs import Jobs


def order(library: CaseLibrary, session: Session, jobs: Jobs, bundle: Content, name: str, actor: str) -> Job:
    """Keep a bundle, and order its import in the same transaction.

    Args:
        name: of the file, as it was sent.
        actor: whose cases they become.
    """
    library.audio.keep(session, bundle)
    asked: dict[str, Json] = {"sha256": bundle.sha256, "name": Path(name).name[:100], "actor": actor}
    return jobs.order(session, IMPORTS, asked, submitted_by=actor)


def imports(library: CaseLibrary) -> JobKind:
    """The kind of job that imports into this library."""

    def run(asked: dict[str, Json], report: Report) -> Json:
        sha256 = str(asked["sha256"])
        try:
            done = import_cases(
                library,
                library.audio.path(sha256),
                str(asked["actor"]),
                name=str(asked["name"]),
                progress=lambda now, total: report("importing", now / max(total, 1)),
            )
        except ValueError:  # a bundle that breaks a rule is no better the next time
            _discard(library, sha256)
            raise
        return {"new": list(done.case_ids), "known": done.known, "refused": dict(done.refused)}

    def finish(asked: dict[str, Json], results: list[Json]) -> Json:
        _discard(library, str(asked["sha256"]))
        return results[0]

    return JobKind(IMPORTS, "importing", lambda asked: [asked], run, finish)


def _discard(library: CaseLibrary, sha256: str) -> None:
    """Delete a bundle, unless another job is still to import the same."""
    with library.transaction(IMPORTS) as session:
        lock(session)
        if bundles_under_way(session).count(sha256) <= 1:
            library.audio.discard(sha256)
