"""A few robots through the command line; the whole bank is `make robots`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.robot_bank.plan import Entry
from tests.robot_bank.product import investigate, takes_robots
from tests.robot_bank.scenario import write
from tests.robot_bank.score import judge

QUICK = tuple(
    Entry(900_000_000 + place, kind, "strong")
    for place, kind in enumerate(("null", "null", "payload", "torque_ripple", "torque_offset", "viscous_friction"))
)


@pytest.mark.slow
@pytest.mark.parametrize("entry", QUICK, ids=lambda entry: f"{entry.kind}-{entry.seed}")
def test_what_is_hidden_is_found_at_its_joint_and_nothing_else(entry: Entry, tmp_path: Path) -> None:
    if not takes_robots():
        pytest.skip("`gearcase investigate` has no option --robot")
    scenario = entry.scenario()
    write(scenario, tmp_path)
    said = investigate(tmp_path)
    assert said.document is not None, said.failure
    judgement = judge(scenario.answer(), said.document)
    assert judgement.outcome == "right", f"hidden {scenario.hidden}, said besides {judgement.invented}"
