"""What a worker does again, and what it leaves to others."""

import threading

import pytest

from app.jobs import runner
from casebase.errors import LeaseLostError, StaleVersionError


def worker() -> runner.Worker:
    return runner.Worker(None, None, {}, "lease", 1.0, threading.Event())  # type: ignore[arg-type]


def test_work_that_somebody_else_wrote_at_the_same_time_is_done_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last commit of a killed worker may arrive after another has begun its work anew."""
    monkeypatch.setattr(runner, "RETRY_S", 0.0)
    answers = [StaleVersionError("written"), StaleVersionError("written"), None]

    def work(value: int) -> int:
        if (error := answers.pop(0)) is not None:
            raise error
        return value

    assert worker().patiently(work, 7) == 7


def test_work_without_a_lease_is_left_to_others() -> None:
    def work() -> None:
        raise LeaseLostError("lost")

    with pytest.raises(SystemExit):
        worker().patiently(work)
