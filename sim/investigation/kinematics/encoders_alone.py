"""What two encoders tell without the torque: transmission error and lost motion in motion, the gap by a pull test."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as t_distribution

from signals.telemetry import MINIMUM_ROWS, Telemetry
from sim.description.axis import Axis
from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.data.channel_checks import ALIKE, UNITS, check_channels
from sim.investigation.data.preprocessing import MOTION_CUT_HZ, Measurement, prepare
from sim.investigation.data.sample_defects import QUANTA, bridged, quantum, spikes
from sim.investigation.data.validation import EvenRecord, InvestigationError, check_clock, evened, reading_remarks
from sim.investigation.extended_axis import extended_by
from sim.investigation.hypotheses.identifiability import ALONE
from sim.investigation.kinematics.motion_findings import (
    AsNew,
    columns_of,
    findings_in_motion,
    gain_in_motion,
    like_a_gap,
    nameless_in_motion,
    place_of_gap,
    remarks_on_motion,
)
from sim.investigation.kinematics.transmission_error import INSIDE, Amplitude, TransmissionError, transmission_error
from sim.investigation.report.formatting import angle, number
from sim.investigation.report.panels import Panel
from sim.investigation.results import REPORTED, Estimate, Finding, Gain
from sim.investigation.unexplained import Unexplained
from sim.mechanisms import Backlash
from sim.mechanisms.catalogue import kind_of

Array = NDArray[np.float64]

HELD_S = 1.0  # in which a load comes to rest behind its motor
REST_S = 0.3  # that the load stays at a place at least: a hand holds it so long, nothing that rings does
RATE_HZ = 30.0  # ten rows in such a rest
STANDS = 0.1  # of a way, within which something stands, and lost motion at its ends may shorten it


@dataclass(frozen=True)
class RestPosition:
    """Where the load stayed [rad], and for how many rows."""

    angle: float
    rows: int


@dataclass(frozen=True)
class PullTest:
    """Ways between places of the load [rad]: pulled one way and the other, and let go after either."""

    pulled: tuple[float, ...]
    let_go: tuple[float, ...]


def pull_test(time_s: Array, motor: Array, load: Array) -> PullTest | None:
    """Find where a load was pulled to and fro; angles at the load, shape (n,) [rad]. None where it was not."""
    step = quantum(load)
    time_s, motor, load = _thinned(time_s, motor, load)
    interval = float(np.median(np.diff(time_s)))
    rest, settle = max(3, round(REST_S / interval)), round(HELD_S / interval)
    pulled: list[float] = []
    let_go: list[float] = []
    for first, end in _runs(motor, STANDS * float(np.ptp(motor - load))):
        held = load[first + settle : end]
        places = _places(held, rest) if held.size and np.ptp(held) > QUANTA * step else []
        ends = [k for k in range(1, len(places) - 1) if _turns(places[k - 1 : k + 2])]
        pulled += [abs(places[b].angle - places[a].angle) for a, b in pairwise(ends)]
        between = [places[a + 1 : b] for a, b in pairwise([*ends, len(places) - 1])]
        for one, other in pairwise(between):
            if one and other:
                let_go.append(abs(_longest(one).angle - _longest(other).angle))
    return PullTest(tuple(pulled), tuple(let_go)) if pulled else None


def _turns(three: Sequence[RestPosition]) -> bool:
    """Whether the middle one is the furthest of three."""
    before, here, after = (place.angle for place in three)
    return (here - before) * (here - after) > 0.0


def _longest(places: Sequence[RestPosition]) -> RestPosition:
    return max(places, key=lambda place: place.rows)


def _places(load: Array, rest: int) -> list[RestPosition]:
    """Where the load stays for at least `rest` rows, one after the other."""
    stands = STANDS * float(np.ptp(load))
    out: list[RestPosition] = []
    for first, end in _runs(load, stands):
        if end - first < rest:
            continue
        here = RestPosition(float(np.median(load[first:end])), end - first)
        if out and abs(out[-1].angle - here.angle) <= stands:
            here = RestPosition(out[-1].angle if out[-1].rows > here.rows else here.angle, out.pop().rows + here.rows)
        out.append(here)
    return out


def _runs(values: Array, within: float) -> Iterator[tuple[int, int]]:
    """First and last row (not included) of stretches whose range is `within`, from the first row on."""
    first, low, high = 0, float(values[0]), float(values[0])
    for row, value in enumerate(values.tolist()):
        low, high = min(low, value), max(high, value)
        if high - low > within:
            yield first, row
            first, low, high = row, value, value
    yield first, values.size


def _thinned(time_s: Array, *channels: Array) -> tuple[Array, ...]:
    """Means over intervals of `RATE_HZ`, of a slower clock the rows themselves."""
    _, place = np.unique(np.floor((time_s - time_s[0]) * RATE_HZ), return_inverse=True)
    count = np.bincount(place)
    return tuple(np.bincount(place, values) / count for values in (time_s, *channels))


FOLLOWS = 0.99  # correlation of two angles of the same motion
SLOWEST_HZ = 2.0  # of a load that is held or comes to rest for a second and more
SHOWN = 120  # points over the angle
SHOWN_ROWS = 2000
NEXT = (
    "Log the motor torque as well (motor_torque_nm; a current will do with its torque constant) and repeat the motion "
    "in both directions at several speeds: backlash, and friction that winds the gear up, differ in the torque at a "
    "reversal."
)
NOT_TOLD = (
    "Without the motor torque only what two encoders differ by is examined; friction, inertia, stiffness, weight, "
    "losses and ripple of the torque are not, and no number of the description is fitted."
)
PULLED_ALONE = (
    "The load was moved by hand while the motor held; what moves with the motor was not examined: give a record of "
    "that alone."
)
MISSING = (
    "telemetry: needs the channel motor_torque_nm (motor torque or force, N m or N); without it both "
    "motor_position_rad and load_position_rad, or load_position_rad and the reference_position_rad of a motor that "
    "holds while the load is moved by hand"
)
NO_MOTION = (
    "load_position_rad: the load does not move; a record of the axis in motion, or of the load moved by hand against "
    "a motor that holds, is needed; support the load first, for it may drop"
)
NOT_HELD = (
    "telemetry: without motor_torque_nm and motor_position_rad the reference_position_rad stands for a motor that "
    "holds while the load is pulled to and fro by hand and let go, which is not seen here; log motor_position_rad or "
    "motor_torque_nm"
)
NOT_STEADY = (
    "telemetry: without motor_torque_nm only steady motion away from reversals tells something, and there is too "
    "little of it; a longer record at even speed in both directions is needed, or motor_torque_nm"
)


@dataclass(frozen=True)
class EncodersAlone:
    """What the two encoders tell; no number of the description is fitted."""

    measurement: Measurement
    findings: tuple[Finding, ...]
    unexplained: Unexplained | None
    gain: tuple[Gain, ...]
    extended: Axis
    remarks: tuple[str, ...]
    panels: tuple[Panel, ...]


def encoders_alone(axis: Axis, telemetry: Telemetry) -> EncodersAlone:
    """Investigate angles of motor and load, of a log without torque.

    Raises
    ------
    InvestigationError
        for channels that are missing, stand still or have another unit, and for a motion that shows nothing.
    """
    motor_name = next((n for n in ("motor_position_rad", "reference_position_rad") if n in telemetry), None)
    if motor_name is None or "load_position_rad" not in telemetry:
        raise InvestigationError(MISSING)
    record = evened(telemetry)
    rate = check_clock(record.telemetry, SLOWEST_HZ)
    motor, load, good = _without_spikes(record, motor_name)
    if load.size < MINIMUM_ROWS:
        raise InvestigationError(NOT_STEADY)
    step = quantum(load)
    if float(np.ptp(load)) <= QUANTA * step:
        raise InvestigationError(NO_MOTION)
    driven, told_at = _driven(axis, motor_name, motor, load)
    remarks = [*record.remarks, *told_at, *reading_remarks(telemetry)]
    m = prepare(rate, np.zeros(load.size), driven * axis.ratio, load, good, good, MOTION_CUT_HZ)
    time_s = record.telemetry.time_s
    if _follows_otherwise(driven, load):
        check_channels(axis, {"angle": driven * axis.ratio, "load": load})
    pulled = pull_test(time_s, driven, load)
    if pulled is not None:
        findings = _of_pull(axis, pulled, step)
        shown = course(time_s, driven, load)
        told = (NOT_TOLD, PULLED_ALONE, *remarks)
        return EncodersAlone(m, findings, None, (), _extended(axis, findings), told, (shown,))
    if motor_name == "reference_position_rad":
        raise InvestigationError(NOT_HELD)
    if _alike(driven, load) < FOLLOWS or not _as_far(driven, load, ALIKE):
        check_channels(axis, {"angle": driven * axis.ratio, "load": load})
    seen = transmission_error(axis, m)
    if seen is None:
        raise InvestigationError(NOT_STEADY)
    findings = findings_in_motion(axis, seen)
    return EncodersAlone(
        m, findings, nameless_in_motion(axis, seen, findings), (gain_in_motion(seen, findings),),
        _extended(axis, findings), (NOT_TOLD, *remarks_on_motion(axis, seen), *remarks),
        (over_the_angle(seen, findings),),
    )  # fmt: skip


def _without_spikes(record: EvenRecord, motor_name: str) -> tuple[Array, Array, Array]:
    """Motor and load, shape (n,), and 1 where both were measured."""
    out, good = [], record.measured.copy()
    for name in (motor_name, "load_position_rad"):
        values = record.telemetry[name]
        lost = spikes(values) | record.telemetry.lost.get(name, False)
        out.append(bridged(values, ~lost))
        good &= ~lost
    return out[0], out[1], good.astype(np.float64)


def _follows_otherwise(driven: Array, load: Array) -> bool:
    """Whether the load follows the motor, but the other way round or not as far as the ratio says."""
    alike = _alike(driven, load)
    return alike < -FOLLOWS or (alike > FOLLOWS and not _as_far(driven, load))


def _alike(one: Array, other: Array) -> float:
    """Correlation, 0 with what stands still."""
    parts = [values / np.ptp(values) if np.ptp(values) > 0.0 else np.zeros(values.size) for values in (one, other)]
    parts = [values - values.mean() for values in parts]
    size = float(np.linalg.norm(parts[0]) * np.linalg.norm(parts[1]))
    return float(parts[0] @ parts[1]) / size if size > 0.0 else 0.0


def _as_far(one: Array, other: Array, about: float = STANDS) -> bool:
    """Whether two angles come about as far."""
    ways = sorted((float(np.ptp(one)), float(np.ptp(other))))
    return ways[0] > (1.0 - about) * ways[1]


def _driven(axis: Axis, name: str, motor: Array, load: Array) -> tuple[Array, tuple[str, ...]]:
    """The motor's angle over the ratio; that of a drive which tells it at the output already is taken for what it is.

    Not where the ratio is about the factor of a unit, and a wrong unit would look the same.
    """
    at_load = motor / axis.ratio
    if min(abs(math.log(axis.ratio / unit)) for unit in (1.0, *UNITS)) < STANDS:
        return at_load, ()
    if not _as_far(motor, load) or _alike(motor, load) <= 0.0:
        return at_load, ()
    return motor, (
        f"{name} moves as far as load_position_rad and not {axis.ratio:.6g} times as far: it is an angle "
        "of the output, and was read as one.",
    )


def _of_pull(axis: Axis, test: PullTest, step: float) -> tuple[Finding, ...]:
    new, loaded = AsNew.of(axis, 0.0), _mean(test.pulled, step)
    let_go = _mean(test.let_go, step) if test.let_go else None
    if not new.has_less(loaded):
        return ()
    text = (
        f"While the motor held, the load was pulled to and fro {len(test.pulled)} times and came "
        f"{number(loaded.value)} rad ({angle(loaded.value)}) from end to end"
    )
    if let_go is None:
        text += "; it never came to rest between, so that a gap and what gives way cannot be told apart."
        low, value, sure = 0.0, loaded.value, ALONE
    else:
        text += (
            f"; let go after either, it came to rest {number(let_go.value)} rad ({angle(let_go.value)}) apart. The gap "
            "is between the two: what is pulled gives way besides, and what is let go springs back into the gap until "
            "friction holds it."
        )
        low, value = max(let_go.low, 0.0), 0.5 * (let_go.value + loaded.value)
        sure = WEIGHTS.cap if new.surely_has_less(let_go) else ALONE
    gap = Estimate("gap_rad", value, "rad", low, loaded.high)
    return (Finding(Backlash.name, place_of_gap(axis), sure, (gap,), like_a_gap(axis), text),)


def _mean(ways: Sequence[float], step: float) -> Amplitude:
    """Mean, and what its scatter and the steps of the encoder leave uncertain, one at either end of a way."""
    count, value = len(ways), float(np.mean(ways))
    scatter = float(np.var(ways, ddof=1)) / count if count > 1 else 0.0
    error = math.sqrt(scatter + step**2 / 6.0)
    reach = float(t_distribution.isf(INSIDE, max(count - 1, 1))) * error
    return Amplitude(value, error, value - reach, value + reach)


def _extended(axis: Axis, findings: Sequence[Finding]) -> Axis:
    """With what was said, as far as `simulate` takes it so large."""
    found: dict[tuple[str, str | None], dict[str, float]] = {}
    for finding in findings:
        numbers = {e.name: e.value for e in finding.parameters}
        largest = {p.name: p.high for p in kind_of(finding.mechanism).parameters}
        if finding.location and finding.probability >= REPORTED and all(numbers[n] <= largest[n] for n in numbers):
            found[finding.mechanism, finding.location] = numbers
    return extended_by(axis, {}, found)


def over_the_angle(seen: TransmissionError, findings: Sequence[Finding]) -> Panel:
    """Means over the angle, forth and back, with the model of what was found."""
    around = seen.angle % (2.0 * math.pi) if seen.whole else seen.angle
    low, high = float(around.min()), float(around.max())
    cell = np.minimum(((around - low) / (high - low) * SHOWN).astype(np.int64), SHOWN - 1)
    model = seen.error - seen.left_by(seen.fitted(columns_of(seen, findings)))
    lines = []
    for way, name in ((1.0, "forth"), (-1.0, "back")):
        rows = seen.direction == way
        if rows.any():
            lines.append((f"measured, {name}", _means(cell[rows], seen.error[rows])))
            lines.append((f"with what was found, {name}", _means(cell[rows], model[rows])))
    x = low + (np.arange(SHOWN) + 0.5) / SHOWN * (high - low)
    title = "Motor over ratio, less load"
    return Panel(title, "angle of the load [rad]", "difference [rad]", "load angle", x, tuple(lines))


def _means(cell: NDArray[np.int64], values: Array) -> Array:
    count = np.bincount(cell, minlength=SHOWN)
    return np.where(count > 0, np.bincount(cell, values, SHOWN) / np.maximum(count, 1), np.nan)


def course(time_s: Array, driven: Array, load: Array) -> Panel:
    """Angles over time, shape (n,)."""
    every = max(1, time_s.size // SHOWN_ROWS)
    lines = (("motor, at the load", driven[::every]), ("load", load[::every]))
    return Panel("Load pulled while the motor holds", "time [s]", "angle [rad]", "time", time_s[::every], lines)
