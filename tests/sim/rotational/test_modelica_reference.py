"""The engines against trajectories that Dymola computed for examples of the Modelica Standard Library."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate
from tests.shared_data import shared
from tests.sim.rotational import modelica_examples as examples

Columns = dict[str, NDArray[np.float64]]
OWN_ERROR = {"First": 1e-3, "ElasticBearing/springDamper.w_rel": 1e-3}
"""Where the reference itself is no better than this, relative to the range; elsewhere 5e-5 is asked."""

CASES: list[tuple[str, Callable[[], DriveTrain], float, list[str]]] = [
    ("LossyGearDemo1", examples.lossy_gear_demo_1, 0.5, ["Inertia2.phi", "Inertia2.w"]),
    ("LossyGearDemo2", examples.lossy_gear_demo_2, 0.5, ["Inertia2.phi", "Inertia2.w"]),
    ("LossyGearDemo3", examples.lossy_gear_demo_3, 1.0, ["Inertia2.phi", "Inertia2.w"]),
    (
        "Backlash",
        examples.backlash,
        1.0,
        [f"{name}.{channel}" for name in ("elastoBacklash", "springDamper") for channel in ("phi_rel", "w_rel")],
    ),
    ("First", examples.first, 1.0, ["damper.phi_rel", "damper.w_rel", "inertia3.phi", "inertia3.w"]),
    (
        "ElasticBearing",
        examples.elastic_bearing,
        10.0,
        ["load.phi", "load.w", "shaft.phi", "shaft.w", "springDamper.phi_rel", "springDamper.w_rel"],
    ),
]

MODE_CHANGES = {
    "LossyGearDemo1": [
        ("gear", 0.0, 0, -1),
        ("gear", 0.080477129, -1, 0),
        ("gear", 0.199519901, 0, 1),
        ("gear", 0.371342745, 1, 0),
        ("gear", 0.464539462, 0, -1),
    ],
    "LossyGearDemo2": [
        ("gear", 0.0, 0, -1),
        ("gear", 0.063591105, -1, 0),
        ("gear", 0.230374016, 0, 1),
        ("gear", 0.308306846, 1, 0),
    ],
    "LossyGearDemo3": [("gear", 0.02, 1, 0)],
}


def read_reference(path: Path) -> Columns:
    """Columns of a reference file; of rows at one instant (an event) only the last."""
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    last = np.append(np.diff(table[:, 0]) > 0, True)
    return {name: table[last, i] for i, name in enumerate(rows[0])}


@pytest.mark.parametrize(("name", "build", "duration_s", "signals"), CASES, ids=[case[0] for case in CASES])
def test_trajectories_agree_with_dymola(
    name: str, build: Callable[[], DriveTrain], duration_s: float, signals: list[str]
) -> None:
    reference = read_reference(shared("data", "modelica_reference", name, f"{name}.csv"))
    rate = round(1 / float(np.median(np.diff(reference["time"]))))
    result = simulate(build(), duration_s, rate)
    index = np.rint(reference["time"] * rate).astype(int)
    on_grid = np.abs(index - reference["time"] * rate) < 1e-6
    for signal in signals:
        expected = reference[signal][on_grid]
        error = np.abs(result[signal][index[on_grid]] - expected).max() / np.ptp(expected)
        assert error < OWN_ERROR.get(f"{name}/{signal}", OWN_ERROR.get(name, 5e-5)), signal


@pytest.mark.parametrize("name", MODE_CHANGES)
def test_mode_changes_stand_at_the_instants_of_dymola(name: str) -> None:
    build, duration_s = next((case[1], case[2]) for case in CASES if case[0] == name)
    events = [event for event in simulate(build(), duration_s, 1000.0).events if event.component == "gear"]
    expected = MODE_CHANGES[name]
    assert [(e.from_mode, e.to_mode) for e in events[: len(expected)]] == [(a, b) for _, _, a, b in expected]
    times = [e.time_s for e in events[: len(expected)]]
    assert times == pytest.approx([time for _, time, _, _ in expected], abs=1e-6)


def test_two_frictions_on_one_shaft_break_away_together() -> None:
    events = simulate(examples.lossy_gear_demo_2(), 0.5).events
    last = {event.component: event.time_s for event in events}
    assert last["gear"] == last["bearingFriction"] == pytest.approx(0.472738, abs=1e-6)
