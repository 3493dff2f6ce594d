"""What the application holds while it runs, and how a route gets at it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from threading import Event
from typing import Annotated, TypeVar, cast

from fastapi import Depends, Request
from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from sqlalchemy.orm import Session

from app.background_cache import Beside, CachedQuery, Pending
from app.fleet import Fleet, alarm_watch
from app.http.keys import KeyNotes
from app.http.middleware import Metrics
from app.http.sessions import InForce
from app.jobs.jobs import JobFeed, Jobs
from app.settings import Settings
from app.upkeep import Periodic, Upkeep, leftovers, retention
from casebase.library import CaseLibrary
from casebase.reasoning.evaluation import Evaluation
from casebase.review import Review, review
from casebase.store.counter import library_version
from signals.features import EXTRACTOR_VERSION

Value = TypeVar("Value")


@dataclass(frozen=True)
class Service:
    """One running application: its settings, library and counters."""

    settings: Settings
    library: CaseLibrary
    metrics: Metrics
    limiter: MovingWindowRateLimiter = field(default_factory=lambda: MovingWindowRateLimiter(MemoryStorage()))
    stopping: Event = field(default_factory=Event)
    """Set when the service is told to stop: whoever waits beyond a moment is then to give up."""
    fleet: Fleet = field(default_factory=Fleet)
    _counted: dict[str, tuple[int, object]] = field(default_factory=dict)

    @classmethod
    def open(cls, settings: Settings, metrics: Metrics) -> "Service":
        """Open the library, made or upgraded where needed."""
        return cls(
            settings,
            CaseLibrary.open(settings.data_dir, settings.database_url, longest_wait_s=settings.longest_wait_s),
            metrics,
        )

    def tidy(self) -> None:
        """Remove what processes left that were killed."""
        leftovers(self.library, self.settings.incoming, remove=True)

    def evaluation(self, session: Session, group: str, origin: str) -> Evaluation:
        """The library's cross-validation as it is now.

        Raises:
            NotReadyError: if it is not ready yet.
        """
        return self.beside.get(self._evaluation(session, group, origin))

    def evaluation_soon(self, session: Session, origin: str, without: str | None = None) -> Evaluation | Pending:
        """The library's cross-validation by gearbox as it is now, without a case if one is named, or what is begun."""
        return self.beside.soon(self._evaluation(session, "gearbox", origin, without))

    def evaluation_known(self, session: Session) -> Evaluation | None:
        """The same where it was worked out already."""
        return self.beside.known(self._evaluation(session, "gearbox", "both"))

    def evaluation_of_axis(self, session: Session, axis: str) -> Evaluation | Pending:
        """What the library as it is now says of the held-out cases of an axis, or what is begun."""
        return self.beside.soon(self._evaluation(session, "gearbox", "both", axis=axis), wait_s=0.0)

    def _evaluation(
        self, session: Session, group: str, origin: str, without: str | None = None, axis: str | None = None
    ) -> CachedQuery[Evaluation]:
        work = partial(self.library.reuse.evaluate, group=group, origin=origin, without=without, axis=axis)
        kind = "evaluation" if axis is None else "evaluation of an axis"
        return CachedQuery(kind, library_version(session), (group, origin, without, axis), work)

    def fleet_soon(self, session: Session) -> Pending | None:
        """What is begun of a large fleet after a start of the service; None where it is known."""
        if not self.fleet.is_begun(session):
            return None
        found = self.beside.soon(CachedQuery("fleet", None, None, self.fleet.in_service))
        return found if isinstance(found, Pending) else None

    def review_soon(self, session: Session) -> Review | Pending:
        """What is wrong or missing in the library as it is now, or what is begun."""
        state = library_version(session), EXTRACTOR_VERSION
        return self.beside.soon(
            CachedQuery("review", state, None, lambda one: review(one, self.library.reuse.reasoner(one)))
        )

    def counted(self, session: Session, name: str, count: Callable[[], Value]) -> Value:
        """Return what `count` returns, as long as the library stays at a version without counting again.

        The version is read first: were a change to come in between, what is kept would be too new, never too old.
        """
        version = library_version(session)
        known = self._counted.get(name)
        if known is None or known[0] != version:
            known = self._counted[name] = (version, count())
        return cast(Value, known[1])

    def counts(self, session: Session) -> Mapping[tuple[str, str], int]:
        """Return how many searchable cases there are per label and origin."""
        return self.counted(session, "counts", lambda: self.library.retrieve.counts(session))

    @cached_property
    def beside(self) -> Beside:
        """What is worked out once for each state of the library."""
        return Beside(self.library, self.stopping)

    @cached_property
    def upkeep(self) -> Upkeep:
        return Upkeep(self.library)

    @cached_property
    def key_notes(self) -> KeyNotes:
        return KeyNotes(self.library)

    @cached_property
    def in_force(self) -> InForce:
        return InForce(self.library)

    @cached_property
    def by_itself(self) -> tuple[Periodic, ...]:
        """What is done every so often, whoever asks for what."""
        every_day = retention(self.library, self.settings.retain_audio_days)
        return (*([every_day] if every_day else []), alarm_watch(self.library, self.fleet))

    @cached_property
    def jobs(self) -> Jobs:
        return Jobs(self.library)

    @cached_property
    def job_feed(self) -> JobFeed:
        return JobFeed(self.jobs)

    def close(self) -> None:
        self.upkeep.close()
        for work in self.by_itself:
            work.close()
        self.key_notes.close()
        if "job_feed" in self.__dict__:
            self.job_feed.close()
        self.library.close()

    @cached_property
    def failed_keys(self) -> RateLimitItem:
        return parse(self.settings.failed_keys)


def service_of(request: Request) -> Service:
    """Return the service of the application that a request is for."""
    service: Service = request.app.state.service
    return service


TheService = Annotated[Service, Depends(service_of)]


def reading_session(service: TheService) -> Iterator[Session]:
    with service.library.reading() as session:
        yield session


Reading = Annotated[Session, Depends(reading_session, scope="function")]


def jobs_of(service: TheService) -> Jobs:
    return service.jobs


TheJobs = Annotated[Jobs, Depends(jobs_of)]
