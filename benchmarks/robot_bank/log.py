"""A log as a robot's controller writes it: sampled by a clock that jitters, quantised, noisy, in units of its own."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import interpolate, signal

from benchmarks.robot_bank.multibody import Array


@dataclass(frozen=True, eq=False)
class Recorder:
    """How a controller records.

    jitter: of the instants, as a share of the period; stamp: to which times are rounded [s]. step: of the encoders at
    the joint [rad]; speed_noise [rad/s], None where no speed is logged. torque_noise: rms (6,) [N m] at the joint, the
    share `coloured` of its variance below corner_hz. constants: (6,) [N m/A], None where torques are logged. order: of
    the joints in the log. The rest is how the file is written.
    """

    rate_hz: float
    seconds: float
    jitter: float
    stamp: float
    step: float
    speed_noise: float | None
    torque_noise: Array
    coloured: float
    corner_hz: float
    constants: Array | None
    order: tuple[int, ...]
    degrees: bool
    time_unit: str
    header: str
    delimiter: str
    start: float


@dataclass(frozen=True, eq=False)
class Signals:
    """What is logged: times (n,) [s], angles, speeds and torques (n, 6), joints as the robot counts them.

    Angles [rad], speeds [rad/s] and torques [N m] are those of the joints, or of the motors where the gears are known.
    gears: (6,), 1 where they are not.
    """

    time: Array
    angles: Array
    speeds: Array | None
    torques: Array
    gears: Array


def draw_recorder(rng: np.random.Generator, rated: Array) -> Recorder:
    """Draw a recorder for joints of rated torques (6,) [N m]."""
    rate = float(rng.choice([50, 100, 100, 125, 200, 250, 500]))
    order = tuple(int(j) for j in rng.permutation(6)) if rng.random() < 0.1 else tuple(range(6))
    return Recorder(
        rate_hz=rate,
        seconds=float(rng.integers(15, 41)),
        jitter=float(rng.choice([0.0, 0.02, 0.1])),
        stamp=float(rng.choice([1e-3, 1e-4, 1e-6])) if rate <= 125 else float(rng.choice([1e-4, 1e-6])),
        step=float(np.exp(rng.uniform(np.log(2e-6), np.log(5e-5)))),
        speed_noise=float(rng.uniform(5e-4, 4e-3)) if rng.random() < 0.6 else None,
        torque_noise=rated * rng.uniform(0.002, 0.006) * rng.uniform(0.8, 1.2, 6),
        coloured=float(rng.uniform(0.0, 0.6)),
        corner_hz=float(rng.uniform(0.5, 5.0)),
        constants=np.round(rated * rng.uniform(0.03, 0.06, 6), 4) if rng.random() < 0.5 else None,
        order=order,
        degrees=bool(rng.random() < 0.2),
        time_unit=str(rng.choice(["s", "s", "ms", "us"])),
        header=str(rng.choice(["none", "short", "long"])),
        delimiter=str(rng.choice([",", ",", ";", "\t"])),
        start=float(rng.choice([0.0, rng.uniform(10, 2000)])),
    )


def coloured_noise(rng: np.random.Generator, n: int, rate_hz: float, corner_hz: float) -> Array:
    """Return noise (n,) of variance 1 through a low-pass of first order."""
    keep = np.exp(-2 * np.pi * corner_hz / rate_hz)
    drive = rng.standard_normal(n) * np.sqrt(1 - keep**2)
    drive[0] = rng.standard_normal()
    return np.asarray(signal.lfilter([1.0], [1.0, -keep], drive))


def sample(
    rng: np.random.Generator,
    recorder: Recorder,
    time: Array,
    torque: Array,
    angle: Array,
    speed: Array,
    offsets: Array,
    delays: Array,
    gears: Array,
) -> Signals:
    """Return what is logged of true courses (n, 6) at the joints; offsets [N m] and delays [s] (6,) of the torques."""
    n = int(recorder.seconds * recorder.rate_hz)
    instants = (np.arange(n) + recorder.jitter * rng.uniform(-0.5, 0.5, n)) / recorder.rate_hz
    angles = interpolate.make_interp_spline(time, angle, k=3)(instants)
    angles = angles + recorder.step * rng.standard_normal((n, 6))
    angles = np.round(angles / recorder.step) * recorder.step
    speeds = None
    if recorder.speed_noise is not None:
        speeds = np.column_stack([np.interp(instants, time, speed[:, j]) for j in range(6)])
        speeds = speeds + recorder.speed_noise * rng.standard_normal((n, 6))
    torques = np.column_stack([np.interp(instants - delays[j], time, torque[:, j]) for j in range(6)]) + offsets
    for j in range(6):
        slow = np.sqrt(recorder.coloured) * coloured_noise(rng, n, recorder.rate_hz, recorder.corner_hz)
        white = np.sqrt(1 - recorder.coloured) * rng.standard_normal(n)
        torques[:, j] += recorder.torque_noise[j] * (slow + white)
    stamps = np.round((instants - instants[0]) / recorder.stamp) * recorder.stamp
    return Signals(stamps, angles * gears, None if speeds is None else speeds * gears, torques / gears, gears)


_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6}


def columns(recorder: Recorder, signals: Signals, names: tuple[str, ...]) -> dict[str, tuple[list[str], Array]]:
    """Return by channel the names of its columns and their values (n, k), in the units and the order of the log."""
    order = list(recorder.order)
    turn = 180 / np.pi if recorder.degrees else 1.0
    words = {"angle": "q", "speed": "qd", "torque": "current" if recorder.constants is not None else "tau"}
    if recorder.header == "long":
        words = {
            "angle": "position",
            "speed": "velocity",
            "torque": "effort" if words["torque"] == "tau" else "current",
        }

    def named(word: str) -> list[str]:
        if recorder.header == "long":
            return [f"{names[j]}/{word}" for j in order]
        return [f"{word}{k}" for k in range(1, 7)]

    torque = signals.torques if recorder.constants is None else signals.torques * signals.gears / recorder.constants
    out = {
        "time_s": (["time"], (signals.time + recorder.start)[:, None] * _SECOND[recorder.time_unit]),
        "motor_position_rad": (named(words["angle"]), signals.angles[:, order] * turn),
    }
    if signals.speeds is not None:
        out["motor_speed_rad_s"] = (named(words["speed"]), signals.speeds[:, order] * turn)
    out["motor_torque_nm"] = (named(words["torque"]), torque[:, order])
    return out


def write_log(recorder: Recorder, signals: Signals, names: tuple[str, ...]) -> str:
    """Return the log as text."""
    held = columns(recorder, signals, names)
    table = np.column_stack([values for _, values in held.values()])
    decimals = {"time_s": 6 if recorder.time_unit == "s" else 3, "motor_torque_nm": 5}
    formats = [f"%.{decimals.get(channel, 7)}f" for channel, (labels, _) in held.items() for _ in labels]
    row = recorder.delimiter.join(formats) + "\n"
    head = recorder.delimiter.join(label for labels, _ in held.values() for label in labels) + "\n"
    return ("" if recorder.header == "none" else head) + (row * len(table)) % tuple(table.ravel().tolist())


def write_map(recorder: Recorder, signals: Signals, names: tuple[str, ...]) -> str:
    """Return the channel map of the log: columns by name, or by number where the log has no header."""
    held = columns(recorder, signals, names)
    edges = np.cumsum([0] + [len(labels) for labels, _ in held.values()])
    angle = "deg" if recorder.degrees else "rad"
    units = {"time_s": recorder.time_unit, "motor_position_rad": angle, "motor_speed_rad_s": f"{angle}/s"}
    units["motor_torque_nm"] = "N.m" if recorder.constants is None else "A"
    lines = ['schema = "gearcase-channels/1"']
    if recorder.header == "none":
        lines.append("header = false")
    for (channel, (labels, _)), (first, after) in zip(held.items(), pairwise(edges), strict=True):
        numbered = [str(k) for k in range(int(first) + 1, int(after) + 1)]
        listed = numbered if recorder.header == "none" else [f'"{label}"' for label in labels]
        column = listed[0] if channel == "time_s" else f"[{', '.join(listed)}]"
        lines += ["", f"[{channel}]", f"column = {column}", f'unit = "{units[channel]}"']
        if channel == "motor_torque_nm" and recorder.constants is not None:
            factors = recorder.constants / signals.gears
            lines.append(f"factor = [{', '.join(f'{factors[j]:.8g}' for j in recorder.order)}]")
    return "\n".join(lines) + "\n"
