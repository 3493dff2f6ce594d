"""`gearcase simulate` from outside: files, exit codes, words."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from pyarrow import csv, parquet

from app.cli import run
from signals.telemetry import CHANNELS, read_telemetry
from sim.description.axis_document import read_axis, write_axis
from sim.solver import simulate
from tests.sim.axes import axis
from tests.sim.rotational.test_train_document import COMPOSED, PAPER


@pytest.fixture
def described(tmp_path: Path) -> Path:
    path = tmp_path / "axis.toml"
    path.write_text(write_axis(axis()), encoding="utf-8")
    return path


def test_one_run_with_two_mechanisms(described: Path, tmp_path: Path) -> None:
    """In a process of its own: one JSON document on stdout, nothing else."""
    out = tmp_path / "out"
    words = f"""-m app simulate --axis {described} --mechanism backlash@transfer --set gap_rad=0.002
        --mechanism tooth_damage --set location=output --set angle_rad=1.2 --set flank=-1
        --duration 3 --seed 5 --json --out {out}""".split()
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=True)
    document = json.loads(done.stdout)
    assert document["engine"] == "chain"
    assert [Path(name).name for name in document["files"]] == ["axis.toml", "telemetry.csv", "sound.wav"]
    assert all(Path(name).stat().st_size > 500 for name in document["files"])
    entries = read_axis(out / "axis.toml").mechanisms
    assert [(entry.name, entry.location) for entry in entries] == [("backlash", "transfer"), ("tooth_damage", "output")]
    assert entries[1].parameters["flank"] == -1
    telemetry = read_telemetry(out / "telemetry.csv")
    assert set(telemetry.channels) <= set(CHANNELS)
    assert telemetry.duration_s == pytest.approx(3.0)
    sound, rate = soundfile.read(out / "sound.wav")
    assert rate == 8000
    assert sound.size == 24001
    assert np.std(sound) > 1e-3


def test_what_was_written_simulates_again_to_the_same_bytes(described: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "1", tmp_path / "2"
    start = ["simulate", "--duration", "1", "--seed", "3", "--axis"]
    more = ["--mechanism", "hysteresis", "--set", "hysteresis.torque_n_m=12", "--out", str(first)]
    assert run([*start, str(described), *more]) == 0
    assert run([*start, str(first / "axis.toml"), "--out", str(second)]) == 0
    for name in ("telemetry.csv", "sound.wav"):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_telemetry_as_parquet_holds_the_numbers_of_the_csv(described: Path, tmp_path: Path) -> None:
    start = ["simulate", "--duration", "1", "--axis", str(described), "--out", str(tmp_path)]
    assert run(start) == 0
    assert run([*start, "--parquet"]) == 0
    one, other = (read_telemetry(tmp_path / f"telemetry.{ending}") for ending in ("csv", "parquet"))
    assert one.channels.keys() == other.channels.keys()
    for name in one.channels:
        assert np.array_equal(one[name], other[name])


@pytest.fixture
def train(tmp_path: Path) -> Path:
    path = tmp_path / "paper.toml"
    path.write_text(PAPER, encoding="utf-8")
    return path


def test_a_drive_train_by_modelica_s_names(train: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["simulate", "--train", str(train), "--out", str(out), "--duration", "2", "--rate", "1000"]
    assert run([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [Path(name).name for name in document["files"]] == ["train.toml", "result.csv", "events.csv"]
    assert document["duration_s"] == 2.0
    assert document["channels"]["load.w"]["unit"] == "rad/s"
    assert (out / "train.toml").read_text(encoding="utf-8") == PAPER
    wanted = simulate(COMPOSED, 2.0, 1000.0)
    read = csv.read_csv(out / "result.csv")
    assert read.column_names == ["time_s", *wanted.channels]
    for name in wanted.channels:
        np.testing.assert_allclose(read.column(name).to_numpy(), wanted[name], rtol=1e-9, atol=1e-9)
    events = (out / "events.csv").read_text(encoding="utf-8").splitlines()
    assert events[0] == "time_s,component,from,to"
    assert len(events) == 1 + len(wanted.events) == 1 + sum(document["events"].values())
    first = wanted.events[0]
    assert events[1] == f"{first.time_s!r},{first.component},{first.from_name},{first.to_name}"
    assert run([*words, "--parquet"]) == 0
    assert str(out / "result.parquet") in capsys.readouterr().out
    assert parquet.read_table(out / "result.parquet").column("load.w").equals(read.column("load.w"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--axis {axis} --mechanism backlsh", "did you mean 'backlash'"),
        ("--axis {axis} --mechanism backlash --set gap_rad=2", "backlash.gap_rad: must be 0 to 0.1 rad, got 2"),
        ("--axis {axis} --mechanism backlash --set gap=1", "--set gap: no --mechanism given here has this parameter"),
        ("--axis {axis} --mechanism backlash --set gap_rad", "--set: must be PARAM=VALUE"),
        ("--axis {axis} --mechanism backlash@gripper", "backlash.location: must be one of output, transfer"),
        ("--axis {axis} --set gap_rad=1e-3", "--set gap_rad: needs a --mechanism"),
        ("--axis {axis} --duration 1e5", "duration_s: must be at most"),
        ("", "give --axis or --train, one of them"),
        ("--train {train} --axis {train}", "give --axis or --train, one of them"),
        ("--train {train} --mechanism backlash", "go with --axis"),
        ("--train {train} --rate 0", "sample_rate_hz: must be > 0"),
        ("--train {train}.no", "no such file"),
        ("--train {wrong}", "line 10: components.motor.J: must be > 0 kg.m2, got -0.6"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(
    described: Path, train: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str, said: str
) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(PAPER.replace("J = 0.6", "J = -0.6"), encoding="utf-8")
    given = words.format(axis=described, train=train, wrong=wrong).split()
    assert run(["simulate", *given, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()
