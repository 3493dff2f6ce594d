"""The one table of job kinds, and the jobs of an installation."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module

from app.jobs.job import JobKind
from app.jobs.jobs import Jobs
from app.settings import Settings
from casebase.library import CaseLibrary

KINDS: dict[str, tuple[str, str]] = {
    "simulations": ("app.simulated.generation", "simulations"),
    "investigations": ("app.investigations", "investigations"),
    "deliveries": ("app.alarms.sending", "deliveries"),
}
"""Name of a kind, and where the function is that makes it for a library; workers alone import it."""


def job_kinds(library: CaseLibrary) -> tuple[JobKind, ...]:
    """All kinds, ready to run on this library."""
    made = []
    for module, function in KINDS.values():
        make: Callable[[CaseLibrary], JobKind] = getattr(import_module(module), function)
        made.append(make(library))
    return tuple(made)


def jobs_in(library: CaseLibrary) -> Jobs:
    """The jobs of a library, to order and to follow; close them after use."""
    return Jobs(library, tuple(KINDS))


@contextmanager
def open_jobs(settings: Settings) -> Iterator[Jobs]:
    """The jobs of an installation, with a library of their own."""
    library = CaseLibrary.open(settings.data_dir, settings.database_url)
    try:
        with jobs_in(library) as jobs:
            yield jobs
    finally:
        library.close()
