"""The limited process's part of a preview: it reads the log, and says what such a log can show of an axis."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.report.svg import Series, extremes
from app.web.log_preview import shares
from signals.reading.limited_worker import Send
from signals.reading.telemetry_worker import read
from signals.telemetry import Telemetry, telemetry_of
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.assessment.remarks import excitation_remarks, shown_remark
from sim.investigation.data.excitation import excitation_in
from sim.investigation.kinematics.encoders_alone import NOT_TOLD
from sim.investigation.model.one_body import UNDESCRIBED, with_motor_motion

NO_AXIS = "Choose the axis above to see what its gears can show."


def task(request: Mapping[str, Any], limits: Mapping[str, float], send: Send) -> None:
    """Task: read a log and send its preview (JSON)."""
    blocks: list[bytes] = []
    found = read({**request, "send": True}, limits, lambda block: blocks.append(bytes(block)))
    telemetry = telemetry_of(bytearray().join(blocks), found)
    axis = read_axis(request["axis"] or UNDESCRIBED)
    told = [*remarks(axis, with_motor_motion(axis, telemetry)), *([] if request["axis"] else [NO_AXIS])]
    courses = courses_of(telemetry, int(request["points"]))
    send(json.dumps({**courses, "remarks": told}).encode())


def remarks(axis: Axis, telemetry: Telemetry) -> list[str]:
    """What such a log can show of an axis, and what not."""
    if "motor_torque_nm" not in telemetry:
        return [NOT_TOLD]
    e = excitation_in(telemetry)
    if e is None:
        return ["Without a position or speed the torque shows nothing: name one of them."]
    return [shown_remark(axis, e), *excitation_remarks(e)]


def courses_of(telemetry: Telemetry, points: int) -> dict[str, object]:
    """Torque and speed over time, lowest and highest of each interval where there are more rows than points."""
    x = time_s = telemetry.time_s - telemetry.time_s[0]
    series = []
    for name, unit, values in _channels(telemetry):
        x, y = extremes(Series(name, time_s, values), points // 2)
        series.append({"name": name, "unit": unit, "largest": float(np.abs(y).max()), "y": shares(y)})
    shown = [round(float(each), 5) for each in x]
    return {"x": shown, "series": series, "rows": telemetry.rows, "seconds": telemetry.duration_s}


def _channels(t: Telemetry) -> list[tuple[str, str, NDArray[np.float64]]]:
    """What is drawn: torque, and the speed of the motor, or of the load where the motor's is not there."""
    out = [("motor torque", "N m", t["motor_torque_nm"])] if "motor_torque_nm" in t else []
    for end in ("motor", "load"):
        if f"{end}_speed_rad_s" in t:
            return [*out, (f"{end} speed", "rad/s", t[f"{end}_speed_rad_s"])]
        if f"{end}_position_rad" in t:
            return [*out, (f"{end} speed", "rad/s", np.gradient(t[f"{end}_position_rad"], t.time_s))]
    return out
