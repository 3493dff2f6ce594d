"""The check before any physics: can these channels be what they claim, and which rows of them count?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.channel_checks import check_channels
from sim.investigation.data.clock import EvenRecord, evened
from sim.investigation.data.data_fault import Fault, InvestigationError, TooLittleMotion
from sim.investigation.data.plausibility import check_description, with_first_inertia
from sim.investigation.data.preprocessing import (
    LEAST_ROWS,
    SLOW_ANGLE_CUT_HZ,
    SLOW_DIRECT_ANGLE_CUT_HZ,
    Measurement,
    prepare,
)
from sim.investigation.data.repair import repair
from sim.investigation.data.sample_defects import bridged, quantum
from sim.mechanisms import Clipping, LostSamples

__all__ = ["DataCheck", "Fault", "InvestigationError", "examine"]

LEAST_SECONDS = 2.0
SLOWEST_HZ, FASTEST_HZ = 10.0, 50_000.0
CLOCK_ERROR = 0.01  # share by which a clock that is rounded to 0.1 ms is off at most
LONG_GAP_S = 5e-3
LEAST_LOST = 5e-4  # of all rows: fewer are not named


@dataclass(frozen=True)
class DataCheck:
    """Channels ready for the fit, faults found in them, remarks for the report.

    `axis`: the description with a first value for each number that is `unknown` in it.
    """

    measurement: Measurement
    faults: tuple[Fault, ...]
    remarks: tuple[str, ...]
    axis: Axis
    unknown: frozenset[str] = frozenset()


def examine(axis: Axis, telemetry: Telemetry, doubts: Array | None = None, gear: float = 1.0) -> DataCheck:
    """Check, repair what can be repaired (saying so), refuse what cannot.

    `doubts`: ways in which the known torque may be wrong as a whole, each by a standard deviation, shape (rows, p)
    [N m at the load]. `gear`: turns of the motor per turn of what it moves as one body.

    Raises
    ------
    InvestigationError
        for missing channels, a standing axis, units that are wrong by a factor, channels swapped or turned.
    """
    times = telemetry.time_s - telemetry.time_s[0]
    step_rad = quantum(telemetry.channels.get("motor_position_rad", np.zeros(0)))  # as it is read: a clock divides it
    record = evened(telemetry)
    telemetry = record.telemetry
    rate, even = _channels(telemetry)
    reference, known = (telemetry.channels.get(name) for name in ("reference_position_rad", "known_torque_nm"))
    check_channels(axis, even if reference is None else {**even, "reference": reference}, rate)
    lost = ~record.measured
    for name in ("motor_torque_nm", "motor_position_rad"):
        lost |= telemetry.lost.get(name, False)
    faults = _lost(record) + _clipped(even["torque"])
    even = {name: bridged(values, ~lost) for name, values in even.items()}
    mended = repair(even, axis.ratio, rate, lost, step_rad, record.irregular)
    even, faults = mended.channels, _together([*faults, *mended.faults])
    valid = (~mended.torque_lost).astype(float) * _unclipped(even["torque"], faults)
    load_lost = (mended.load_lost & ~lost) | _long(mended.lost, rate) | telemetry.lost.get("load_position_rad", False)
    cut = SLOW_ANGLE_CUT_HZ if axis.stages else SLOW_DIRECT_ANGLE_CUT_HZ
    load_valid = (~load_lost).astype(float)
    measurement = prepare(rate, even["torque"], even["angle"], even.get("load"), valid, load_valid, cut, known)
    measurement = replace(measurement, gear=gear)
    if doubts is not None:
        measurement = _doubted(measurement, times, doubts / axis.ratio)
    used = _used(measurement)
    axis, unknown = with_first_inertia(axis, measurement, used)
    remarks = [*record.remarks, *check_description(axis, measurement, used, unknown)]
    remarks += reading_remarks(telemetry)
    if "load" not in even and axis.stages:
        remarks.append(
            "Without a load encoder a stiffness that hardens or holds back looks the same as friction at reversals: "
            "neither is looked for."
        )
    return DataCheck(measurement, tuple(faults), tuple(remarks), axis, unknown)


def _doubted(m: Measurement, times: Array, doubts: Array) -> Measurement:
    ways = [np.interp(m.time_s, times, way) for way in doubts.T]
    return replace(m, doubts=np.stack(ways, axis=1)) if ways else m


def _channels(t: Telemetry) -> tuple[float, dict[str, Array]]:
    """Rows per second, and torque, angle of the motor and of the load by their short names."""
    if "motor_torque_nm" not in t:
        raise InvestigationError("telemetry: needs the channel motor_torque_nm (motor torque or force, N m or N)")
    if "motor_position_rad" in t:
        angle = t["motor_position_rad"]
    elif "motor_speed_rad_s" in t:
        speed = t["motor_speed_rad_s"]
        angle = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t.time_s) * (speed[1:] + speed[:-1]))])
    else:
        raise InvestigationError("telemetry: needs motor_position_rad (or motor_speed_rad_s) beside motor_torque_nm")
    even = {"torque": t["motor_torque_nm"], "angle": angle}
    if "load_position_rad" in t:
        even["load"] = t["load_position_rad"]
    return check_clock(t), even


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


def reading_remarks(t: Telemetry) -> list[str]:
    """Which columns were not used, and as what the others were read where they have other names."""
    unused = [f"column {name} is not a known channel and was not used" for name in t.ignored]
    return [*unused, *([f"The telemetry was read as:\n{t.recognised}"] if t.recognised else [])]


def _long(lost: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Lost rows of gaps too long for a smooth way over them to be as good as the load's encoder."""
    out = np.zeros(lost.size, dtype=np.bool_)
    for (rows,) in find_objects(label(lost)[0]):
        out[rows] = (rows.stop - rows.start) > LONG_GAP_S * rate
    return out


def _lost(record: EvenRecord) -> list[Fault]:
    """Rows that an even clock lacks; where it has none there is no telling which."""
    share = record.missing / record.measured.size
    if share < LEAST_LOST:
        return []
    text = (
        f"{record.missing - record.repeated} rows are missing and {record.repeated} repeat the row before "
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
