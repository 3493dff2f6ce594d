"""A log as a controller writes it: rows on ticks of its servos, some late or lost, in units of its own."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tests.robot_bank.log import coloured_noise
from tests.robot_bank.multibody import Array
from tests.robot_bank.second.dynamics import STEP_S
from tests.robot_bank.second.servo import Run


@dataclass(frozen=True, eq=False)
class Recorder:
    """How a controller records.

    late: share of rows that come a tick or more late, their stamps being right; shaken: error of stamps [s], rms;
    stamp: to what they are rounded [s]; lost: share of rows that are missing. filtered: all channels are means over the
    period. sensor: noise (n,) of the measured torques [N m], rms, the share `coloured` of its variance below corner_hz;
    bits: their steps (n,) [N m]. speeds: whether they are logged. unit: of torques, N.m, A or %; constants: (n,) N m
    for one of it. digits: behind the point, of angles.
    """

    rate_hz: float
    seconds: float
    late: float
    shaken: float
    stamp: float
    lost: float
    filtered: bool
    sensor: Array
    coloured: float
    corner_hz: float
    bits: Array
    speeds: bool
    unit: str
    constants: Array
    digits: int
    degrees: bool
    header: bool
    delimiter: str
    start: float

    def errors(self, step: float, gear: float) -> tuple[float, float]:
        """Return the errors of angles [rad, at the joint] and of stamps [s], rms; step: of the encoder [rad]."""
        written = 10.0**-self.digits * (np.pi / 180 if self.degrees else 1.0) / gear
        return float(np.hypot(step, written) / 12**0.5), float(np.hypot(self.shaken, self.stamp / 12**0.5))


@dataclass(frozen=True, eq=False)
class Log:
    """What is logged, at the joints: stamps (m,) [s], angles, speeds and torques (m, n)."""

    time: Array
    angles: Array
    speeds: Array | None
    torques: Array


def draw_recorder(rng: np.random.Generator, rated: Array, turning_only: bool, seconds: float | None) -> Recorder:
    """Draw a recorder for joints of rated torques (n,) [N m]."""
    rate = float(rng.choice([50, 100, 125, 250, 500, 1000], p=[0.1, 0.2, 0.2, 0.25, 0.15, 0.1]))
    longest = 60 if rate <= 125 else 40 if rate <= 250 else 25
    unit = str(rng.choice(["N.m", "A", "%"]))
    constants = {"N.m": np.ones(len(rated)), "A": rated * rng.uniform(0.02, 0.08, len(rated)), "%": rated / 100}[unit]
    drawn_seconds = float(rng.integers(15, longest + 1))
    return Recorder(
        rate_hz=rate,
        seconds=drawn_seconds if seconds is None else seconds,
        late=float(rng.choice([0.0, 0.1, 0.5])) if rate <= 250 else 0.0,
        shaken=float(rng.choice([0.0, 2e-5, 2e-4])) if rate <= 250 else 0.0,
        stamp=1e-3 if rate <= 125 and rng.random() < 0.4 else 1e-6,
        lost=float(rng.choice([0.0, 0.0, 0.003, 0.015])),
        filtered=bool(rng.random() < 0.5),
        sensor=rated * rng.uniform(0.0015, 0.004) * rng.uniform(0.8, 1.25, len(rated)),
        coloured=float(rng.uniform(0.0, 0.5)),
        corner_hz=float(rng.uniform(1.0, 10.0)),
        bits=rated * 4 / 2 ** float(rng.integers(11, 15)),
        speeds=bool(rng.random() < 0.6),
        unit=unit,
        constants=np.array([float(f"{value:.5g}") for value in constants]),
        digits=int(rng.choice([4, 5, 6, 7], p=[0.15, 0.25, 0.3, 0.3] if rate <= 125 else [0.0, 0.3, 0.4, 0.3])),
        degrees=bool(turning_only and rng.random() < 0.25),
        header=bool(rng.random() < 0.7),
        delimiter=str(rng.choice([",", ";", "\t"])),
        start=float(rng.choice([0.0, 0.0, rng.uniform(5, 5000)])),
    )


def rows(rng: np.random.Generator, recorder: Recorder) -> Array:
    """Return the ticks (m,) at which rows are taken, counted from where the log begins."""
    count = int(recorder.seconds * recorder.rate_hz)
    period = 1 / recorder.rate_hz / STEP_S
    ticks = np.round(np.arange(count) * period).astype(int)
    most = max(1, min(4, int(period) // 4))
    ticks = ticks + np.where(rng.random(count) < recorder.late, rng.integers(1, most + 1, count), 0)
    kept = rng.random(count) >= recorder.lost
    return ticks[kept]


def seen(recorder: Recorder, course: Array) -> Array:
    """Return channels (m, n) at all ticks as they are before rows are taken of them."""
    if not recorder.filtered:
        return course
    # an odd number of ticks about each, so that nothing comes late
    width = max(1, round(1 / recorder.rate_hz / STEP_S)) | 1
    return np.asarray(ndimage.uniform_filter1d(course, width, axis=0, mode="nearest"))


def record(rng: np.random.Generator, recorder: Recorder, run: Run, offsets: Array, delays: Array) -> Log:
    """Return the log of a run, torques late by delays (n,) [s] and with offsets (n,) [N m], all at the joints."""
    at = int(np.searchsorted(run.time, -0.5 * STEP_S)) + rows(rng, recorder)
    torques = seen(recorder, run.torques)
    joints = range(torques.shape[1])
    late = np.column_stack([np.interp(run.time[at] - delays[j], run.time, torques[:, j]) for j in joints]) + offsets
    for j in range(late.shape[1]):
        slow = np.sqrt(recorder.coloured) * coloured_noise(rng, len(at), recorder.rate_hz, recorder.corner_hz)
        white = np.sqrt(1 - recorder.coloured) * rng.standard_normal(len(at))
        late[:, j] += recorder.sensor[j] * (slow + white)
    late = np.round(late / recorder.bits) * recorder.bits
    angles = seen(recorder, run.measured)[at]
    speeds = seen(recorder, run.measured_speeds)[at] if recorder.speeds else None
    stamps = run.time[at] + recorder.shaken * np.clip(rng.standard_normal(len(at)), -2, 2)
    stamps = np.round((stamps - stamps[0]) / recorder.stamp) * recorder.stamp
    return Log(stamps, angles, speeds, late)


def _columns(recorder: Recorder, log: Log, gears: Array) -> dict[str, tuple[list[str], Array, int]]:
    """Return by channel its columns' names, their values (m, k), and the digits behind their point."""
    n = log.angles.shape[1]
    turn = 180 / np.pi if recorder.degrees else 1.0
    numbers = range(1, n + 1)
    torques = log.torques / (gears if recorder.unit == "N.m" else recorder.constants)
    out = {
        "time_s": (["t"], (log.time + recorder.start)[:, None], 6),
        "motor_position_rad": ([f"pos{j}" for j in numbers], log.angles * gears * turn, recorder.digits),
        "motor_torque_nm": ([f"load{j}" for j in numbers], torques, 5),
    }
    if log.speeds is not None:
        out["motor_speed_rad_s"] = ([f"vel{j}" for j in numbers], log.speeds * gears * turn, 5)
    return out


def write_log(recorder: Recorder, log: Log, gears: Array) -> str:
    """Return the log as text; gears (n,) are 1 where it is of the joints."""
    held = _columns(recorder, log, gears)
    table = np.column_stack([values for _, values, _ in held.values()])
    formats = [f"%.{digits}f" for labels, _, digits in held.values() for _ in labels]
    row = recorder.delimiter.join(formats) + "\n"
    head = recorder.delimiter.join(label for labels, _, _ in held.values() for label in labels) + "\n"
    return (head if recorder.header else "") + (row * len(table)) % tuple(table.ravel().tolist())


_ALONG = {"rad": "m", "rad/s": "m/s", "N.m": "N"}
"""Units of joints that slide."""


def write_map(recorder: Recorder, log: Log, gears: Array, sliding: tuple[bool, ...]) -> str:
    """Return the channel map: columns by name, or by number where the log has no header; sliding: (n,)."""
    angle = "deg" if recorder.degrees else "rad"
    lines = ['schema = "gearcase-channels/1"', *([] if recorder.header else ["header = false"])]
    number = 1
    for channel, (labels, _, _) in _columns(recorder, log, gears).items():
        listed = [f'"{label}"' if recorder.header else str(number + k) for k, label in enumerate(labels)]
        number += len(labels)
        column = listed[0] if channel == "time_s" else f"[{', '.join(listed)}]"
        unit = {"motor_position_rad": angle, "motor_speed_rad_s": f"{angle}/s"}.get(channel, recorder.unit)
        units = ["s"] if channel == "time_s" else [_ALONG.get(unit, unit) if slides else unit for slides in sliding]
        said = f'"{units[0]}"' if len(set(units)) == 1 else json.dumps(units)
        lines += ["", f"[{channel}]", f"column = {column}", f"unit = {said}"]
        if channel == "motor_torque_nm" and recorder.unit != "N.m":
            lines.append(f"factor = [{', '.join(f'{value:.8g}' for value in recorder.constants / gears)}]")
    return "\n".join(lines) + "\n"
