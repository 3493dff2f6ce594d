"""Faults of single channels that can be repaired: rows that were never measured, encoders that slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import binary_dilation, find_objects, label, uniform_filter1d

from sim.chain.model import Array
from sim.investigation.data.data_fault import Fault
from sim.investigation.data.preprocessing import one_body
from sim.investigation.data.sample_defects import (
    BEFORE_ROWS,
    QUANTA,
    Rows,
    bridged,
    jumps,
    moves_on,
    quantum,
    spikes,
    stays,
)
from sim.mechanisms import EncoderError, LostSamples

RETURNS_S = 1.0  # a channel that is back within this time was away; one that stays has slipped
SLOW_S = 2e-3  # between rows: beyond it a blow is as short as a row
SHORT_S = 0.1  # over which the torque of the motion tells whether it can have stayed
MOVES = 0.1  # of the usual speed: below, torque may stay by itself
SHOWN = 6  # times that a text gives
SMOOTH_S = 0.02
OFF = 2.5  # standard deviations


@dataclass
class Repaired:
    """Even channels of shape (n,) by name; rows of the motor's motion, its torque, the load that do not count."""

    channels: dict[str, Array]
    rate_hz: float
    lost: Rows
    torque_lost: Rows
    load_lost: Rows
    faults: list[Fault] = field(default_factory=list)

    def at(self, row: int) -> float:
        """Time of a row from the first on [s]."""
        return row / self.rate_hz


def repair(
    channels: dict[str, Array],
    ratio: float,
    rate_hz: float,
    lost: Rows,
    step_rad: float,
    irregular: Rows | None = None,
) -> Repaired:
    """Leave out rows that were never measured, put back what an encoder has slipped; `lost`: rows known as such;
    `step_rad`: of the motor's encoder.

    `irregular`: rows beside a step of the clock unlike all others, where a jump is as likely one of the clock.
    """
    out = Repaired(dict(channels), rate_hz, lost.copy(), lost.copy(), lost.copy())
    _torque(out)
    _motor(out, ratio, step_rad, np.zeros_like(lost) if irregular is None else irregular)
    out.torque_lost |= out.lost
    out.channels["torque"] = bridged(out.channels["torque"], ~out.torque_lost)
    if "load" in channels:
        _load(out, ratio)
    return out


def _torque(r: Repaired) -> None:
    torque, angle = r.channels["torque"], r.channels["angle"]
    alone = spikes(torque) & ~r.lost
    if 1.0 / r.rate_hz > SLOW_S:
        alone &= _beyond_all_others(torque, alone)
    stuck = _stuck(bridged(torque, ~alone), angle, r)
    found = alone | stuck
    _name_lost(r, found, "motor", "motor_torque_nm")
    r.torque_lost |= found


def _beyond_all_others(torque: Array, alone: Rows) -> Rows:
    rest = torque[~alone]
    return np.asarray(np.abs(torque - 0.5 * (rest.max() + rest.min())) > np.ptp(rest))


def _stuck(torque: Array, angle: Array, r: Repaired) -> Rows:
    """Rows in which the torque stays to the last digit while the motor moves on, and moves as if it was another."""
    out = np.zeros(torque.size, dtype=np.bool_)
    runs = [rows for rows in stays(torque) if not r.lost[rows].any()]
    if not runs:
        return out
    for rows in runs:
        out[rows] = True
    steps = np.abs(np.diff(torque))
    usual, pace = float(np.quantile(steps, 0.999)), float(np.median(np.abs(np.diff(angle))))
    largest = float(np.abs(torque[~out]).max(initial=0.0))
    left = _beyond_rigid(torque, angle, r.rate_hz, ~(out | r.lost))
    found = np.zeros_like(out)
    for rows in runs:
        length, level = rows.stop - rows.start, float(torque[rows.start])
        gone = float(np.ptp(angle[rows])) / length
        edges = [abs(float(torque[i] - torque[i - 1])) for i in (rows.start, rows.stop) if 0 < i < torque.size]
        cut = level in (torque.max(), torque.min()) and abs(level) > 0.3 * largest and abs(level) < 2.0 * largest
        jumped = max(edges, default=0.0) > 2.0 * usual and length / r.rate_hz <= RETURNS_S
        if (
            gone > MOVES * pace
            and not cut
            and (jumped or (length / r.rate_hz > SHORT_S and _off(left, rows, ~out & ~r.lost)))
        ):
            found[rows] = True
    return found


def _beyond_rigid(torque: Array, angle: Array, rate_hz: float, used: Rows) -> Array:
    """Torque beyond that of one inertia with friction along the measured motion [N m], shape (n,)."""
    width = max(3, int(SMOOTH_S * rate_hz))
    speed = np.gradient(uniform_filter1d(angle, width)) * rate_hz
    acceleration = np.gradient(uniform_filter1d(speed, width)) * rate_hz
    return one_body(torque, acceleration, speed, used)[1]


def _off(left: Array, rows: slice, used: Rows) -> bool:
    """Whether what is left over some rows is larger than over all others.

    Of a motor without current, which coasts, it is not: it moves as its torque says.
    """
    return bool(np.mean(left[rows] ** 2) > OFF**2 * np.mean(left[used] ** 2))


def _motor(r: Repaired, ratio: float, step_rad: float, irregular: Rows) -> None:
    angle = r.channels["angle"]
    alone = spikes(bridged(angle, ~r.lost)) & ~r.lost
    again = alone & binary_dilation(r.lost, iterations=2)  # of the same kind as those beside them
    r.lost |= again
    alone &= ~again
    wrong = (alone | _stuck_encoder(angle, step_rad)) & ~r.lost
    _name_lost(r, wrong, "motor", "motor_position_rad")
    r.lost |= wrong
    angle = bridged(angle, ~r.lost)
    slips = _slips(angle, ~r.lost)
    if slips and "load" in r.channels:
        load = dict(_slips(r.channels["load"] * ratio, ~r.lost))
        skipped = [s for s in slips if any(abs(row - s[0]) <= 1 for row in load)]
    else:
        skipped = [s for s in slips if _whole_rows(angle, *s)]
    unclear = [s for s in slips if irregular[s[0] : s[0] + 2].any()]
    skipped += [s for s in unclear if s not in skipped]
    if skipped:
        places = np.zeros(angle.size, dtype=np.bool_)
        for row, _ in skipped:
            places[row : row + 2] = True
        if not r.lost.any():  # else it has been said that rows are missing or repeated
            _name_lost(r, places, None, "all encoders")
        r.lost |= places
    real = [s for s in slips if s not in skipped]
    r.channels["angle"] = bridged(_put_back(r, angle, real, "motor", "motor_position_rad"), ~r.lost)


def _stuck_encoder(angle: Array, step_rad: float) -> Rows:
    """Rows in which the encoder stays, up to a step by far more than any around: the way that was not shown, by a motor
    that moved on as before.

    `step_rad`: of the encoder.
    """
    out = np.zeros(angle.size, dtype=np.bool_)
    ways = np.diff(angle)
    steps = np.abs(ways)
    for rows in stays(angle):
        last = rows.stop - 1
        if rows.start < BEFORE_ROWS + 2 or last + BEFORE_ROWS >= steps.size:
            continue  # a record may begin before the motion does, and end after it
        before, into = steps[rows.start - BEFORE_ROWS - 2 : rows.start - 2], steps[rows.start - 2 : rows.start]
        around = np.concatenate([before, steps[last + 1 : last + 1 + BEFORE_ROWS]])
        far = 3.0 * float(around.max()) + QUANTA * step_rad
        away = into.max() > far  # it leads to 0, maybe by a row in between that an even clock has made
        first = rows.start - 2 if away else rows.start
        pace = (angle[last + 1] - angle[first]) / (last + 1 - first)
        if steps[last] > far and moves_on(ways[:first], float(pace)):
            out[rows.start - 1 if away else rows.start + 1 : rows.stop] = True
    return out


def _whole_rows(angle: Array, row: int, size: float) -> bool:
    """Whether a jump is the way of a whole number of rows, as where rows are missing."""
    step = float(np.median(np.diff(angle)[max(row - BEFORE_ROWS, 0) : row + BEFORE_ROWS]))
    rows = size / step if step else 0.0
    return rows > 0.5 and abs(rows - round(rows)) < 0.05 * max(1.0, round(rows))


def _load(r: Repaired, ratio: float) -> None:
    load, motor = r.channels["load"], r.channels["angle"] / ratio
    load = bridged(load, ~r.lost)
    alone = spikes(load - motor) & ~r.lost
    clean = bridged(load, ~alone)
    stuck = _frozen(clean, motor, ~(r.lost | alone))
    clean = bridged(clean, ~stuck)
    slips = _slips(clean - motor, ~(r.lost | stuck))
    away, slips = _returning(slips, r.rate_hz * RETURNS_S)
    for first, last in away:
        stuck[first + 1 : last + 1] = True
    found = alone | stuck
    _name_lost(r, found, "load", "load_position_rad")
    r.load_lost |= found
    clean = bridged(load, ~found)
    r.channels["load"] = bridged(_put_back(r, clean, slips, "load", "load_position_rad"), ~r.load_lost)


def _frozen(load: Array, motor: Array, good: Rows) -> Rows:
    """Rows in which the load's encoder stays while the motor moves, up to a jump back to where it belongs."""
    out = np.zeros(load.size, dtype=np.bool_)
    runs = stays(load)
    if not runs:
        return out
    twist = load - motor
    steps = np.abs(np.diff(twist))
    usual = max(QUANTA * quantum(load), float(np.quantile(steps, 0.999)))
    for rows in runs:
        edges = [steps[i - 1] for i in (rows.start, rows.stop) if 0 < i < load.size]
        moved = abs(motor[rows.stop - 1] - motor[rows.start])
        if good[rows].all() and max(edges, default=0.0) > 2.0 * usual and moved > usual:
            out[rows] = True
    return out


def _slips(values: Array, good: Rows) -> list[tuple[int, float]]:
    """Jumps and their sizes, told by the lines on either side; of several at one place the largest."""
    found: list[tuple[int, float]] = []
    for row, size in jumps(values, good):
        if found and row - found[-1][0] <= 2:
            found[-1] = max(found[-1], (row, size), key=lambda s: abs(s[1]))
        else:
            found.append((row, size))
    return [(row, _size(values, row)) for row, _ in found]


def _size(values: Array, row: int) -> float:
    near = np.arange(1, BEFORE_ROWS + 1) - 0.5
    before, after = values[row - BEFORE_ROWS + 1 : row + 1][::-1], values[row + 1 : row + 1 + BEFORE_ROWS]
    return float(np.polyfit(near, after, 1)[1] - np.polyfit(near, before, 1)[1])


def _returning(
    slips: Sequence[tuple[int, float]], longest: float
) -> tuple[list[tuple[int, int]], list[tuple[int, float]]]:
    """Pairs of jumps that undo each other, and the jumps that stay."""
    away, stay = [], []
    rest = list(slips)
    while rest:
        row, size = rest.pop(0)
        if rest and rest[0][0] - row < longest and abs(size + rest[0][1]) < 0.2 * abs(size):
            away.append((row, rest.pop(0)[0]))
        else:
            stay.append((row, size))
    return away, stay


def _put_back(r: Repaired, values: Array, slips: Sequence[tuple[int, float]], location: str, channel: str) -> Array:
    """The channel without its slips; the rows on either side of each do not count."""
    if not slips:
        return values
    out = values.copy()
    lost = r.load_lost if location == "load" else r.lost
    for row, size in slips:
        out[row + 1 :] -= size
        lost[row : row + 2] = True
    row, size = max(slips, key=lambda s: abs(s[1]))
    times = ", ".join(f"{1e3 * s:.4g} mrad at {r.at(i + 1):.5g} s" for i, s in slips[:SHOWN])
    more = f" and {len(slips) - SHOWN} times more" if len(slips) > SHOWN else ""
    text = (
        f"{channel} jumps from one row to the next and stays: by {times}{more}. No drive train moves so: the encoder "
        "or its coupling has slipped, it has lost counts, or a clutch, belt or hub has slipped. What it slipped by was "
        "put back."
    )
    r.faults.append(Fault(EncoderError.name, location, {"slip_rad": size, "time_s": r.at(row + 1)}, text))
    return out


def _name_lost(r: Repaired, rows: Rows, location: str | None, channel: str) -> None:
    """Name rows that no axis can have made; nothing where there are none."""
    if not rows.any():
        return
    share, first = float(rows.mean()), int(np.argmax(rows))
    text = (
        f"Of {channel}, {int(rows.sum())} rows stand alone, stay while the axis moves on, or jump by the way of rows "
        f"that are missing, {_spans(r, rows)}: {share:.2%} of all; they were left out."
    )
    r.faults.append(Fault(LostSamples.name, location, {"fraction": share, "time_s": r.at(first)}, text))


def _spans(r: Repaired, rows: Rows) -> str:
    spells = find_objects(label(binary_dilation(rows))[0])
    shown = ", ".join(f"{r.at(s.start + 1):.5g} to {r.at(s.stop - 1):.5g}" for (s,) in spells[:SHOWN])
    return shown + (", ... s" if len(spells) > SHOWN else " s")
