"""What a motion excites."""

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import RATE_HZ, swing
from sim.description.axis_document import read_axis
from sim.investigation.data.excitation import lacking, turns
from sim.investigation.data.preprocessing import Measurement, prepare
from sim.mechanisms.mechanism import Need

TIME = np.arange(12_000) / RATE_HZ
GEARED = read_axis(
    {"motor": {"inertia_kg_m2": 0.1}, "stages": [{"name": "output", "ratio": 8}], "load": {"inertia_kg_m2": 1.0}}
)


def along(angle: np.ndarray) -> Measurement:
    return prepare(RATE_HZ, np.zeros(angle.size), angle, None)


@pytest.mark.parametrize(
    ("angle", "missing"),
    [
        (swing()[1], set()),
        (30.0 * TIME, {Need.BOTH_DIRECTIONS, Need.SEVERAL_SPEEDS}),
        (30.0 * TIME + 20.0 * np.sin(TIME), {Need.BOTH_DIRECTIONS}),
        (30.0 * np.abs(TIME - 6.0), {Need.SEVERAL_SPEEDS}),
        # a torque over the turn shakes the speed, and even turns it back: no motion that was asked for
        (30.0 * TIME + 1.1 * np.sin(30.0 * TIME), {Need.BOTH_DIRECTIONS, Need.SEVERAL_SPEEDS}),
    ],
    ids=["to and fro", "steady", "one way", "one speed", "shaken"],
)
def test_what_a_motion_does_not_have(angle: np.ndarray, missing: set[Need]) -> None:
    assert lacking(along(angle)) == missing


def test_a_gear_turns_as_often_as_the_motor_over_the_ratio() -> None:
    way = 40.0 * np.pi
    assert turns(GEARED, way, "motor") == pytest.approx(20.0, rel=1e-9)
    assert turns(GEARED, way, "output") == turns(GEARED, way, "load") == turns(GEARED, way, None)
    assert turns(GEARED, way, None) == pytest.approx(20.0 / 8.0, rel=1e-9)
