"""What the motion of a record excites (persistence of excitation): what it does not have, it cannot show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.preprocessing import STANDSTILL_SHARE, Measurement, standstill_weight
from sim.mechanisms.mechanism import Need

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
