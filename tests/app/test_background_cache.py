"""What takes longer than a page may is worked out beside it, once; the page says so and goes on by itself."""

import re
from collections.abc import Iterator
from datetime import timedelta
from functools import partial
from threading import Event
from typing import Any
from unittest.mock import patch

import pytest

from app import fleet
from app.background_cache import CachedQuery, Pending
from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.sounds import sound
from benchmarks.harness.worked_out import worked_out
from casebase.errors import NotFoundError
from casebase.reasoning.evaluation import Evaluation, evaluate
from casebase.store.models import now
from tests.casebase.kept import keep


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    with inside(tmp_path_factory.mktemp("beside") / "data") as found:
        for seed in range(4):
            known = f'{{"axis": "arm", "gearbox": "g{seed}", "label": "{("normal", "notch")[seed % 2]}"}}'
            parts = {"file": (f"{seed}.wav", sound(seed, impacts=seed % 2 == 1)), "metadata": (None, known)}
            found.ask("POST", "/api/v1/cases", files=parts).raise_for_status()
        yield found


def progress(page: str) -> str:
    """The bar of what is waited for."""
    found = re.search(r"<progress[^>]*>", page.partition('id="waiting"')[2])
    assert found is not None
    return found[0]


def test_an_evaluation_is_waited_for_in_words_and_asked_for_once(service: Inside) -> None:
    go_on, asked = Event(), []

    def slow(*told: Any, **more: Any) -> Evaluation:
        asked.append(more["origin"])
        assert go_on.wait(60)
        return evaluate(*told, **more)

    address = "/library/evaluation?origin=measured"
    with patch("casebase.cycle.reuse.evaluate", slow):
        for _ in range(2):
            page = service.browse("GET", address)
            assert page.status_code == 200
            assert "Being worked out from the 4 cases of the library" in page.text
            assert f'hx-get="{address}"' in page.text
            assert "value=" not in progress(page.text), "nobody knows how long it takes"
        go_on.set()
        assert "Confusion by gearbox" in worked_out(partial(service.browse, "GET"), address)
        go_on.clear()
        page = service.browse("GET", "/library/evaluation?origin=simulated")
        assert 'max="1" value=' in progress(page.text), "as long as the last one"
        assert "The last time it took" in page.text
        go_on.set()
    assert asked == ["measured", "simulated"]


def test_what_cannot_be_told_is_said_and_another_state_is_asked_anew(service: Inside) -> None:
    def refuse(_: object) -> int:
        raise NotFoundError("there is none")

    beside = service.service.beside
    with pytest.raises(NotFoundError):
        beside.soon(CachedQuery("a", 1, None, refuse), 60.0)
    asked: list[int] = []
    for state in (1, 1, 2, 1):
        beside.soon(CachedQuery("b", state, None, lambda _: asked.append(0)), 60.0)
    assert len(asked) == 3, "what was worked out for an older state is not kept"


def test_after_a_fault_of_ours_whoever_asks_next_has_it_worked_out_anew(service: Inside) -> None:
    """A database that was away for a moment must not stand for the answer until the library changes."""
    faults = [RuntimeError("away")]

    def work(_: object) -> str:
        if faults:
            raise faults.pop()
        return "answer"

    beside, asked = service.service.beside, CachedQuery("c", None, None, work)
    with pytest.raises(RuntimeError, match="away"):
        beside.soon(asked, 60.0)
    assert beside.soon(asked, 60.0) == "answer"


def test_a_large_fleet_is_waited_for_in_words_after_a_start(service: Inside) -> None:
    with service.service.library.transaction("test") as session:
        for number in range(3):
            keep(session, "arm", f"g{number}", now() - timedelta(days=1), {}, "normal")
    go_on = Event()
    known = service.service.fleet

    def slow(*told: Any) -> Any:
        assert go_on.wait(60)
        return fleet.Fleet.in_service(known, *told)

    known.whole = False
    with patch.object(fleet, "LARGE", 2), patch.object(known, "in_service", slow):
        page = service.browse("GET", "/fleet").text
        assert "Being worked out from all recordings, once after each start of the service." in page
        go_on.set()
        assert "arm," in worked_out(partial(service.browse, "GET"), "/fleet")
    with service.service.library.reading() as session:
        assert not isinstance(service.service.fleet_soon(session), Pending), "known until the next start"
