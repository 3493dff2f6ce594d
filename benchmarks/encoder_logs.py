"""Logs of two encoders made by hand: strokes, a play operator, runout; no code of the simulator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis

Array = NDArray[np.float64]
RATE_HZ = 200.0
RATIO = 50.0
STEP = 2.0 * np.pi / 2**17


def axis(backlash_rad: float = 0.0, error_rad: float = 0.0, **load: float) -> Axis:
    """A gear of ratio 50, as stiff as `stiffness_n_m_per_rad` of a stage says."""
    stage = {"name": "output", "ratio": RATIO, "backlash_rad": backlash_rad, "transmission_error_rad": error_rad}
    stage["stiffness_n_m_per_rad"] = 1e5
    return read_axis({"motor": {"inertia_kg_m2": 1e-3}, "stages": [stage], "load": {"inertia_kg_m2": 1.0, **load}})


def strokes(speeds: Sequence[float], way_rad: float = 7.0, ramp_s: float = 0.3) -> Array:
    """Angle of the output, forth and back over a way at each of these speeds, one after the other [rad]."""
    speed = []
    for top in speeds:
        ramp = np.linspace(0.0, top, round(ramp_s * RATE_HZ))
        hold = np.full(max(1, round((way_rad / top - ramp_s) * RATE_HZ)), top)
        there = np.concatenate([ramp, hold, ramp[::-1]])
        speed += [there, -there]
    return np.asarray(np.cumsum(np.concatenate(speed)) / RATE_HZ)


def play(driven: Array, gap: float) -> Array:
    """What a load with friction follows: it stays until the other side of the gap pushes it."""
    out = np.empty_like(driven)
    here = driven[0] - 0.5 * gap
    for row, angle in enumerate(driven.tolist()):
        here = min(max(here, angle - 0.5 * gap), angle + 0.5 * gap)
        out[row] = here
    return out


def log(
    driven: Array,
    gap: float = 0.0,
    runout: float = 0.0,
    lag_s: float = 0.0,
    seed: int = 0,
    noise: float = 1e-5,
    step: float = STEP,
) -> Telemetry:
    """What both encoders read; the noise of the load's is half white, half slow (0.2 s)."""
    rng = np.random.default_rng(seed)
    load = play(driven, gap)
    load = load - runout * np.sin(load + 0.4) - lag_s * np.gradient(load) * RATE_HZ
    white = rng.standard_normal((2, driven.size))
    slow = np.zeros(driven.size)
    keep = np.exp(-1.0 / (0.2 * RATE_HZ))
    for row in range(1, driven.size):
        slow[row] = keep * slow[row - 1] + np.sqrt(1.0 - keep**2) * white[1, row]
    load = np.round((load + noise * (white[0] + slow)) / step) * step
    motor = np.round(driven * RATIO / STEP) * STEP
    return Telemetry(np.arange(driven.size) / RATE_HZ, {"motor_position_rad": motor, "load_position_rad": load})
