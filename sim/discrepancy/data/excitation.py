"""What the motion of a record excites (persistence of excitation): what it does not have, it cannot show."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from sim.description.axis import Axis
from sim.discrepancy.data.preprocessing import Measurement
from sim.mechanisms.mechanism import Need
from sim.torsional.model import Array

LEAST_WAY = 0.05  # of the rows in motion that go the other way: the ends of the speed's range are taken from as many
FEWEST_TURNS = 5.0  # of the motor in a record, from which one of them is short
LEAST_RANGE = 0.2  # of the speed: over less viscous friction changes by no more than the form of its law is off


def turns(axis: Axis, m: Measurement, location: str | None) -> float:
    """Turns of the shaft at a location in the record, of the load's where none is given."""
    place = "load" if location is None else location
    return float(np.ptp(m.angle)) * axis.ratio_from(place) / axis.ratio / (2.0 * np.pi)


def travelling_speed(m: Measurement) -> Array:
    """Speed without what comes back at every turn of the motor [rad/s], shape (n,).

    What ripple makes of the speed is its answer and no motion that was asked for. Of a motor that turns seldom the
    speed as it is.
    """
    path = float(np.abs(np.diff(m.angle)).sum()) / (2.0 * np.pi)
    rows = int(m.samples / path) if path > FEWEST_TURNS else 1
    return np.asarray(uniform_filter1d(m.speed, max(rows, 1)))


def lacking(m: Measurement) -> frozenset[Need]:
    """What this record does not have, by the rows that count."""
    speed = travelling_speed(m)[m.weight > 0.5]
    return lacking_at(speed) if speed.size else frozenset(Need)


def lacking_at(speed: Array) -> frozenset[Need]:
    """What rows of these speeds do not have, shape (n,), n > 0.

    At one speed dry and viscous friction are the same torque; one way, dry friction, its asymmetry and an offset are.
    """
    ahead = float((speed > 0.0).mean())
    slow, fast = np.quantile(np.abs(speed), [LEAST_WAY, 1.0 - LEAST_WAY])
    missing = {Need.BOTH_DIRECTIONS} if min(ahead, 1.0 - ahead) < LEAST_WAY else set()
    return frozenset(missing | ({Need.SEVERAL_SPEEDS} if fast - slow < LEAST_RANGE * fast else set()))
