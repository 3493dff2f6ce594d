"""Pull test: the load is moved by hand to and fro while the motor holds.

How far it comes while pulled is the gap and what gives way besides; where it comes to rest when it is let go it has
sprung back from the flank into the gap, and friction keeps it there. The gap lies between the two.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.investigation.data.sample_defects import quantum

Array = NDArray[np.float64]

HELD_S = 1.0  # in which a load comes to rest behind its motor
REST_S = 0.3  # that the load stays at a place at least: a hand holds it so long, nothing that rings does
RATE_HZ = 30.0  # ten rows in such a rest
STANDS = 0.1  # of the whole way, within which something stands
STEPS = 4.0  # of the encoder, which a way has at least: either end of it is off by half a step


@dataclass(frozen=True)
class HeldPosition:
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
        places = _places(held, rest) if held.size and np.ptp(held) > STEPS * step else []
        ends = [k for k in range(1, len(places) - 1) if _turns(places[k - 1 : k + 2])]
        pulled += [abs(places[b].angle - places[a].angle) for a, b in pairwise(ends)]
        between = [places[a + 1 : b] for a, b in pairwise([*ends, len(places) - 1])]
        for one, other in pairwise(between):
            if one and other:
                let_go.append(abs(_longest(one).angle - _longest(other).angle))
    return PullTest(tuple(pulled), tuple(let_go)) if pulled else None


def _turns(three: Sequence[HeldPosition]) -> bool:
    """Whether the middle one is the furthest of three."""
    before, here, after = (place.angle for place in three)
    return (here - before) * (here - after) > 0.0


def _longest(places: Sequence[HeldPosition]) -> HeldPosition:
    return max(places, key=lambda place: place.rows)


def _places(load: Array, rest: int) -> list[HeldPosition]:
    """Where the load stays for at least `rest` rows, one after the other."""
    stands = STANDS * float(np.ptp(load))
    out: list[HeldPosition] = []
    for first, end in _runs(load, stands):
        if end - first < rest:
            continue
        here = HeldPosition(float(np.median(load[first:end])), end - first)
        if out and abs(out[-1].angle - here.angle) <= stands:
            here = HeldPosition(out[-1].angle if out[-1].rows > here.rows else here.angle, out.pop().rows + here.rows)
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
