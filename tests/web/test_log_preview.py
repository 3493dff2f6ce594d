"""What a preview draws is what was measured, and what it says is what an investigation would say."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.web.log_preview import POINTS, levels, log_preview
from app.web.log_preview_worker import courses_of
from signals.errors import TelemetryError
from signals.telemetry import Telemetry
from sim.description.axis_document import read_axis

BODY = read_axis({"motor": {"inertia_kg_m2": 0.1}, "load": {"inertia_kg_m2": 0.0}})


def test_the_level_of_a_sine_is_its_effective_value() -> None:
    sine = np.sin(2 * np.pi * 100 * np.arange(48_000) / 48_000).astype(np.float32)
    assert levels(3 * sine, 960) == pytest.approx(np.full(50, 3 / np.sqrt(2)), rel=1e-3)
    assert levels(sine[:1000], 960).size == 2


def test_no_peak_is_lost_of_a_long_log() -> None:
    time = np.arange(50_000) / 1000
    torque = np.sin(time)
    torque[31_234] = 7.0
    drawn = courses_of(Telemetry(time, {"motor_torque_nm": torque, "motor_position_rad": time}), POINTS)
    x, series = drawn["x"], drawn["series"]
    assert isinstance(x, list)
    assert isinstance(series, list)
    assert len(x) <= POINTS
    assert (np.diff(x) > 0).all()
    assert series[0]["largest"] == 7.0
    assert x[int(np.argmax(series[0]["y"]))] == pytest.approx(31.234, abs=0.1)
    assert series[1]["largest"] == pytest.approx(1.0)
    json.dumps(drawn, allow_nan=False)


def test_a_log_is_previewed_or_refused_as_it_would_be_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t [s],torque,q\n" + "".join(f"{k / 100},{k % 7},{k / 50}\n" for k in range(300)))
    with pytest.raises(TelemetryError, match="motor_torque_nm has no unit"):
        log_preview(path, None, None)
    map_ = "[time_s]\ncolumn = 1\n[motor_torque_nm]\ncolumn = 2\n[motor_position_rad]\ncolumn = 3\n"
    found = log_preview(path, map_, None)
    assert found["rows"] == 300
    assert found["series"][1]["largest"] == pytest.approx(2.0)
    assert found["remarks"][0].startswith("100 rows per second for 2.99 s")
    assert found["remarks"][-1].startswith("Choose the axis")
