"""What the motion of a record excites (persistence of excitation): what it does not have, it cannot show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.preprocessing import STANDSTILL_SHARE, Measurement, standstill_weight
from sim.mechanisms.mechanism import Need

ERROR_ORDERS = 10  # per turn of the load: errors of assembly; what repeats faster is of teeth
WHOLE = 0.95  # of a turn: what is left of it hides no error once per turn


def is_whole(angle: Array) -> bool:
    """Whether `angle` (n,) passes a whole turn."""
    return float(np.ptp(angle)) > WHOLE * 2.0 * math.pi


def over_the_way(angle: Array, order: int) -> Array:
    """cos(order pi s) of the way s from one end of `angle` (n,) to the other: all together are any curve over it."""
    return np.asarray(np.cos(order * math.pi * (angle - angle.min()) / max(float(np.ptp(angle)), 1e-300)))


def orders_beyond_twice(angle: Array) -> Array:
    """Order of each wave of `beyond_twice`, per turn or per twice the way, shape (k,)."""
    if is_whole(angle):
        return np.tile(np.arange(3.0, ERROR_ORDERS + 3), 2)
    return np.asarray(np.arange(1.0, 2 * ERROR_ORDERS + 1), dtype=np.float64)


def beyond_twice(angle: Array) -> tuple[Array, Array]:
    """What repeats three times per turn of `angle` (n,) and more, or of less than a turn any curve; and its slopes.

    Shape (k, n), with as many waves either way: a motion that goes farther has the same numbers. Slopes per rad.
    """
    orders = orders_beyond_twice(angle)[:, None]
    if not is_whole(angle):
        turn = math.pi / max(float(np.ptp(angle)), 1e-300)
        phase = orders * turn * (angle - angle.min())
        return np.cos(phase), -orders * turn * np.sin(phase)
    half = orders.size // 2
    sine, cosine = np.sin(orders * angle), np.cos(orders * angle)
    waves = np.concatenate([sine[:half], cosine[half:]])
    return waves, orders * np.concatenate([cosine[:half], -sine[half:]])


def errors_over(angle: Array) -> Array:
    """All of an encoder's or a gear's error over `angle` (n,) that is none of teeth: waves of once and twice per turn,
    and those of `beyond_twice`, shape (k, n)."""
    low = [part for k in (1, 2) for part in (np.sin(k * angle), np.cos(k * angle))]
    return np.stack([*low, *beyond_twice(angle)[0]])


LEAST_WAY = 0.05  # of the rows in motion that go the other way: the ends of the speed's range are taken from as many
FEWEST_TURNS = 5.0  # of the motor in a record, from which one of them is short
LEAST_RANGE = 0.2  # of the speed: over less viscous friction changes by no more than the form of its law is off


@dataclass(frozen=True, eq=False)
class Excitation:
    """What a record is of, whatever an axis does in it.

    Args:
        rate_hz: rows per second [Hz].
        seconds: that it lasts [s].
        travel_rad: range of the motor's angle [rad].
        speed: of the motor in the rows in motion that count, shape (n,) [rad/s].
        at_load: whether the load has an encoder.
    """

    rate_hz: float
    seconds: float
    travel_rad: float
    speed: Array
    at_load: bool


def excitation_of(m: Measurement) -> Excitation:
    """Return what a measurement is of, by the rows that count."""
    speed = _travelling_speed(m.angle, m.speed)[m.weight > 0.5]
    return Excitation(m.rate_hz, m.samples / m.rate_hz, float(np.ptp(m.angle)), speed, m.load_angle is not None)


def excitation_in(t: Telemetry) -> Excitation | None:
    """Return the same of a log before it is checked; None where it has neither speed nor position of the motor."""
    if "motor_position_rad" in t:
        angle = t["motor_position_rad"]
        speed = np.gradient(angle, t.time_s)
    elif "motor_speed_rad_s" in t:
        speed = t["motor_speed_rad_s"]
        angle = np.cumsum(speed * np.gradient(t.time_s))
    else:
        return None
    counts = standstill_weight(speed, STANDSTILL_SHARE) > 0.5
    speed = _travelling_speed(angle, speed)[counts]
    return Excitation(t.sample_rate_hz, t.duration_s, float(np.ptp(angle)), speed, "load_position_rad" in t)


def turns(axis: Axis, travel_rad: float, location: str | None) -> float:
    """Turns of the shaft at a location while the motor's goes so far [rad], of the load's where none is given."""
    place = "load" if location is None else location
    return travel_rad * axis.ratio_from(place) / axis.ratio / (2.0 * np.pi)


def _travelling_speed(angle: Array, speed: Array) -> Array:
    """Speed without what comes back at every turn of the motor [rad/s], shape (n,).

    What ripple makes of the speed is its answer and no motion that was asked for. Of a motor that turns seldom the
    speed as it is.
    """
    path = float(np.abs(np.diff(angle)).sum()) / (2.0 * np.pi)
    rows = int(angle.size / path) if path > FEWEST_TURNS else 1
    return np.asarray(uniform_filter1d(speed, max(rows, 1)))


def lacking(m: Measurement) -> frozenset[Need]:
    """What the motion of this record does not have, by the rows that count."""
    return lacking_at(excitation_of(m).speed)


def lacking_at(speed: Array) -> frozenset[Need]:
    """What rows of these speeds do not have, shape (n,); neither where there are none.

    At one speed dry and viscous friction are the same torque; one way, dry friction, its asymmetry and an offset are.
    """
    if not speed.size:
        return frozenset({Need.BOTH_DIRECTIONS, Need.SEVERAL_SPEEDS})
    ahead = float((speed > 0.0).mean())
    slow, fast = np.quantile(np.abs(speed), [LEAST_WAY, 1.0 - LEAST_WAY])
    missing = {Need.BOTH_DIRECTIONS} if min(ahead, 1.0 - ahead) < LEAST_WAY else set()
    return frozenset(missing | ({Need.SEVERAL_SPEEDS} if fast - slow < LEAST_RANGE * fast else set()))
