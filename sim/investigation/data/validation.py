"""The check before any physics: can these channels be what they claim, and which rows of them count?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import find_objects, label

from signals.columns.clock import rows_of, stamps_from_zero
from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.channel_checks import check_channels
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
from sim.investigation.data.sample_defects import Rows, bridged, quantum
from sim.mechanisms import Clipping, LostSamples

SAME = 1e-6  # of an interval: by which floating numbers are beside their rows
NEAR = 0.301  # of the median interval, by which a step of an even clock differs at most: more than 0.3, a tie of digits
USUAL = 0.95  # of the steps are no longer than the longest usual one
LONG = 2.001  # times the longest usual step: what happens within a longer gap is not seen
MOST_MISSING = 0.2  # of the rows
AGAIN = 2e-3  # of the way that rows which repeat would leave out, where the axis has not rested in them


@dataclass(frozen=True)
class EvenRecord:
    """A telemetry over an even clock from 0 on, and which of its rows rest on measured ones, shape (n,).

    `irregular`: rows beside a step of the clock unlike the others, where a jump is as likely one of the clock;
    `missing`, `repeated`: rows that an even clock lacks, and that were logged again; `remarks`: on the clock.
    """

    telemetry: Telemetry
    measured: Rows
    irregular: Rows
    missing: int
    repeated: int
    remarks: tuple[str, ...]


def evened(t: Telemetry) -> EvenRecord:
    """The telemetry on the even clock of its rows; where it has none, interpolated at its median interval.

    Rows whose stamps scatter without drift are on an even clock where the axis moves more smoothly by that.

    Raises
    ------
    InvestigationError
        where too many rows are missing.
    """
    fresh, repeated = without_repeats(t)
    times = stamps_from_zero(fresh.time_s)
    steps = np.diff(times)
    row, interval = rows_of(times)
    even = bool(np.all(np.diff(row) > 0)) and row.size > (1.0 - MOST_MISSING) * row[-1]
    on_rows = interval * row.astype(np.float64)
    if even and float(np.abs(times - on_rows).max()) > SAME * interval:
        angle = _angle(fresh)
        even = angle is not None and _bend(angle, on_rows) < _bend(angle, times)
    if even:
        times = on_rows
        clock = interval * np.arange(int(row[-1]) + 1, dtype=np.float64)
        measured = np.isin(np.arange(clock.size), row)
    else:
        interval, longest = (float(np.quantile(steps, share)) for share in (0.5, USUAL))
        clock = interval * np.arange(int(times[-1] / interval + SAME) + 1, dtype=np.float64)
        after = np.clip(np.searchsorted(times, clock), 1, times.size - 1)
        nearest = np.minimum(np.abs(clock - times[after - 1]), np.abs(clock - times[after]))
        measured = (nearest < NEAR * interval) | (steps[after - 1] < LONG * longest)
    if float(measured.mean()) < 1.0 - MOST_MISSING:
        raise InvestigationError(
            f"time_s: {1.0 - measured.mean():.0%} of the rows are missing; a clock with at most {MOST_MISSING:.0%} "
            "gaps is needed"
        )

    def on_clock(values: Array) -> Array:
        if not even:
            return np.asarray(PchipInterpolator(times, values)(clock))
        out: Array = np.interp(clock, times, values)
        out[row] = values
        return out

    remarks = []
    if repeated:
        remarks.append(
            f"{repeated} of {t.rows} rows repeat the row before in all channels while the axis moves on: the same "
            "packet logged again. They were left out."
        )
    if not even:
        remarks.append(
            f"time_s: the steps are {1e3 * steps.min():.2g} to {1e3 * steps.max():.2g} ms long; the channels were "
            f"interpolated every {1e3 * interval:.2g} ms, what is faster than {0.5 / longest:.2g} Hz is not seen all "
            f"the time, and {int((~measured).sum())} rows in gaps of more than {1e3 * LONG * longest:.2g} ms do not "
            "count."
        )
    anew = replace(
        fresh,
        time_s=clock,
        channels={name: on_clock(values) for name, values in fresh.channels.items()},
        lost={name: np.interp(clock, times, gone.astype(float)) > 0.0 for name, gone in fresh.lost.items()},
    )
    missing = int((~measured).sum()) if even else 0
    return EvenRecord(anew, measured, _irregular(times, clock), missing, repeated, tuple(remarks))


def _angle(t: Telemetry) -> Array | None:
    return t.channels.get("motor_position_rad", t.channels.get("load_position_rad"))


def _bend(angle: Array, times: Array) -> float:
    """How far each row is from the line between its neighbours, rms: a moving axis shows when its rows were measured.

    Stamps of packets that came evenly and were read late scatter; those of rows read at uneven times do not.
    """
    share = (times[1:-1] - times[:-2]) / (times[2:] - times[:-2])
    return float(np.std(angle[1:-1] - angle[:-2] - share * (angle[2:] - angle[:-2])))


def _irregular(times: Array, clock: Array) -> Rows:
    """Rows of an even `clock` within two of a step that is unlike the others."""
    steps = np.diff(times)
    out = np.zeros(clock.size, dtype=np.bool_)
    for place in np.flatnonzero(np.abs(steps / np.median(steps) - 1.0) > NEAR):
        first, last = np.searchsorted(clock, (times[place], times[place + 1]))
        out[max(int(first) - 2, 0) : int(last) + 3] = True
    return out


def without_repeats(t: Telemetry) -> tuple[Telemetry, int]:
    """The telemetry without rows that repeat all channels of the row before while the axis moves on, and how many.

    An axis at rest repeats its rows, too, and one that creeps those within a step of its encoder. Where most of the way
    lies in such rows the recorder asks more often than packets come, and those at rest are none either.
    """
    angle = _angle(t)
    if angle is None or len(t.channels) < 2:
        return t, 0
    measured = [values for name, values in t.channels.items() if name != "known_torque_nm"]
    same = np.all([np.diff(values) == 0.0 for values in measured], axis=0)
    step, whole = quantum(angle), float(np.abs(np.diff(angle)).sum())
    moving, way = np.zeros_like(same), 0.0
    for (rows,) in find_objects(label(same[:-1])[0]):
        gone = abs(angle[rows.stop + 1] - angle[rows.stop]) - step
        if gone > 0.5 * step:
            moving[rows] = True
            way += gone
    if way <= AGAIN * whole:
        return t, 0
    kept = ~np.concatenate([[False], same if way > 0.5 * whole else moving])
    anew = replace(
        t,
        time_s=t.time_s[kept],
        channels={name: values[kept] for name, values in t.channels.items()},
        lost={name: gone[kept] for name, gone in t.lost.items()},
    )
    return anew, int((~kept).sum())


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
    check_channels(axis, even if reference is None else {**even, "reference": reference})
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
