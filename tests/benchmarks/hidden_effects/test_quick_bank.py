"""Effects of every kind, hidden by three simulations that share no code with the product: each is found as what it is.

Short recordings, effects well above the noise. The full banks are `make challenge` and `make robots`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.hidden_effects.bank import Entry
from benchmarks.hidden_effects.generator import draw_recipe, generate, write
from benchmarks.hidden_effects.product import investigate_together, together
from benchmarks.hidden_effects.scoring import complete, judge
from benchmarks.hidden_effects.second import scenario as second_scenario
from benchmarks.hidden_effects.second.motion import TELEMETRY_RATE_HZ
from benchmarks.hidden_effects.second.plan import PLAN
from benchmarks.hidden_effects.second.sound import SOUND_RATE_HZ
from benchmarks.robot_bank import scenario as robots

SAID = 0.5
SIZE_TOLERANCE = 0.3
JSON = Mapping[str, Any]
ROBOT_FILES = {"--robot": "robot.toml", "--telemetry": "log.csv", "--channels": "channels.toml"}
AXIS_FILES = {"--axis": "axis.toml", "--telemetry": "telemetry.csv", "--sound": "sound.wav"}
Make = Callable[[Path], JSON]
"""Writes a customer's files into a folder and returns the answer."""


def first(
    group: str, seed: int, *effects: str, kind: str | None = None, load_encoder: bool = True, seconds: float = 12.0
) -> Make:
    """A recording of the first source: telemetry at 500 Hz, or the sound of one whose telemetry nobody has."""

    def make(folder: Path) -> JSON:
        drawn = draw_recipe(seed, group, effects, "strong" if effects else "full", kind, load_encoder)
        drawn = replace(drawn, noise="stationary", whole_transmission=False, teeth=True, sound=not drawn.telemetry)
        made = generate(seed, drawn, seconds=seconds)
        if made.telemetry is not None:
            made = replace(made, telemetry={name: values[::4] for name, values in made.telemetry.items()})
        write(made, folder)
        return made.answer()

    return make


def second(seed: int, hidden: Mapping[str, str | None], *, stride: int = 4, seconds: float = 12.0) -> Make:
    """A recording of the second source, its beginning; with no stride its sound alone."""

    def make(folder: Path) -> JSON:
        made = second_scenario.generate(seed, next(k for k, entry in enumerate(PLAN) if entry.hidden == hidden))
        rows = slice(0, round(seconds * TELEMETRY_RATE_HZ), stride or None)
        told = {column.name: getattr(made.recording, column.name)[rows] for column in fields(made.recording)}
        heard = made.sound[: round(seconds * SOUND_RATE_HZ)]
        second_scenario.write(replace(made, recording=replace(made.recording, **told), sound=heard), folder)
        (folder / ("sound.wav" if stride else "telemetry.csv")).unlink()
        return complete({"id": folder.name, **made.answer})

    return make


def sagging(good: Make, share: float, start_s: float, end_s: float) -> Make:
    """A recording of a good axis whose torque is read by 1 + `share` from `start_s` to `end_s`."""

    def make(folder: Path) -> JSON:
        answer = dict(good(folder))
        file = folder / "telemetry.csv"
        table = np.genfromtxt(file, delimiter=",", names=True)
        since = table["time_s"] - table["time_s"][0]
        table["motor_torque_nm"][(since >= start_s) & (since < end_s)] *= 1.0 + share
        np.savetxt(file, table, delimiter=",", header=",".join(table.dtype.names or ()), comments="")
        size = {"share": share, "start_s": start_s, "end_s": end_s}
        hidden = {"mechanism": "torque_gain", "location": "motor", "true_location": "motor", "size": size}
        return {**answer, "group": "sensor", "verdict": "named", "hidden": [hidden], "size": size}

    return make


def robot(seed: int, kind: str) -> Make:
    """A log of a robot with six joints."""

    def make(folder: Path) -> JSON:
        made = robots.generate(seed, kind, "strong", 12.0)
        robots.write(made, folder)
        return made.answer()

    return make


NAMED: dict[str, Make] = {
    "dry friction": first("mechanics", 9_000_011, "coulomb_friction", kind="two shafts"),
    "viscous friction": second(902, {"viscous_friction": None}),
    "torque ripple": first("mechanics", 9_000_041, "torque_ripple", kind="direct drive", load_encoder=False),
    "mesh error at output": first("mechanics", 9_200_131, "mesh_error", kind="three shafts", seconds=10.0),
    "runout at transfer": second(924, {"eccentricity": "transfer"}, stride=8, seconds=8.0),
    "play at output": first("mechanics", 9_000_071, "backlash", kind="two shafts"),
    "spring that hardens": first("mechanics", 9_000_091, "stiffness_hardening", kind="two shafts"),
    "spring with a loop": first("mechanics", 9_000_101, "hysteresis", kind="two shafts"),
    "torque that comes late": first("sensor", 9_000_121, "time_delay", kind="direct drive", load_encoder=False),
    "hum in the torque": first("sensor", 9_000_131, "electrical_hum", kind="direct drive", load_encoder=False),
    "torque constant that falls": sagging(second(912, {}, seconds=24.0), -0.15, 8.0, 16.0),
    "two frictions at once": first(
        "two", 9_000_181, "coulomb_friction", "viscous_friction", kind="direct drive", load_encoder=False
    ),
    "a joint's viscous friction": robot(9_100_003, "viscous_friction"),
    "a joint's torque offset": robot(9_100_012, "torque_offset"),
    "tooth heard at output": first("sound alone", 9_000_201, "tooth_damage", seconds=15.0),
    "tooth heard at transfer": first("sound alone", 9_100_211, "tooth_damage", seconds=15.0),
    "another tooth heard at output": second(922, {"tooth_damage": "output"}, stride=0, seconds=15.0),
    "play heard": first("sound alone", 9_100_051, "backlash", seconds=15.0),
    "play heard again": first("sound alone", 9_100_151, "backlash", seconds=15.0),
    "bearing heard": first("sound alone", 9_000_221, "bearing_defect", seconds=15.0),
    "another bearing heard": second(910, {"bearing_defect": None}, stride=0, seconds=15.0),
    "hum heard": first("sound alone", 9_100_511, "electrical_hum", seconds=15.0),
}
UNNAMED: dict[str, Make] = {
    "speed": first("unnamed", 9_000_161, "speed_band_friction", kind="direct drive", load_encoder=False),
    "frequency": first("unnamed", 9_000_171, "fixed_frequency_disturbance", kind="direct drive", load_encoder=False),
}
"""By what it is said to live at."""
NOTHING: dict[str, Make] = {
    "good axis": first("null", 9_000_001, kind="two shafts"),
    "another good axis": second(912, {}),
    "good sound": first("sound alone null", 9_000_241, seconds=15.0),
    "another good sound": first("sound alone null", 9_100_671, seconds=15.0),
}


@dataclass(frozen=True)
class Found:
    """What was hidden in a recording, and the document about it."""

    answer: JSON
    document: JSON

    @property
    def names(self) -> set[tuple[str, str | None]]:
        """Mechanism and place of all that is said; the place only where something hidden is of one."""
        placed = {one["mechanism"] for one in self.answer["hidden"] if one["location"]}
        said = [f for f in self.document["findings"] if f["probability"] >= SAID]
        return {(f["mechanism"], f["location"] if f["mechanism"] in placed else None) for f in said}

    @property
    def hidden(self) -> set[tuple[str, str | None]]:
        return {(one["mechanism"], one["location"]) for one in self.answer["hidden"]}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Found]:
    """Every recording, investigated by one process that starts once."""
    answers, verbs = {}, []
    for place, (name, make) in enumerate({**NAMED, **UNNAMED, **NOTHING}.items()):
        folder = tmp_path_factory.mktemp("hidden") / f"s{place:02d}"
        folder.mkdir()
        answers[name] = make(folder)
        files = ROBOT_FILES if (folder / "robot.toml").exists() else AXIS_FILES
        given = [(option, folder / file) for option, file in files.items() if (folder / file).exists()]
        verbs.append(["investigate", "--json", *(str(word) for pair in given for word in pair)])
    documents = together(verbs, tmp_path_factory.mktemp("product"))
    return {name: Found(answers[name], document) for name, document in zip(answers, documents, strict=True)}


@pytest.mark.parametrize("name", NAMED)
def test_what_is_hidden_is_named_at_its_place_and_alone(found: dict[str, Found], name: str) -> None:
    one = found[name]
    assert one.document["verdict"] == "named"
    assert one.names == one.hidden


@pytest.mark.parametrize("name", [name for name in NAMED if "joint" not in name])
def test_its_size_is_what_was_put_in(found: dict[str, Found], name: str) -> None:
    judgement = judge(found[name].answer, found[name].document)
    assert judgement.solved
    assert [check for check in judgement.sizes if abs(check.error) > SIZE_TOLERANCE] == []


@pytest.mark.parametrize("kind", UNNAMED)
def test_what_has_no_name_gets_none_and_is_said_where(found: dict[str, Found], kind: str) -> None:
    document = found[kind].document
    assert (document["verdict"], found[kind].names) == ("unnamed", set())
    assert document["unexplained"]["kind"] == kind


@pytest.mark.parametrize("name", NOTHING)
def test_nothing_is_named_where_nothing_is_missing(found: dict[str, Found], name: str) -> None:
    document = found[name].document
    assert (document["verdict"], document["findings"]) == ("nothing_missing", [])


@pytest.mark.slow
def test_the_drives_law_shows_what_noise_of_the_torque_channel_hides() -> None:
    """Stribeck friction at a third of the noise: named with the reference recorded, and not without it."""
    scenario = Entry(53_000_810, "mechanics", ("stribeck_friction",), "third").scenario()
    assert scenario.telemetry
    without = {name: values for name, values in scenario.telemetry.items() if name != "reference_position_rad"}
    known, unknown = investigate_together([scenario, replace(scenario, telemetry=without)])
    assert [f["mechanism"] for f in known["findings"] if f["probability"] >= 0.5] == ["stribeck_friction"]
    assert any("drive's law" in remark for remark in known["remarks"])
    assert (unknown["verdict"], unknown["findings"]) == ("nothing_missing", [])
    assert any(remark.startswith("Without reference_position_rad") for remark in unknown["remarks"])
