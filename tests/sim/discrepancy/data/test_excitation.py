"""What a motion excites, and what a clock that is uneven leaves of a record."""

import numpy as np
import pytest

from casebase.signals.telemetry import Telemetry
from sim.description.axis_document import read_axis
from sim.discrepancy.data.clock import evened
from sim.discrepancy.data.excitation import lacking, turns
from sim.discrepancy.data.preprocessing import Measurement, prepare
from sim.mechanisms.mechanism import Need
from tests.sim.discrepancy.telemetry_of import RATE_HZ, swing

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


def test_rows_that_come_in_bursts_are_put_on_an_even_clock() -> None:
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.choice([0.002, 0.03, 0.05], 2000))
    told = Telemetry(time, {"motor_position_rad": np.sin(0.5 * time)})
    anew, (remark,) = evened(told)
    assert np.ptp(np.diff(anew.time_s)) < 1e-9
    assert anew.interval_s == pytest.approx(0.05, rel=1e-6)
    assert np.abs(anew["motor_position_rad"] - np.sin(0.5 * anew.time_s)).max() < 1e-3
    assert "averaged over 50 ms" in remark


def test_an_even_clock_with_rows_missing_stays_as_it_is() -> None:
    kept = np.delete(np.arange(2000), np.arange(0, 2000, 9))
    told = Telemetry(kept * 0.01, {"motor_position_rad": kept * 1.0})
    assert evened(told) == (told, ())
