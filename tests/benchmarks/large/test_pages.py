"""What a page reads does not grow with the library, and no page is forgotten."""

from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from benchmarks.harness.inside import inside
from benchmarks.harness.site import EVERY_PAGE
from benchmarks.large.library import Size
from benchmarks.large.pages import NO_PAGES, Cost, built, cost_of, is_asked, routes
from casebase.reasoning.evaluation import Evaluation, evaluate
from casebase.search.case_table import CaseTable

TIMES, FEW = 2, 6
SHORT_BYTES, PAGE_ROWS, SLACK_BYTES = 130, 110, 1000
"""A row of ids and counts; the most rows that a page shows in full; what differs by chance, an id in a text say."""


SMALL = Size(cases=240, gearboxes=120, waiting=120, heard=120, others=320)


def of_a_few(table: CaseTable, **asked: Any) -> Evaluation:
    """What is worked out beside a page takes long and reads nothing, so a few cases will do."""
    return evaluate(table.take(np.arange(FEW)), **asked)


@pytest.fixture(scope="module")
def costs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Cost]]:
    """What each page reads in a library with more of everything than a page shows, and in one twice as large."""
    found: dict[str, list[Cost]] = {}
    for times in (1, TIMES):
        size = Size(**{name: times * number for name, number in vars(SMALL).items()})
        data = tmp_path_factory.mktemp("large") / "data"
        with inside(data) as service, patch("casebase.cycle.reuse.evaluate", of_a_few):
            site = built(service, size)
            for template, page in site.pages.items():
                found.setdefault(template, []).append(cost_of(service, page, rounds=0))
    return found


def test_no_page_is_forgotten(costs: dict[str, list[Cost]]) -> None:
    asked = [cost.path for known in costs.values() for cost in known]
    left = {route.path for route in routes() if not is_asked(route, asked)}
    assert left == NO_PAGES.keys(), "each is asked for, or it is said why not"
    assert {*EVERY_PAGE} <= costs.keys()


def test_no_page_sends_a_statement_for_every_row(costs: dict[str, list[Cost]]) -> None:
    grown = {page: [each.statements for each in known] for page, known in costs.items()}
    assert {page: known for page, known in grown.items() if len(set(known)) > 1} == {}


def test_what_grows_with_the_library_are_short_rows(costs: dict[str, list[Cost]]) -> None:
    """Beyond a page of rows in full nothing is read but ids and counts: no documents, and no features."""
    long: dict[str, tuple[int, int]] = {}
    for page, (small, large) in costs.items():
        rows, size = large.rows - small.rows, large.read - small.read
        if large.rows > PAGE_ROWS and size > SHORT_BYTES * rows + SLACK_BYTES:
            long[page] = (rows, size)
    assert long == {}
