"""The gate before any physics: can these channels be what they claim, and which rows of them count?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from casebase.signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.discrepancy.data.channel_checks import check_channels
from sim.discrepancy.data.clock import evened, irregular
from sim.discrepancy.data.controller_law import DriveLaw, drive_law
from sim.discrepancy.data.data_fault import Fault, InvestigationError, TooLittleMotion
from sim.discrepancy.data.plausibility import check_description, with_first_inertia
from sim.discrepancy.data.preprocessing import (
    LEAST_ROWS,
    SLOW_ANGLE_CUT_HZ,
    SLOW_DIRECT_ANGLE_CUT_HZ,
    Measurement,
    prepare,
)
from sim.discrepancy.data.repair import repair
from sim.discrepancy.data.sample_defects import bridged, moves_on, quantum
from sim.mechanisms import Clipping, LostSamples
from sim.torsional.model import Array

__all__ = ["Fault", "Gate", "InvestigationError", "examine"]

LEAST_SECONDS = 2.0
SLOWEST_HZ, FASTEST_HZ = 10.0, 50_000.0
CLOCK_ERROR = 0.01  # share by which a clock that is rounded to 0.1 ms is off at most
LONG_GAP_S = 5e-3
CHANCE = 0.01  # of one spell in a whole record, in which the torque repeats by chance


@dataclass(frozen=True)
class Gate:
    """Channels ready for the fit, faults found in them, what the drive's law says, remarks for the report.

    `axis`: the description with a first value for each number that is `unknown` in it.
    """

    measurement: Measurement
    faults: tuple[Fault, ...]
    law: DriveLaw | None
    remarks: tuple[str, ...]
    axis: Axis
    unknown: frozenset[str] = frozenset()


def examine(axis: Axis, telemetry: Telemetry, doubts: Array | None = None, gear: float = 1.0) -> Gate:
    """Check, repair what can be repaired (saying so), refuse what cannot.

    `doubts`: ways in which the known torque may be wrong as a whole, each by a standard deviation, shape (rows, p)
    [N m at the load]. `gear`: turns of the motor per turn of what it moves as one body.

    Raises
    ------
    InvestigationError
        for missing channels, a standing axis, units that are wrong by a factor, channels swapped or turned.
    """
    times = telemetry.time_s
    step_rad = quantum(telemetry.channels.get("motor_position_rad", np.zeros(0)))  # as it is read: a clock divides it
    telemetry, uneven = evened(telemetry)
    rate, torque, angle, load = _channels(telemetry)
    valid, grid = _clock(telemetry, rate)
    load_lost = telemetry.lost.get("load_position_rad")
    channels = {"torque": torque, "angle": angle} | ({} if load is None else {"load": load})
    even = {name: _even(telemetry, grid, values) for name, values in channels.items()}
    reference = telemetry.channels.get("reference_position_rad")
    beside = {} if reference is None else {"reference": _even(telemetry, grid, reference)}
    known = telemetry.channels.get("known_torque_nm")
    known = None if known is None else _even(telemetry, grid, known)
    check_channels(axis, even | beside, rate)
    valid = valid * _present(telemetry, grid)
    held = _held(even["angle"], even["torque"], valid, step_rad)
    faults = _lost(valid, held) + _clipped(even["torque"])
    lost = held | (valid <= 0.5)
    even = {name: bridged(values, ~lost) for name, values in even.items()}
    odd = np.ones_like(lost) if uneven else irregular(telemetry, grid)
    mended = repair(even, axis.ratio, rate, float(grid[0]), lost, step_rad, odd)
    even, faults = mended.channels, _together([*faults, *mended.faults])
    valid = (~mended.torque_lost).astype(float) * _unclipped(even["torque"], faults)
    load_valid = (~((mended.load_lost & ~lost) | _long(mended.lost, rate))).astype(float)
    if load_lost is not None:
        load_valid *= np.interp(grid, telemetry.time_s, (~load_lost).astype(float))
    cut = SLOW_ANGLE_CUT_HZ if axis.stages else SLOW_DIRECT_ANGLE_CUT_HZ
    measurement = prepare(rate, even["torque"], even["angle"], even.get("load"), valid, load_valid, cut, known)
    measurement = replace(measurement, gear=gear)
    if doubts is not None:
        measurement = _doubted(measurement, grid[0], times, doubts / axis.ratio)
    used = _used(measurement)
    axis, unknown = with_first_inertia(axis, measurement, used)
    remarks = [*uneven, *check_description(axis, measurement, used, unknown)]
    remarks += reading_remarks(telemetry)
    if load is None and axis.stages:
        remarks.append(
            "Without a load encoder a stiffness that hardens or holds back looks the same as friction at reversals: "
            "neither is looked for."
        )
    law = None
    if "reference" in beside:
        course = bridged(beside["reference"], ~lost)
        law = drive_law(measurement, rate, even["torque"], even["angle"], course)
    return Gate(measurement, tuple(faults), law, tuple(remarks), axis, unknown)


def _doubted(m: Measurement, first_s: float, times: Array, doubts: Array) -> Measurement:
    ways = [np.interp(first_s + m.time_s, times, way) for way in doubts.T]
    return replace(m, doubts=np.stack(ways, axis=1)) if ways else m


def _channels(t: Telemetry) -> tuple[float, Array, Array, Array | None]:
    if "motor_torque_nm" not in t:
        raise InvestigationError("telemetry: needs the channel motor_torque_nm (motor torque or force, N m or N)")
    rate = check_clock(t)
    if "motor_position_rad" in t:
        angle = t["motor_position_rad"]
    elif "motor_speed_rad_s" in t:
        angle = np.concatenate(
            [[0.0], np.cumsum(0.5 * np.diff(t.time_s) * (t["motor_speed_rad_s"][1:] + t["motor_speed_rad_s"][:-1]))]
        )
    else:
        raise InvestigationError("telemetry: needs motor_position_rad (or motor_speed_rad_s) beside motor_torque_nm")
    return rate, t["motor_torque_nm"], angle, t.channels.get("load_position_rad")


def check_clock(t: Telemetry, slowest_hz: float = SLOWEST_HZ) -> float:
    """Samples per second; refuses what no clock in seconds can be, and a record that is too short."""
    rate = t.sample_rate_hz
    if not (1.0 - CLOCK_ERROR) * slowest_hz <= rate <= (1.0 + CLOCK_ERROR) * FASTEST_HZ:
        raise InvestigationError(
            f"time_s: {rate:.6g} samples per second cannot be right; {slowest_hz:g} to {FASTEST_HZ:g} are expected, "
            "with time_s in seconds"
        )
    if t.duration_s < LEAST_SECONDS:
        raise InvestigationError(
            f"telemetry: {t.duration_s:.3g} s are too short; at least {LEAST_SECONDS:g} s of motion are needed"
        )
    return rate


def _clock(t: Telemetry, rate: float) -> tuple[Array, Array]:
    """1 where a row of the even grid has a measured neighbour, and the grid [s]."""
    count = round(t.duration_s * rate) + 1
    grid = t.time_s[0] + np.arange(count) / rate
    near = np.clip(np.searchsorted(t.time_s, grid), 1, t.rows - 1)
    gap = t.time_s[near] - t.time_s[near - 1]
    lost = (
        (gap > 1.5 / rate)
        & (np.abs(grid - t.time_s[near]) > 0.3 / rate)
        & (np.abs(grid - t.time_s[near - 1]) > 0.3 / rate)
    )
    if lost.mean() > 0.2:
        raise InvestigationError(
            f"time_s: {lost.mean():.0%} of the rows are missing; an even clock with at most 20 % gaps is needed"
        )
    return (~lost).astype(float), grid


def reading_remarks(t: Telemetry) -> list[str]:
    """Which columns were not used, and as what the others were read where they have other names."""
    unused = [f"column {name} is not a known channel and was not used" for name in t.ignored]
    return [*unused, *([f"The telemetry was read as:\n{t.recognised}"] if t.recognised else [])]


def _even(t: Telemetry, grid: Array, values: Array) -> Array:
    """The channel on the even grid; rows of a clock that is even are themselves, to the last digit."""
    if t.rows == grid.size and float(np.abs(t.time_s - grid).max()) < 1e-3 * t.interval_s:
        return values
    return np.interp(grid, t.time_s, values)


def _present(t: Telemetry, grid: Array) -> Array:
    out = np.ones(grid.size)
    for name in ("motor_torque_nm", "motor_position_rad"):
        if name in t.lost:
            out *= np.interp(grid, t.time_s, (~t.lost[name]).astype(float)) > 0.99
    return out


def _held(angle: Array, torque: Array, valid: Array, step_rad: float) -> NDArray[np.bool_]:
    """Rows that repeat the row before although the motor moves, by many steps `step_rad` of its encoder per row.

    How far it has moved is told by the first row that repeats no more, however long that lasts: about as fast, and the
    same way, as before. A motor that breaks away, creeps or turns back has not moved on. Beside such rows also short
    spells in which it hardly moves, where chance would not repeat the torque as often.
    """
    steps = np.diff(angle)
    step = np.abs(steps)
    usual = float(np.median(step))
    jump = np.abs(np.diff(torque))
    again = jump <= 1e-4 * float(np.median(jump))
    spells, _ = label((step < 1e-4 * usual) & again)
    by_chance = max(float(again[step > 0.0].mean()), 1.0 / again.size) if (step > 0.0).any() else 1.0
    fewest = np.log(CHANCE / again.size) / np.log(min(by_chance, 0.99))
    held = np.zeros(angle.size, dtype=np.bool_)
    short = held.copy()
    longest = 0
    for (rows,) in find_objects(spells):
        length = rows.stop - rows.start
        if (
            rows.stop < step.size
            and step[rows.stop] / (length + 1) > max(0.01 * usual, 8.0 * step_rad)
            and moves_on(steps[: rows.start], steps[rows.stop] / (length + 1))
        ):
            held[rows.start + 1 : rows.stop + 1] = True
            longest = max(longest, length)
        elif length >= fewest:
            short[rows.start + 1 : rows.stop + 1] = True
    for (rows,) in find_objects(label(short)[0]):
        if rows.stop - rows.start <= longest:
            held[rows] = True
    return held & (valid > 0.5)


def _long(lost: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Lost rows of gaps too long for a smooth way over them to be as good as the load's encoder."""
    out = np.zeros(lost.size, dtype=np.bool_)
    for (rows,) in find_objects(label(lost)[0]):
        out[rows] = (rows.stop - rows.start) > LONG_GAP_S * rate
    return out


def _lost(valid: Array, held: NDArray[np.bool_]) -> list[Fault]:
    missing = int((valid < 0.5).sum())
    repeated = int(held.sum())
    share = (missing + repeated) / valid.size
    if share < 5e-4:
        return []
    text = (
        f"{missing} rows are missing and {repeated} repeat the row before "
        f"while the motor moves: {share:.2%} of all; they were left out."
    )
    return [Fault(LostSamples.name, None, {"fraction": share}, text)]


def _together(faults: list[Fault]) -> list[Fault]:
    """Rows of the motor's channels that are lost beside rows lost of all channels are of the same kind: one finding."""
    lost = [f for f in faults if f.mechanism == LostSamples.name and f.location in (None, "motor")]
    if len(lost) < 2 or lost[0].location is not None:
        return faults
    first, more = lost[0], lost[1:]
    share = sum(f.parameters["fraction"] for f in lost)
    text = " ".join([first.explanation, "Besides:", *(f.explanation for f in more)])
    one = Fault(first.mechanism, None, {**first.parameters, "fraction": share}, text)
    return [one, *(f for f in faults if f not in lost)]


def _clipped(torque: Array) -> list[Fault]:
    """Rows that stay exactly at the extremes, for longer than a smooth signal would."""
    faults = []
    for way, edge in ((1.0, float(torque.max())), (-1.0, float(torque.min()))):
        at = torque == edge
        runs = int((at[1:] & at[:-1]).sum())
        if runs >= 20 and abs(edge) > 0.3 * float(np.abs(torque).max()) and np.unique(torque).size > 50:
            faults.append((way, edge, float(at.mean())))
    if not faults:
        return []
    share = sum(f[2] for f in faults)
    level = max(abs(f[1]) for f in faults)
    text = f"The motor torque stays at its extreme of {level:.4g} N m in {share:.2%} of all rows: "
    text += "the channel is cut there."
    return [Fault(Clipping.name, "motor", {"torque_n_m": level, "fraction": share}, text)]


def _unclipped(torque: Array, faults: list[Fault]) -> Array:
    if not any(f.mechanism == Clipping.name for f in faults):
        return np.ones(torque.size)
    inside: Array = np.asarray((torque < torque.max()) & (torque > torque.min()), dtype=np.float64)
    return inside


def _used(m: Measurement) -> NDArray[np.bool_]:
    used = m.weight > 0.5
    if used.sum() < LEAST_ROWS:
        raise TooLittleMotion(
            "telemetry: too few rows in motion that count; a longer record of the axis in motion is needed"
        )
    return np.asarray(used)
