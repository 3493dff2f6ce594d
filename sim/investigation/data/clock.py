"""The rows of a log on an even clock: without packets that were logged again, those that are missing marked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import find_objects, label

from signals.columns.clock import rows_of, stamps_from_zero
from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.investigation.data.data_fault import InvestigationError
from sim.investigation.data.sample_defects import Rows, quantum

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
