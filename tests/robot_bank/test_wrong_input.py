"""Each wrong input spoils what it says, and only a clear answer passes."""

from __future__ import annotations

import json
import tempfile
import tomllib
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from tests.robot_bank.product import Answer, investigate, takes_robots
from tests.robot_bank.scenario import Scenario, generate, write
from tests.robot_bank.wrong_input import CASES, WrongInput, base, in_currents, judge


@lru_cache
def _short() -> Scenario:
    drawn = (generate(seed, "null", seconds=2.0) for seed in range(100))
    return next(scenario for scenario in drawn if scenario.description.drives is None)


@pytest.fixture(params=CASES, ids=lambda case: case.name)
def spoilt(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[WrongInput, tuple[str, ...], Path]:
    """Return a case, what its answer has to mention, and its folder."""
    mentions = request.param.spoil(_short(), tmp_path)
    return request.param, mentions, tmp_path


def test_one_file_differs_from_that_of_the_right_description(
    spoilt: tuple[WrongInput, tuple[str, ...], Path], tmp_path_factory: pytest.TempPathFactory
) -> None:
    case, _, folder = spoilt
    right = tmp_path_factory.mktemp("right")
    write(_short(), right)
    names = {path.name for path in (*right.iterdir(), *folder.iterdir())}
    differing = {
        name
        for name in names
        if not (folder / name).exists() or (folder / name).read_bytes() != (right / name).read_bytes()
    }
    # angles in degrees are in the log; currents may be in the log where the right one has torques
    allowed = {
        "degrees_called_radians": {"log.csv"},
        "one_joint_missing": {"robot.toml", "channels.toml"},
        "currents_without_constants": {"channels.toml", "log.csv"},
        "one_constant_missing": {"channels.toml", "log.csv"},
    }
    assert differing
    assert len(differing) == 1 or differing <= allowed[case.name]


@pytest.mark.parametrize(
    ("name", "joints", "columns", "constants"),
    [("one_column_missing", 6, 5, 6), ("one_constant_missing", 6, 6, 5), ("one_joint_missing", 5, 5, 5)],
)
def test_lists_that_lack_an_entry_have_five(
    name: str, joints: int, columns: int, constants: int, tmp_path: Path
) -> None:
    (case,) = (c for c in CASES if c.name == name)
    case.spoil(in_currents(_short()), tmp_path)
    torque = tomllib.loads((tmp_path / "channels.toml").read_text())["motor_torque_nm"]
    robot = tomllib.loads((tmp_path / "robot.toml").read_text())
    assert (len(robot["joints"]), len(torque["column"]), len(torque["factor"])) == (joints, columns, constants)


def test_an_answer_is_clear_where_it_says_what_is_wrong_and_names_nothing() -> None:
    (case,) = (c for c in CASES if c.name == "hangs_from_the_ceiling")
    mentions = ("gravity",)
    document = {"findings": [], "remarks": ["gravity_m_s2 = [0, 0, 9.81] would fit"]}
    assert judge(case, mentions, Answer(json.dumps(document), "", 0, 1.0)).clear
    assert judge(case, mentions, Answer("", "robot.toml: gravity_m_s2: ...", 2, 1.0)).clear
    sure = {"mechanism": "torque_offset", "location": "J2", "probability": 0.97}
    assert not judge(case, mentions, Answer(json.dumps(document | {"findings": [sure]}), "", 0, 1.0)).clear
    assert not judge(case, mentions, Answer("", "Traceback: gravity", 2, 1.0)).clear
    assert not judge(case, mentions, Answer("", "gravity", 1, 1.0)).clear
    assert not judge(case, mentions, Answer("", "the robot does not fit", 2, 1.0)).clear


def test_gravity_of_the_ceiling_is_turned() -> None:
    with tempfile.TemporaryDirectory() as name:
        (case,) = (c for c in CASES if c.name == "hangs_from_the_ceiling")
        case.spoil(_short(), Path(name))
        said = tomllib.loads((Path(name) / "robot.toml").read_text())["gravity_m_s2"]
    np.testing.assert_allclose(said, -_short().gravity_in_world, atol=1e-5)


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
