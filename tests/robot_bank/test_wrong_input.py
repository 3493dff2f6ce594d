"""Each wrong input spoils what it says, and only a clear answer passes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.robot_bank.product import investigate, takes_robots
from tests.robot_bank.scenario import Scenario
from tests.robot_bank.wrong_input import CASES, WrongInput, base, judge


@pytest.fixture(scope="module")
def whole() -> Scenario:
    """Return a log of usual length, where the product takes robots."""
    if not takes_robots():
        pytest.skip("`gearcase investigate` has no option --robot")
    return base(1)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_product_says_clearly_what_does_not_fit(case: WrongInput, whole: Scenario, tmp_path: Path) -> None:
    mentions = case.spoil(whole, tmp_path)
    verdict = judge(case, mentions, investigate(tmp_path))
    assert verdict.clear, f"{verdict.lacking}; said: {verdict.words}"
