"""The one table of job kinds, and the jobs of an installation."""

from collections.abc import Callable
from importlib import import_module

from app.job import JobKind
from app.jobs import Jobs, jobs_url
from app.settings import Settings

KINDS: dict[str, tuple[str, str]] = {
    "simulations": ("app.generation", "simulations"),
    "investigations": ("app.investigations", "investigations"),
}
"""Name of a kind, and where the function is that makes it for an installation; workers alone import it."""


def job_kinds(settings: Settings) -> tuple[JobKind, ...]:
    """All kinds, ready to run on this installation."""
    made = []
    for module, function in KINDS.values():
        make: Callable[[Settings], JobKind] = getattr(import_module(module), function)
        made.append(make(settings))
    return tuple(made)


def open_jobs(settings: Settings) -> Jobs:
    """The jobs of this installation, to submit and to follow; close them after use."""
    return Jobs(url_of(settings), tuple(KINDS))


def url_of(settings: Settings) -> str:
    """Where the jobs of this installation are kept."""
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    return jobs_url(settings.url, settings.data_dir)
