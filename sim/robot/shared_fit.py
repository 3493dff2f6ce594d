"""What the joints of a robot share, fitted over all of them together: payload, errors of masses, tilt of the base.

Torques are linear in all of it, so the posterior is a Gaussian; products of two (the gain of a drive, tilt or delay
times what a payload weighs) are taken at what was found the round before. Friction of each joint is any curve over its
speed here, with what its load adds to it, and may build up over a way after each reversal (Dahl 1968), which would be
taken for a delay and for other masses: its form is asked for joint by joint, later. For that, each joint is given the
rigid torque as the *other* joints correct it, and what is left uncertain of it as directions in which it may be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh
from scipy.ndimage import binary_opening
from scipy.special import log_ndtr

from sim.discrepancy.assessment.intervals import NINETY
from sim.discrepancy.estimation.whitening import SHORT, Noise, whitener
from sim.discrepancy.results import SAID
from sim.robot.band import Band
from sim.robot.motion import Motion, smoothed
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Robot

Array = NDArray[np.float64]

LINK_ERROR = 0.05  # of a link's mass and of the mean link's: two editions of a maker's data differ by 5.4 % of the mean
GAIN_ERROR = 0.05  # of the N m per ampere of a drive: what data sheets of motors allow, gears included
TILT_RAD = 0.02  # of the base: what feet are levelled to without an instrument
LATE_S = 0.005  # torque against position: half a period of a log of 100 Hz
LATEST_S = 0.05  # of one joint alone: a current that its drive smooths at 3 Hz
BUFFERED = 2.0  # rows by which a channel of a log is late at most
OWN = 0.025  # that one joint alone is late, or has a weight of its own: one name in forty
LOAD_LOSS = 0.1  # of what a joint carries, lost in its gears: a harmonic drive or a cycloid passes on 70 to 95 %
ROUNDS = 4  # of noise taken anew
BLOCK_S = 2.0  # rows apart by more are independent; for intervals that hold where noise is not white
TURNS = (0.01, 0.03, 0.1)  # of the largest speed, over which friction may turn its sign
WAYS = (2e-4, 1e-3, 5e-3)  # rad or m of a joint, over which friction may build up after a reversal
FINE = 8  # rows of a law of friction per row: it turns within one, and is smoothed as the torque was
RESTING = 0.005  # of the largest speed, below which friction is whatever holds
AGAINST = 0.5  # of the prior: a payload of which data say no more than this stays among what may be wrong
PRIOR = 0.1  # that something hangs at the flange that nobody described
LEAST_NOISE = 2e-3  # of the torque: no drive measures better


@dataclass(frozen=True)
class PayloadEstimate:
    """A body at the tool beside the described one: mass [kg], first moments [kg m], with their covariance (4, 4)."""

    numbers: Array
    covariance: Array
    probability: float

    @property
    def mass_kg(self) -> float:
        return float(self.numbers[0])

    @property
    def mass_deviation_kg(self) -> float:
        return math.sqrt(float(self.covariance[0, 0]))


@dataclass(frozen=True)
class Late:
    """By how much the torque of one joint alone is later than those of the others [s], and how likely it is late."""

    delay_s: float
    deviation_s: float
    probability: float

    def is_delay(self, row_s: float) -> bool:
        """Whether its interval of 90 % reaches down to what may be one, at most two rows where they are long: what
        wants to be later is none. A torque is smoothed and so late; it is early by the row in which a position is read
        at most."""
        if self.delay_s < 0.0:
            return -self.delay_s < row_s
        return abs(self.delay_s) - NINETY * self.deviation_s < max(LATEST_S, BUFFERED * row_s)

    def found_at(self, delay_s: float, deviation_s: float) -> Late:
        """The same as it was found beyond the linear picture: the log likelihood is the area below its slope, which
        falls from that of this picture to 0 there."""
        nats = 0.5 * self.delay_s * delay_s / self.deviation_s**2
        return Late(delay_s, deviation_s, _odds(math.log(deviation_s / LATEST_S) + nats))


@dataclass(frozen=True)
class SharedFit:
    """What all joints say together, of one log.

    `known`: torque that the rigid body asks for of each joint, corrected by the others, shape (rows, joints) [N m];
    `rigid`: the same as described; `errors`: of each joint, directions in which `known` may be wrong, shape (rows, p).
    `late_s`: delay of all torques against the positions [s]; `late`: of each joint beyond that.
    """

    motion: Motion
    rigid: Array
    known: Array
    errors: tuple[Array, ...]
    payload: PayloadEstimate
    tilt_rad: Array
    tilt_deviation_rad: Array
    late_s: float
    late: tuple[Late, ...] = ()


@dataclass(frozen=True)
class _Columns:
    """All that is linear in the torque of all joints, per standard deviation of its prior, shape (rows, joints, n)."""

    values: Array
    gains: slice
    tilt: slice
    late: slice
    payload: slice
    scale: Array  # of the payload's ten numbers
    links: Array  # ways in which links may be wrong, shape (links, 10, 10)
    regressor: Array
    level: Array  # the regressor of two changes of gravity, at rest, shape (2, rows, joints, links, 10)
    rate_hz: float

    def around(self, body: RigidBody, mean: Array) -> _Columns:
        """The same with gains, tilt and delay of the links and the payload that `mean` makes of the body's."""
        links = len(body.links)
        found = body.parameters + np.einsum("bpq,bq->bp", self.links, mean[: links * 10].reshape(links, 10))
        found[body.tool] += self.scale * mean[self.payload]
        rigid = np.einsum("njbp,bp->nj", self.regressor, found)
        joints = range(rigid.shape[1])
        values = self.values.copy()
        values[:, joints, [self.gains.start + j for j in joints]] = GAIN_ERROR * rigid
        values[..., self.tilt] = TILT_RAD * np.einsum("tnjbp,bp->njt", self.level, found)
        values[..., self.late] = -LATE_S * np.gradient(rigid, axis=0)[..., None] * self.rate_hz
        return replace(self, values=values)


@dataclass(frozen=True)
class Shared:
    """All that joints share, along a motion of the robot as described.

    `values`: torque per standard deviation of each number's prior, shape (rows, joints, n); the last are the delay of
    the log and ten of its payload, mass and first moments ahead. `rigid`: torque of the links [N m], shape (rows,
    joints).
    """

    values: Array
    rigid: Array


def shared_columns(robot: Robot, body: RigidBody, motion: Motion) -> Shared:
    """What the torques of all joints hang on, along a motion."""
    regressor = body.regressor(motion.position, motion.speed, motion.acceleration)
    columns = _columns(robot, body, motion, regressor)
    around = columns.around(body, np.zeros(columns.values.shape[-1]))
    return Shared(around.values, np.asarray(np.einsum("njbp,bp->nj", regressor, body.parameters)))


def shared_fits(robot: Robot, body: RigidBody, motions: Sequence[Motion]) -> tuple[SharedFit, ...]:
    """Fit what the joints share over all logs: links, drives and base are the same in them, payloads may not be.

    A weight at one joint alone (a counterweight that is missing, a hose) would be taken for masses, and what the others
    are told would be wrong. Where there is one, what that joint's torque does over its own angle tells the others
    nothing. Two at once are less likely than a model that is wrong otherwise.
    """
    fits, weights = _fitted(robot, body, motions, frozenset())
    likeliest = max(weights, key=lambda joint: weights[joint], default=-1)
    if likeliest < 0 or weights[likeliest] < SAID:
        return fits
    return _fitted(robot, body, motions, frozenset({likeliest}))[0]


def _fitted(
    robot: Robot, body: RigidBody, motions: Sequence[Motion], free: frozenset[int]
) -> tuple[tuple[SharedFit, ...], dict[int, float]]:
    """The fits, and how likely each joint that is not `free` has a weight of its own."""
    parts = [_Log.of(robot, body, motion, free) for motion in motions]
    common = parts[0].common
    size = common + sum(part.own for part in parts)
    places = [np.r_[0:common, common + k * part.own : common + (k + 1) * part.own] for k, part in enumerate(parts)]
    precision, right = np.eye(size), np.zeros(size)
    for part, place in zip(parts, places, strict=True):
        precision[np.ix_(place, place)] += sum(part.grams)
        right[place] += sum(part.moments)
    every = np.arange(size)
    loaded = _solved(precision, right, parts, places, every)
    payloads = [_payload(p.columns, *loaded, place) for p, place in zip(parts, places, strict=True)]
    empty = [
        place[p.columns.payload]
        for p, place, found in zip(parts, places, payloads, strict=True)
        if found.probability < AGAINST * PRIOR
    ]
    kept = np.setdiff1d(every, np.concatenate(empty)) if empty else every
    solved = _solved(precision, right, parts, places, kept)
    pulled = _pulled(solved[0], parts, places)
    turning = [j for j, joint in enumerate(robot.joints) if not (j in free or joint.name in robot.urdf.prismatic)]
    weights = {
        j: max(
            _weight(part, place, kept, (precision, right), j)
            for part, place in zip(parts, places, strict=True)
            if part.motion.moves[j]
        )
        for j in turning
        if any(part.motion.moves[j] for part in parts)
    }
    fits = tuple(
        _shared(
            part,
            place,
            found if found.probability < AGAINST * PRIOR else _payload(part.columns, *solved, place),
            solved,
            kept,
            (precision, right, pulled),
        )
        for part, place, found in zip(parts, places, payloads, strict=True)
    )
    return fits, weights


def _solved(
    precision: Array, right: Array, parts: Sequence[_Log], places: Sequence[NDArray[np.int64]], kept: NDArray[np.int64]
) -> tuple[Array, Array, Array]:
    """Mean, covariance, and covariance by blocks of rows, of all numbers, those that are not `kept` at 0."""
    mean, covariance = np.zeros(right.size), np.zeros_like(precision)
    inside = np.ix_(kept, kept)
    covariance[inside] = np.linalg.inv(precision[inside])
    mean[kept] = covariance[inside] @ right[kept]
    return mean, covariance, covariance @ _pulled(mean, parts, places) @ covariance


def _pulled(mean: Array, parts: Sequence[_Log], places: Sequence[NDArray[np.int64]]) -> Array:
    """Sum of squares of what blocks of rows of all logs, and what is known beforehand, pull each number by."""
    out = np.eye(mean.size)
    for part, place in zip(parts, places, strict=True):
        out[np.ix_(place, place)] += sum(part.scores(mean[place]))
    return out


def _wider(precision: Array, pulled: Array) -> Array:
    """Covariance of a posterior, in every direction in which Huber's sandwich is wider that of the sandwich: what is
    left of a joint that does not follow its model is no noise that its rows average out."""
    share, ways = eigh(pulled, precision)
    return np.asarray((ways * np.maximum(share, 1.0)) @ ways.T)


@dataclass(frozen=True)
class _Log:
    """One log's share of the normal equations. The first `common` columns are the same quantities in every log."""

    motion: Motion
    rate_hz: float  # of the rows
    rigid: Array
    columns: _Columns
    grams: list[Array]
    moments: list[Array]
    rows: list[tuple[Array, Array]]
    weights: list[Array]  # of a weight at each joint alone, whitened as its rows, shape (rows, 2)

    @staticmethod
    def of(robot: Robot, body: RigidBody, motion: Motion, free: frozenset[int] = frozenset()) -> _Log:
        regressor = body.regressor(motion.position, motion.speed, motion.acceleration)
        rigid = np.asarray(np.einsum("njbp,bp->nj", regressor, body.parameters))
        columns = _columns(robot, body, motion, regressor)
        joints = range(rigid.shape[1])
        band = Band.of(body, motion)
        rested = np.apply_along_axis(_felt_at_rest, 0, motion.speed, motion.rate_hz)
        used = np.stack([band.counting(motion.counts, rested[:, j]) for j in joints], axis=1)
        torque = band.smooth(motion.torque - rigid)
        mean: Array = np.zeros(columns.values.shape[-1])
        weights = [band.smooth(np.stack([np.sin(q), np.cos(q)], axis=1)) for q in motion.position.T]
        for _ in range(ROUNDS):
            carried = rigid + columns.values @ mean
            columns = columns.around(body, mean)
            own = [band.smooth(_friction(motion, j, carried[:, j])) for j in joints]
            own = [np.hstack([own[j], weights[j]]) if j in free else own[j] for j in joints]
            values = band.smooth(columns.values)
            rows, white = _whitened(values, torque, own, weights, used, band.rate_hz, mean)
            grams, moments = [c.T @ c for c, _ in rows], [c.T @ y for c, y in rows]
            mean = np.asarray(np.linalg.solve(np.eye(mean.size) + sum(grams), sum(moments)), dtype=np.float64)
        return _Log(motion, band.rate_hz, rigid, columns, grams, moments, rows, white)

    @property
    def common(self) -> int:
        return int(self.columns.late.start)

    @property
    def own(self) -> int:
        return int(self.columns.values.shape[-1]) - self.common

    def scores(self, mean: Array) -> list[Array]:
        """Sum of squares of what blocks of rows of each joint pull each number by (Huber's sandwich holds for noise of
        any kind)."""
        block = max(1, int(BLOCK_S * self.rate_hz))
        out = []
        for columns, torque in self.rows:
            left = torque - columns @ mean
            stacked = _by_blocks(columns * left[:, None], block)
            out.append(stacked.T @ stacked)
        return out


def _shared(
    log: _Log,
    place: NDArray[np.int64],
    payload: PayloadEstimate,
    solved: tuple[Array, Array, Array],
    kept: NDArray[np.int64],
    normal: tuple[Array, Array, Array],
) -> SharedFit:
    """What all logs and the other joints say of each joint of `log`."""
    columns, motion, rigid = log.columns, log.motion, log.rigid
    used = np.flatnonzero(np.isin(place, kept))
    inside = np.searchsorted(kept, place[used])
    known, errors, scores = rigid.copy(), [], log.scores(solved[0][place])
    for joint in range(rigid.shape[1]):
        precision, right = normal[0].copy(), normal[1].copy()
        precision[np.ix_(place, place)] -= log.grams[joint]
        right[place] -= log.moments[joint]
        pulled = normal[2].copy()
        pulled[np.ix_(place, place)] -= scores[joint]
        told = np.ix_(kept, kept)
        own = columns.values[:, joint, used]
        known[:, joint] += own @ np.linalg.solve(precision[told], right[kept])[inside]
        factor = np.linalg.cholesky(_wider(precision[told], pulled[told])[np.ix_(inside, inside)])
        speed = motion.speed[:, joint]
        losses = LOAD_LOSS * np.tanh(speed / max(TURNS[1] * float(np.abs(speed).max()), 1e-12))
        load = np.abs(rigid[:, joint])
        errors.append(np.column_stack([_few(own @ factor), losses * (load - load[motion.counts].mean())]))
    mean, _, robust = solved
    deviation = np.sqrt(np.diag(robust))[place][columns.tilt] * TILT_RAD
    return SharedFit(
        motion, rigid, known, tuple(errors), payload, mean[place][columns.tilt] * TILT_RAD, deviation,
        float(mean[place][columns.late][0]) * LATE_S, _late(log, place, kept, (normal[0], normal[1])),
    )  # fmt: skip


def _late(
    log: _Log, place: NDArray[np.int64], kept: NDArray[np.int64], normal: tuple[Array, Array]
) -> tuple[Late, ...]:
    """Of each joint whether its torque is late by itself, beside all that joints share.

    By what the rigid body asks for alone: friction that is late looks as if it built up over a longer way. As little
    torque as no drive measures may go along with it.
    """
    out = []
    late = log.columns.late.start
    for joint, (columns, _) in enumerate(log.rows):
        size, covariance = _beside(log, place, kept, normal, joint, columns[:, [late]], LATE_S / LATEST_S)
        form = LEAST_NOISE * float(np.std(log.motion.torque[:, joint]))
        rises = float(np.std(log.columns.values[:, joint, late])) / LATE_S
        deviation = math.hypot(math.sqrt(float(covariance[0, 0])) * LATE_S, form / max(rises, 1e-300))
        delay = float(size[0]) * LATE_S
        there = _there(np.array([delay]), np.array([[deviation**2]]), LATEST_S)
        out.append(Late(delay, deviation, there))
    return tuple(out)


def _weight(
    log: _Log, place: NDArray[np.int64], kept: NDArray[np.int64], normal: tuple[Array, Array], joint: int
) -> float:
    """How likely a joint has a weight of its own, which follows its own angle and is felt by no other."""
    large = float(np.std(log.motion.torque[:, joint]))
    if not large:
        return 0.0
    return _there(*_beside(log, place, kept, normal, joint, log.weights[joint], 1.0 / large), large)


def _there(size: Array, covariance: Array, large: float) -> float:
    """How likely something of one joint alone is not 0, by the ratio of the densities there (Dickey 1971); `large`: the
    deviation of what it may be."""
    log_ratio = 0.5 * float(np.linalg.slogdet(covariance)[1]) - size.size * math.log(large)
    return _odds(log_ratio + 0.5 * float(size @ np.linalg.solve(covariance, size)))


def _odds(log_ratio: float) -> float:
    """How likely something of one joint alone is by the log ratio of the likelihoods with it and without."""
    return 1.0 / (1.0 + math.exp(-min(max(math.log(OWN / (1.0 - OWN)) + log_ratio, -50.0), 50.0)))


def _by_blocks(rows: Array, block: int) -> Array:
    """Sums over blocks of so many rows, shape (blocks, p)."""
    starts = np.arange(0, len(rows), block)
    return np.asarray(np.add.reduceat(rows, starts)) if starts.size else rows


def _beside(
    log: _Log,
    place: NDArray[np.int64],
    kept: NDArray[np.int64],
    normal: tuple[Array, Array],
    joint: int,
    own: Array,
    known: float,
) -> tuple[Array, Array]:
    """Sizes of columns that one joint alone has, shape (rows, p), beside all that joints share, and their covariance.

    `known`: one over the deviation of what they may be.
    """
    precision, right = normal[0][np.ix_(kept, kept)], normal[1][kept]
    used = np.flatnonzero(np.isin(place, kept))
    inside = np.searchsorted(kept, place[used])
    alone = np.linalg.solve(precision, right)
    columns, torque = log.rows[joint]
    met = np.zeros((kept.size, own.shape[1]))
    met[inside] = columns[:, used].T @ own
    along = np.linalg.solve(precision, met)
    prior = known**2 * np.eye(own.shape[1])
    information = own.T @ own + prior - met.T @ along
    size = np.linalg.solve(information, own.T @ torque - met.T @ alone)
    mean = alone - along @ size
    pulled = prior + along.T @ along
    block = max(1, int(BLOCK_S * log.rate_hz))
    for other, (its, felt) in enumerate(log.rows):
        mine = own if other == joint else np.zeros((felt.size, own.shape[1]))
        left = felt - its[:, used] @ mean[inside] - mine @ size
        pulls = (mine - its[:, used] @ along[inside]) * left[:, None]
        sums = _by_blocks(pulls, block)
        pulled += sums.T @ sums
    return np.asarray(size, dtype=np.float64), _wider(information, pulled)


def _columns(robot: Robot, body: RigidBody, motion: Motion, regressor: Array) -> _Columns:
    """Ways in which links may be wrong and what may hang; gains, tilt and delay are filled in by `around`."""
    rows, joints, links, _ = regressor.shape
    masses = np.maximum(body.parameters[:, 0], 0.0)
    mean_mass = float(masses.mean())
    reach = math.sqrt(float(np.mean([_reach(p) ** 2 for p in body.parameters if p[0] > 0.0])))
    ways = np.array([_link_errors(p, mean_mass, reach) for p in body.parameters])
    scale = mean_mass * np.r_[1.0, np.full(3, reach), np.full(6, reach**2)]
    wrong = [regressor[:, :, k] @ ways[k] for k in range(links)]
    later = np.zeros((rows, joints, joints + 3))
    values = np.concatenate([*wrong, later, regressor[:, :, body.tool] * scale], axis=-1)
    ends = [int(end) for end in np.cumsum([links * 10, joints, 2, 1, 10])]
    gains, tilted, delayed, hung = (slice(*pair) for pair in pairwise(ends))
    level = np.stack([body.at_rest(motion.position, change) for change in _level(robot)])
    return _Columns(values, gains, tilted, delayed, hung, scale, ways, regressor, level, motion.rate_hz)


def _reach(parameters: Array) -> float:
    """Root mean square distance of a link's mass from its frame [m]."""
    return math.sqrt(max(float(parameters[4:7].sum()) / 2.0 / max(float(parameters[0]), 1e-9), 0.0))


def _link_errors(parameters: Array, mean_mass: float, mean_reach: float) -> Array:
    """Directions in which a link's parameters may be wrong, each by a standard deviation, shape (10, 10)."""
    mass = float(parameters[0])
    much = LINK_ERROR * math.hypot(mass, mean_mass)
    far = _reach(parameters) if mass > 0.0 else mean_reach
    out = np.diag(much * np.r_[1.0, np.full(3, far), np.full(6, far**2)])
    if mass > 0.0:
        out[:, 0] = much * parameters / mass
    return out


def _level(robot: Robot) -> list[Array]:
    """Two changes of gravity by a tilt of a radian, about axes across it [m/s2]."""
    g = np.array(robot.gravity_m_s2)
    size = float(np.linalg.norm(g))
    if size == 0.0:
        return [np.zeros(3), np.zeros(3)]
    across = np.linalg.svd(g[None] / size)[2][1:]
    return [size * axis for axis in across]


def friction_curves(position: Array, speed: Array, acceleration: Array, load: Array) -> Array:
    """Return friction as any curve over the speed, with what the load adds to it, and the rotor; shape (rows, p)."""
    return np.column_stack([_laws(position, speed, load), _even(speed, acceleration)])


def _friction(motion: Motion, joint: int, load: Array) -> Array:
    """The same of a joint, smoothed as its torque was."""
    position, speed, acceleration = (each[:, joint] for each in (motion.position, motion.speed, motion.acceleration))
    if math.isinf(motion.cut_hz):
        return friction_curves(position, speed, acceleration, load)
    clock = motion.time_s
    fine = np.linspace(clock[0], clock[-1], (clock.size - 1) * FINE + 1)
    way = CubicSpline(clock, position)
    laws = _laws(way(fine), way(fine, 1), np.interp(fine, clock, load))
    rate = motion.rate_hz * FINE
    smooth = [smoothed(law, motion.cut_hz, rate, 0)[::FINE] for law in laws.T]
    return np.column_stack([*smooth, _even(speed, acceleration)])


def _felt_at_rest(speed: Array, rate_hz: float) -> NDArray[np.bool_]:
    """Rows in which friction is whatever holds, and those after a long rest in which noise remembers that."""
    resting = np.abs(speed) < RESTING * float(np.abs(speed).max())
    long = np.ones(1 + int(SHORT.filter_s * rate_hz), dtype=np.bool_)
    rested = binary_opening(resting, long)
    return np.asarray(resting | (np.convolve(rested, long)[: speed.size] > 0.5))


def _laws(position: Array, speed: Array, load: Array) -> Array:
    """What turns its sign within a few rows, shape (rows, p)."""
    u = speed / max(float(np.abs(speed).max()), 1e-12)
    turns = [np.tanh(u / width) for width in TURNS]
    return np.column_stack(
        [*turns, *(built_up(position, way) for way in WAYS), u * np.abs(u), np.abs(u), turns[1] * np.abs(load)]
    )


def _even(speed: Array, acceleration: Array) -> Array:
    """What does not, shape (rows, p)."""
    return np.column_stack([speed / max(float(np.abs(speed).max()), 1e-12), np.ones_like(speed), acceleration])


def built_up(position: Array, way: float) -> Array:
    """Dry friction over its full value, between -1 and 1: after each reversal it builds up over a way, in the unit of
    `position`, as contacts give way before they slide (Dahl 1968); shape (rows,).

    >>> built_up(np.array([0.0, 1.0, 2.0, 1.9, 0.0]), 0.1).round(2)
    array([ 0.  ,  1.  ,  1.  , -0.26, -1.  ])
    """
    step = np.diff(position, prepend=position[0])
    sides = np.sign(step)
    gone = np.cumsum(np.abs(step)) / way
    out = np.empty_like(position)
    ends = np.flatnonzero(np.diff(sides)) + 1
    held, since = 0.0, 0.0
    for first, last in pairwise([0, *ends.tolist(), position.size]):
        side = float(sides[first])
        out[first:last] = side + (held - side) * np.exp(since - gone[first:last]) if side else held
        held, since = float(out[last - 1]), float(gone[last - 1])
    return out


def _whitened(
    columns: Array,
    torque: Array,
    frictions: Sequence[Array],
    weights: Sequence[Array],
    counting: NDArray[np.bool_],
    rate_hz: float,
    mean: Array,
) -> tuple[list[tuple[Array, Array]], list[Array]]:
    """Rows of each joint once its friction is projected out, white by the noise that `mean` leaves, and `weights`."""
    rows, white = [], []
    count = columns.shape[-1]
    for j in range(torque.shape[1]):
        beyond = torque[:, j] - columns[:, j] @ mean
        used = counting[:, j]
        shape = np.linalg.lstsq(frictions[j][used], beyond[used], rcond=None)[0]
        left = (beyond - frictions[j] @ shape) * used
        least = LEAST_NOISE * float(np.std(torque[:, j]))
        taps, level = whitener(left, used.astype(float), rate_hz, SHORT, teeth=False, least=least)
        every = np.hstack([columns[:, j], weights[j]])
        its, felt = _projected(Noise(taps, np.ones(1), level), every, torque[:, j], frictions[j], used)
        rows.append((its[:, :count], felt))
        white.append(its[:, count:])
    return rows, white


def _projected(
    noise: Noise, columns: Array, torque: Array, friction: Array, used: NDArray[np.bool_]
) -> tuple[Array, Array]:
    white = [noise.whiten(np.ascontiguousarray(c), np.zeros(0)) for c in (*columns.T, torque, *friction.T)]
    table = np.stack(white, axis=1)[used]
    n = columns.shape[1]
    q = np.linalg.qr(table[:, n + 1 :])[0]
    rest: Array = np.asarray(table[:, : n + 1] - q @ (q.T @ table[:, : n + 1]), dtype=np.float64)
    return rest[:, :n], rest[:, n]


def _payload(
    columns: _Columns, mean: Array, covariance: Array, robust: Array, place: NDArray[np.int64]
) -> PayloadEstimate:
    """A payload against none, by the ratio of the densities of its mass and first moments at 0 (Dickey 1971).

    Its place may tell of it more than its weight does, which errors of all links share. None weighs less than nothing.
    """
    own = place[columns.payload][:4]
    scale = columns.scale[:4]
    pair = np.ix_(own, own)
    spread = robust[pair] if robust[own[0], own[0]] > covariance[own[0], own[0]] else covariance[pair]
    spread = 0.5 * (spread + spread.T) + np.outer(mean[own], mean[own]) * GAIN_ERROR**2  # drives tell of torque by it
    far = float(mean[own] @ np.linalg.solve(spread, mean[own]))
    weighs = log_ndtr(float(mean[own[0]]) / math.sqrt(float(spread[0, 0]))) + math.log(2.0)
    log_odds = math.log(PRIOR / (1.0 - PRIOR)) + 0.5 * (np.linalg.slogdet(spread)[1] + far) + float(weighs)
    likely = 1.0 / (1.0 + math.exp(-min(max(float(log_odds), -50.0), 50.0)))
    return PayloadEstimate(mean[own] * scale, spread * np.outer(scale, scale), likely)


def _few(errors: Array, least: float = 1e-3) -> Array:
    """The same covariance of rows by as few directions as hold all but a thousandth of it, shape (rows, p)."""
    power, ways = np.linalg.eigh(errors.T @ errors)
    return np.asarray(errors @ ways[:, power > least * float(power.sum())])
