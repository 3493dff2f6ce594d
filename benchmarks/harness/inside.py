"""The service in this process, asked without a network: for faults that only a test can cause."""

import asyncio
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from fastapi import FastAPI
from structlog.testing import capture_logs

from app.http.keys import Role, create_key
from app.http.middleware import Metrics
from app.http.security import COOKIE, FORM_COOKIE, csrf_token
from app.http.sessions import open_session
from app.jobs.job import Job, JobNotFoundError, Progress
from app.main import attach, create_app
from app.service import Service
from app.settings import Settings
from benchmarks.harness.live import NO_MAIL_SERVER
from casebase.store.models import new_id, now
from casebase.store.pagination import Page


@dataclass
class Inside:
    """An application, the key of an admin, and a session of it."""

    app: FastAPI
    service: Service
    key: str
    session: str

    @property
    def token(self) -> str:
        """What the forms of its pages carry."""
        return csrf_token(self.session)

    def ask(self, method: str, path: str, **options: Any) -> httpx.Response:
        """Ask as a program does, with the key."""
        return self._sent(method, path, {"Authorization": f"Bearer {self.key}"}, options)

    def browse(self, method: str, path: str, **options: Any) -> httpx.Response:
        """Ask as a browser does: wants HTML, has the cookies and, for a form, the token of its page."""
        if "data" in options:
            options["data"] = {"csrf": self.token, **options["data"]}
        cookies = (
            f"{COOKIE}={self.session}; {FORM_COOKIE}={self.session}"  # alike, so that one token is that of any form
        )
        return self._sent(method, path, {"Accept": "text/html", "Cookie": cookies}, options)

    def anonymous(self, method: str, path: str, **options: Any) -> httpx.Response:
        """Ask as a browser without a key does."""
        return self._sent(method, path, {"Accept": "text/html"}, options)

    def _sent(self, method: str, path: str, headers: dict[str, str], options: dict[str, Any]) -> httpx.Response:
        headers |= options.pop("headers", {})

        async def run() -> httpx.Response:
            transport = httpx.ASGITransport(self.app, raise_app_exceptions=False)
            async with httpx.AsyncClient(transport=transport, base_url="http://test", headers=headers) as client:
                return await client.request(method, path, **options)

        with ThreadPoolExecutor(1) as apart:  # a browser test before may have left its loop running in this thread
            return apart.submit(asyncio.run, run()).result()


@contextmanager
def inside(data_dir: Path, database_url: str | None = None, **given: str | None) -> Iterator[Inside]:
    """Open the service of a data directory in this process, with these settings."""
    settings = Settings(data_dir=data_dir, **{"database_url": database_url, "smtp_url": NO_MAIL_SERVER, **given})
    service = Service.open(settings, Metrics())
    with service.library.transaction("test") as session:
        row, key = create_key(session, name="test", role=Role.ADMIN)
        token = open_session(session, row.id)
    app = create_app(service=service)
    attach(app, service)
    with capture_logs():  # tracebacks drawn for people take seconds each
        yield Inside(app, service, key, token)
    service.close()


@dataclass
class ListedJobs:
    """Jobs as they are told: stands for `app.jobs.jobs.Jobs` where only their documents matter."""

    jobs: list[Job] = field(default_factory=list)

    def get(self, job_id: str) -> Job:
        for job in self.jobs:
            if job.id == job_id:
                return job
        raise JobNotFoundError(f"no job {job_id!r}")

    def order(
        self, _: object, kind: str, __: object, *, job_id: str | None = None, submitted_by: str | None = None
    ) -> Job:
        job = Job(job_id or new_id(), kind, "queued", Progress(), now(), None, submitted_by, None, None, None, None)
        self.jobs.insert(0, job)
        return job

    def submit(self, kind: str, _: object, *, job_id: str | None = None, submitted_by: str | None = None) -> str:
        return self.order(None, kind, _, job_id=job_id, submitted_by=submitted_by).id

    def page(self, *, limit: int = 50, cursor: str | None = None) -> Page[Job]:
        assert cursor is None
        return Page(self.jobs[:limit], None)

    def workers(self) -> dict[str, int]:
        return {}
