"""Axis descriptions: what is read is what is written, and what is wrong is named by its key."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from sim.assembly import drive_train_of
from sim.description.axis import Axis, MechanismEntry, Stage
from sim.description.axis_document import parse_axis, read_axis, write_axis
from sim.errors import AxisError
from sim.experiment.paper_axis import PAPER_AXIS
from sim.rotational.components import Inertia
from tests.shared_data import shared

PLAIN: dict[str, object] = {
    "name": "joint 2",
    "motor": {"inertia_kg_m2": 0.006, "coulomb_friction_n_m": 0.4},
    "stages": [
        {
            "name": "transfer",
            "driver_teeth": 12,
            "driven_teeth": 96,
            "inertia_kg_m2": 0.02,
            "stiffness_n_m_per_rad": 1920,
        },
        {"name": "output", "ratio": 12.5, "stiffness_n_m_per_rad": 1.5e5, "mesh_efficiency": 0.97},
    ],
    "load": {"inertia_kg_m2": 40, "viscous_friction_n_m_s_per_rad": 6},
}


def test_what_is_written_is_read(tmp_path: Path) -> None:
    axis = replace(
        read_axis(PLAIN),
        mechanisms=(MechanismEntry("backlash", "output", {"gap_rad": 1e-3}), MechanismEntry("clipping", None, {})),
    )
    path = tmp_path / "axis.toml"
    path.write_text(write_axis(axis), encoding="utf-8")
    assert read_axis(path) == axis
    assert read_axis(axis.to_mapping()) == axis


@pytest.mark.parametrize("folder", ["challenge/dev", "data"])
def test_given_descriptions_are_read_and_written(folder: str, tmp_path: Path) -> None:
    found = sorted(shared(*folder.split("/")).rglob("*.toml"))
    assert found
    for path in found:
        axis = read_axis(path)
        assert read_axis(axis.to_mapping()) == axis
        again = tmp_path / "axis.toml"
        again.write_text(write_axis(axis), encoding="utf-8")
        assert read_axis(again) == axis


def test_ratios_and_locations() -> None:
    axis = read_axis(PLAIN)
    assert axis.locations == ("motor", "transfer", "output", "load")
    assert axis.ratio == 100
    assert [axis.ratio_from(place) for place in axis.locations] == [100, 12.5, 1, 1]


def test_stiffness_of_the_whole_is_shared_by_the_stages() -> None:
    """The shares in series, felt at the output with the motor locked, are the whole again."""
    stages = [{"ratio": 8, "inertia_kg_m2": 0.02}, {"ratio": 5, "inertia_kg_m2": 0.1}, {"ratio": 2.5}]
    axis = read_axis({**PLAIN, "stages": stages, "transmission": {"stiffness_n_m_per_rad": 8e4}})
    seen = [c * axis.ratio_from(stage.name) ** 2 for c, stage in zip(axis.stiffness(), axis.stages, strict=True) if c]
    assert 1 / sum(1 / c for c in seen) == pytest.approx(8e4)
    assert axis.damping() == (None, None, None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"load": {}}, "load.inertia_kg_m2: missing"),
        ({"motor": {"inertia_kg_m2": 0}}, "motor.inertia_kg_m2: must be > 0 kg m2, got 0; leave it out"),
        ({"motor": {"inertia_kg_m2": -1}}, "motor.inertia_kg_m2: must be > 0 and <= 1e\\+09 kg m2, got -1"),
        ({"motor": {"inertia_kg_m2": math.nan}}, "motor.inertia_kg_m2"),
        ({"motor": {"inertia_kg_m2": "1"}}, "motor.inertia_kg_m2"),
        ({"motor": {"inertia_kg_m2": True}}, "motor.inertia_kg_m2"),
        ({"motor": {"inertia_kg_m2": 1, "coulomb": 1}}, "motor.coulomb: unknown key"),
        ({"motor": 3}, "motor: must be a table"),
        ({"load": None}, "load: missing table"),
        ({"lod": {}}, "lod: unknown key; did you mean 'load'"),
        ({"schema": "gearcase-axis/9"}, "schema: must be 'gearcase-axis/1'"),
        ({"stages": {}}, "stages: must be an array of tables"),
        ({"stages": [{"ratio": 0}]}, r"stages\[0\].ratio: must be > 0"),
        ({"stages": [{"ratio": 2}, {"ratio": 2}]}, r"stages\[0\].inertia_kg_m2: missing"),
        ({"stages": [{"driver_teeth": 12}]}, r"stages\[0\].driven_teeth: missing"),
        ({"stages": [{"driver_teeth": 12, "driven_teeth": 24, "ratio": 3}]}, "is not 24/12"),
        ({"stages": [{"ratio": 2, "stiffness_n_m_per_rad": 0}]}, "must be > 0 and <= 1e\\+15 N m/rad, got 0"),
        ({"stages": [{"ratio": 2, "stifness_n_m_per_rad": 1}]}, "did you mean 'stiffness_n_m_per_rad'"),
        ({"stages": [{"ratio": 2, "mesh_efficiency": 1.1}]}, "mesh_efficiency: must be > 0 and <= 1"),
        ({"stages": [{"name": "load", "ratio": 2}]}, "neither 'motor' nor 'load'"),
        ({"mechanisms": [{"location": "output"}]}, r"mechanisms\[0\].name"),
        ({"mechanisms": [{"name": "backlash", "location": "outptu"}]}, "did you mean 'output'"),
        ({"mechanisms": [{"name": "backlash", "location": "output", "gap_rad": "1"}]}, r"mechanisms\[0\].gap_rad"),
    ],
)
def test_a_wrong_description_is_named_by_its_key(change: dict[str, object], words: str) -> None:
    with pytest.raises(AxisError, match=words):
        read_axis({**PLAIN, **change})


def test_an_extended_axis_is_read_back_as_json(tmp_path: Path) -> None:
    """Answers carry axes as JSON; saved into a file they are as good as TOML."""
    path = tmp_path / "axis.json"
    path.write_text(json.dumps(PAPER_AXIS.to_mapping()))
    assert read_axis(path) == PAPER_AXIS
    path.write_text('{"motor": ')
    with pytest.raises(AxisError, match=r"axis\.json: .*JSON"):
        read_axis(path)
    with pytest.raises(AxisError, match="no such file"):
        read_axis(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 5000, "no TOML"),
        ('{"a": ' + "[" * 200_000, "no JSON"),
        ('{"name": "\\ud800"}', "no JSON"),
        ('{"name": "\\u0000"}', "NUL"),
        ("name = 'a\0'", "NUL"),
        ("a = " + "9" * 5000, "no TOML"),
        (b"name = '\xff'", "no TOML and no JSON"),
        ('{"a": ' * 17 + "1" + "}" * 17, "more than 16 deep"),
        ("a = " + "[" * 17 + "]" * 17, "more than 16 deep"),
        ("x" * 201 + " = 1", "a key of 201 characters"),
        ("a = [" + "1," * 20_001 + "]", "more than 20000 values"),
        ("a = 0x" + "f" * 1000, "more than 400 digits"),
        ("a" * (1 << 20) + " = 1", "bytes"),
    ],
)
def test_a_hostile_text_is_refused_in_words(text: str | bytes, words: str) -> None:
    with pytest.raises(AxisError, match=words):
        parse_axis(text)


def shafts(axis: Axis) -> dict[str, float]:
    train = drive_train_of(axis)
    return {name: part.J for name, part in train.components.items() if isinstance(part, Inertia)}


def test_an_axis_is_shafts_in_series() -> None:
    axis = read_axis(PLAIN)
    assert shafts(axis) == {"motor": 0.006, "transfer_shaft": 0.02, "load": 40}
    names = set(drive_train_of(axis).components)
    assert {"transfer", "output", "transfer_gear", "output_gear", "motor_friction", "load_friction"} <= names


def test_a_direct_drive_is_one_shaft_or_two_with_a_coupling() -> None:
    plain = {"motor": {"inertia_kg_m2": 95.0}, "load": {"inertia_kg_m2": 5.0}}
    assert shafts(read_axis(plain)) == {"motor": 100.0}
    assert shafts(read_axis({**plain, "transmission": {"stiffness_n_m_per_rad": 1e6}})) == {"motor": 95.0, "load": 5.0}


def test_a_stage_without_stiffness_is_stiff() -> None:
    axis = replace(read_axis(PLAIN), stages=(Stage("output", ratio=10),))
    assert axis.stiffness() == (None,)
    assert shafts(axis) == {"motor": 0.006, "load": 40}


def test_a_motion_that_was_described_by_defaults_stays_described() -> None:
    plain = {"motor": {"inertia_kg_m2": 0.6}, "load": {"inertia_kg_m2": 20}}
    described = read_axis({**plain, "motion": {"period_s": 2.1}})
    again = read_axis(described.to_mapping())
    assert again == described == read_axis(plain)
    assert again.describes_motion("period_s")
    assert not again.describes_motion("load_speed_rad_s")
    assert not read_axis(plain).describes_motion("period_s")
    with pytest.raises(AxisError, match="motion_keys: unknown key"):
        read_axis({**plain, "motion_keys": ["period_s"]})
