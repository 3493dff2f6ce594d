"""Descriptions and maps that do not fit their log, and what a clear answer has to mention.

Each case starts from a robot that hides nothing and spoils one thing. What the files alone show must be refused (exit
code 2); what only the torques show may also be said in the document, which then names nothing with confidence.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.robot_bank.arm import draw_arm
from tests.robot_bank.product import Answer
from tests.robot_bank.scenario import Scenario, generate, write
from tests.robot_bank.score import SURE
from tests.robot_bank.urdf import write_urdf

Spoil = Callable[[Scenario, Path], tuple[str, ...]]
"""Writes a case's spoilt files and returns what must be mentioned: regular expressions, each to be found."""


@dataclass(frozen=True)
class WrongInput:
    """One thing that is wrong; `refused`: the files alone show it."""

    name: str
    spoil: Spoil
    refused: bool


@dataclass(frozen=True)
class Verdict:
    """Whether an answer was clear; `lacking` says what it should have done."""

    lacking: tuple[str, ...]
    words: str

    @property
    def clear(self) -> bool:
        return not self.lacking


def _edit(path: Path, change: Callable[[str], str]) -> None:
    before = path.read_text()
    after = change(before)
    if after == before:
        raise ValueError(f"{path.name}: nothing was changed")
    path.write_text(after)


def _logged(scenario: Scenario) -> list[str]:
    return [scenario.written.names[j] for j in scenario.recorder.order]


def _swap(text: str, one: str, other: str) -> str:
    return text.replace(one, "\0").replace(other, one).replace("\0", other)


def joints_in_another_order(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """Two joints exchanged in robot.toml."""
    write(scenario, folder)
    _, second, third, *_ = scenario.written.names
    _edit(folder / "robot.toml", lambda text: _swap(text, f'"{second}"', f'"{third}"'))
    return (r"order|swap|exchang|permut", re.escape(second), re.escape(third))


def degrees_called_radians(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """Angles in degrees, and a map that says radians."""
    write(replace(scenario, recorder=replace(scenario.recorder, degrees=True)), folder)
    _edit(folder / "channels.toml", lambda text: text.replace('"deg"', '"rad"').replace('"deg/s"', '"rad/s"'))
    return (r"\bdeg",)


def urdf_with_other_names(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """A URDF whose joints have other names."""
    write(scenario, folder)
    names = scenario.written.names
    others = tuple(f"a{i}" for i in range(1, 7))
    urdf = write_urdf("other", scenario.robot.arm, scenario.description.bodies, replace(scenario.written, names=others))
    (folder / "arm.urdf").write_text(urdf)
    return (re.escape(names[0]), r"\ba1\b", r"(?i)urdf")


def urdf_of_another_robot(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """A URDF of a robot of another build and weight whose joints happen to have the same names."""
    write(scenario, folder)
    ours = scenario.robot.arm
    for seed in range(1000):
        arm = draw_arm(np.random.default_rng([seed, 9]))
        weight = sum(body.mass for body in arm.bodies) / sum(body.mass for body in ours.bodies)
        if arm.build != ours.build and not 0.4 < weight < 2.5:
            break
    frames = tuple((np.eye(3), point) for point in arm.chain.points)
    urdf = write_urdf("arm", arm, arm.bodies, replace(scenario.written, frames=frames))
    (folder / "arm.urdf").write_text(urdf)
    return (r"(?i)urdf|description", r"(?i)another robot|other robot|not (fit|match|belong|describe|of this)")


def one_column_missing(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """Five columns of torque in the map, six joints in the robot."""
    write(scenario, folder)
    _shorten(folder / "channels.toml", "motor_torque_nm", "column")
    return (r"motor_torque_nm", r"\b(5|five)\b", r"\b(6|six)\b")


def one_joint_missing(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """A joint of the arm that robot.toml and the map leave out."""
    write(scenario, folder)
    last = _logged(scenario)[-1]
    _edit(folder / "robot.toml", lambda text: re.sub(r'\n\[\[joints\]\]\nname = "[^"]*"\n(axis = .*\n)?\Z', "", text))
    for channel in ("motor_position_rad", "motor_speed_rad_s", "motor_torque_nm"):
        _shorten(folder / "channels.toml", channel, "column")
    _shorten(folder / "channels.toml", "motor_torque_nm", "factor")
    return (re.escape(last), r"\blog", r"\[\[joints\]\]")


def joint_misspelt(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """A joint's name with a letter too many; the answer has the right one."""
    write(scenario, folder)
    name = scenario.written.names[2]
    _edit(folder / "robot.toml", lambda text: text.replace(f'"{name}"', f'"{name}x"'))
    return (re.escape(f"{name}x"), re.escape(name) + r"(?!x)")


def joint_twice(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """The same joint for two columns of the log."""
    write(scenario, folder)
    one, other = scenario.written.names[1:3]
    _edit(folder / "robot.toml", lambda text: text.replace(f'name = "{other}"', f'name = "{one}"'))
    return (re.escape(one), r"twice|two|again|already|more than once|unique|duplicate")


def currents_without_constants(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """Currents, and no torque per ampere."""
    write(in_currents(scenario), folder)
    _edit(folder / "channels.toml", lambda text: re.sub(r"factor = .*\n", "", text))
    return (r"motor_torque_nm", r"factor", r"N ?\.?m")


def one_constant_missing(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """Six currents, five constants."""
    write(in_currents(scenario), folder)
    _shorten(folder / "channels.toml", "motor_torque_nm", "factor")
    return (r"factor", r"\b(5|five)\b", r"\b(6|six)\b")


def hangs_from_the_ceiling(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """Gravity from the wrong side: a robot that hangs is described as one that stands."""
    write(replace(scenario, gravity_in_world=-scenario.gravity_in_world), folder)
    return (r"gravity",)


def base_leans(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """A base that was mounted at 30 degrees to what is described."""
    g = scenario.gravity_in_world
    across = np.eye(3)[np.argmin(np.abs(g))]
    side = np.cross(g, across) / np.linalg.norm(across - g * (g @ across) / (g @ g))
    write(replace(scenario, gravity_in_world=np.cos(np.radians(30)) * g + np.sin(np.radians(30)) * side), folder)
    return (r"gravity",)


def no_such_urdf(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """A URDF that is not beside the description."""
    write(scenario, folder)
    (folder / "arm.urdf").unlink()
    return (r"arm\.urdf",)


def mass_below_nothing(scenario: Scenario, folder: Path) -> tuple[str, ...]:
    """A link of the URDF with a negative mass."""
    write(scenario, folder)
    _edit(
        folder / "arm.urdf", lambda text: re.sub(r'(<link name="link_3">\s*<inertial>\s*<mass value=")', r"\1-", text)
    )
    return (r"link_3", r"mass")


CASES = tuple(
    WrongInput(spoil.__name__, spoil, refused)
    for spoil, refused in (
        (joints_in_another_order, False),
        (degrees_called_radians, False),
        (urdf_with_other_names, True),
        (urdf_of_another_robot, False),
        (one_column_missing, True),
        (one_joint_missing, True),
        (joint_misspelt, True),
        (joint_twice, True),
        (currents_without_constants, True),
        (one_constant_missing, True),
        (hangs_from_the_ceiling, False),
        (base_leans, False),
        (no_such_urdf, True),
        (mass_below_nothing, True),
    )
)


def in_currents(scenario: Scenario) -> Scenario:
    """Return the same log with currents."""
    constants = scenario.recorder.constants
    if constants is not None:
        return scenario
    return replace(scenario, recorder=replace(scenario.recorder, constants=0.05 * scenario.robot.arm.torque))


def _shorten(path: Path, channel: str, key: str) -> None:
    """Drop the last entry of a list of a channel's table, where the log has the channel and the table the list."""
    lines, table = path.read_text().splitlines(), ""
    for k, line in enumerate(lines):
        if line.startswith("["):
            table = line
        if table == f"[{channel}]" and line.startswith(f"{key} = ["):
            lines[k] = line.rpartition(",")[0] + "]"
    path.write_text("\n".join(lines) + "\n")


def base(seed: int) -> Scenario:
    """Return a robot that hides nothing and whose drives are not described, the first of its seeds."""
    drawn = (generate(k, "null") for k in range(1000 * seed, 1000 * seed + 100))
    return next(scenario for scenario in drawn if scenario.description.drives is None)


def judge(case: WrongInput, mentions: tuple[str, ...], answer: Answer) -> Verdict:
    """Return what an answer lacks."""
    said = answer.stderr
    if answer.document is not None:
        # words alone: numbers and names of the document's keys are no sentence about what is wrong
        document = answer.document
        texts = [document.get("remarks"), document.get("next_measurement"), document.get("rejected")]
        said += json.dumps(texts, ensure_ascii=False)
    lacking = [f"mention {pattern}" for pattern in mentions if not re.search(pattern, said)]
    if "Traceback" in answer.stderr:
        lacking.append("no traceback")
    if answer.code not in ((2,) if case.refused else (0, 2, 3)):
        lacking.append(f"exit code 2, not {answer.code}")
    if answer.document is not None:
        sure = [
            f"{f['mechanism']}@{f.get('location')}" for f in answer.document["findings"] if f["probability"] >= SURE
        ]
        if sure:
            lacking.append(f"no names of what the wrong description makes: {', '.join(sure)}")
    return Verdict(tuple(lacking), said.strip()[-400:])
