"""A joint that says nothing and a link that cannot be: each is named, and the rest is examined."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from benchmarks.robot_bank.product import investigate
from benchmarks.robot_bank.scenario import Scenario, generate, write

DEAD, IMPOSSIBLE = 2, "link_3"


@lru_cache
def made() -> Scenario:
    """A robot of which nothing is described but its URDF, in good order."""
    return generate(9_200_001, "null", seconds=12.0)


def document(folder: Path) -> dict[str, Any]:
    answer = investigate(folder)
    assert answer.document is not None, answer.failure
    return answer.document


def with_friction(found: dict[str, Any]) -> set[str]:
    """Joints that are said to lack dry friction, which all of them do."""
    return {f["location"] for f in found["findings"] if f["mechanism"] == "coulomb_friction" and f["probability"] > 0.9}


def test_a_joint_without_torque_is_unusable_and_no_other(tmp_path: Path) -> None:
    scenario = made()
    torques = scenario.signals.torques.copy()
    torques[:, DEAD] = 0.0
    write(replace(scenario, signals=replace(scenario.signals, torques=torques)), tmp_path)
    found = document(tmp_path)
    name = scenario.written.names[DEAD]
    assert {one["name"] for one in found["joints"] if one["verdict"] == "unusable"} == {name}
    (reason,) = next(one["remarks"] for one in found["joints"] if one["name"] == name)
    assert "motor_torque_nm" in reason
    assert with_friction(found) == {*scenario.written.names} - {name}


def test_an_inertia_that_no_body_has_is_mended_and_its_link_named(tmp_path: Path) -> None:
    scenario = made()
    write(scenario, tmp_path)
    path = tmp_path / "arm.urdf"
    before, link, after = re.split(f'(<link name="{IMPOSSIBLE}">.*?</link>)', path.read_text(), flags=re.DOTALL)
    path.write_text(before + re.sub(r'ixx="([^"]*)"', lambda at: f'ixx="{9.0 * float(at[1]):g}"', link) + after)
    found = document(tmp_path)
    assert any("none that a body can have" in remark and IMPOSSIBLE in remark for remark in found["remarks"])
    assert with_friction(found) == {*scenario.written.names}
    assert {one["verdict"] for one in found["joints"]} == {"named"}
