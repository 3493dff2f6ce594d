"""Runs of an axis in the limited process."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from signals.reading.limited_pool import RefusedError
from signals.reading.limited_worker import Send
from sim.description.axis_document import read_axis
from sim.errors import SimulationError
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.virtual_measurement import measure

CHANNELS = ("motor_torque_nm", "load_speed_rad_s")
measure(PAPER_AXIS, 0.01)  # compiled and kept on disk before limits count: no file is written afterwards


def task(request: Mapping[str, Any], _: Mapping[str, float], send: Send) -> int:
    """Task: simulate an axis, send time, motor torque, speed of the output and sound (float32); return the rows."""
    try:
        found = measure(read_axis(request["axis"]), request["duration_s"])
    except SimulationError as error:
        raise RefusedError("simulation", str(error)) from error
    recorded = found.telemetry
    for samples in (recorded.time_s, *(recorded.channels[name] for name in CHANNELS), found.sound):
        send(np.ascontiguousarray(samples, dtype=np.float32).data)
    return recorded.rows
