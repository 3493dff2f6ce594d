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
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_opening
from scipy.special import log_ndtr

from sim.investigation.assessment.intervals import NINETY
from sim.investigation.estimation.whitening import SHORT
from sim.robot.motion import Motion, smoothed
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Robot

Array = NDArray[np.float64]

GAIN_ERROR = 0.05  # of the N m per ampere of a drive: what data sheets allow; of a link's mass: as editions differ
TILT_RAD = 0.02  # of the base: what feet are levelled to without an instrument
LATE_S = 0.005  # torque against position: half a period of a log of 100 Hz
LATEST_S = 0.05  # of one joint alone: a current that its drive smooths at 3 Hz
BUFFERED = 2.0  # rows by which a channel of a log is late at most
OWN = 0.025  # that one joint alone is late: one name in forty
LOAD_LOSS = 0.1  # of what a joint carries, lost in its gears: a harmonic drive or a cycloid passes on 70 to 95 %
ROUNDS = 4  # of noise taken anew
LASTING_S = 2.0  # what is left of torques lasts no longer
BLOCKS = 10  # of a log, each of which is left out in turn
TURNS = (0.01, 0.03, 0.1)  # of the largest speed, over which friction may turn its sign
WAYS = (2e-4, 1e-3, 5e-3)  # rad or m of a joint, over which friction may build up after a reversal
FINE = 8  # rows of a law of friction per row: it turns within one, and is smoothed as the torque was
RESTING = 0.005  # of the largest speed, below which friction is whatever holds
NOTHING = 1e12  # precision of what is known to be 0
AGAINST = 0.5  # of the prior: a log of which data say no more than this says what the links are without a payload
PRIOR = 0.1  # that something hangs at the flange that nobody described
TILT, LATE, HANGS = slice(-13, -11), slice(-11, -10), slice(-10, None)  # of the shared numbers, behind links and gains
OF_A_LOG = 11  # the last, which are of each log alone: delay and payload
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
        return Late(delay_s, deviation_s, _odds(OWN, math.log(deviation_s / LATEST_S) + nats))


@dataclass(frozen=True)
class SharedFit:
    """What all joints say together, of one log.

    `known`: torque that the rigid body asks for of each joint, corrected by the others, shape (rows, joints) [N m];
    `rigid`: the same as described; `errors`: of each joint, directions in which `known` may be wrong, shape (rows, p).
    `late`: delay of each joint's torque beyond that of all torques against the positions.
    """

    motion: Motion
    rigid: Array
    known: Array
    errors: tuple[Array, ...]
    payload: PayloadEstimate
    tilt_rad: Array
    tilt_deviation_rad: Array
    late: tuple[Late, ...] = ()


@dataclass(frozen=True)
class _Columns:
    """All that is linear in the torque of all joints, per standard deviation of its prior: `values`, shape (rows,
    joints, n), of errors of links, gains, tilt, delay and payload.

    `scale`: of the payload's ten numbers; `links`: ways in which links may be wrong, shape (links, 10, 10); `level`:
    the regressor of two changes of gravity, at rest, shape (2, rows, joints, links, 10).
    """

    values: Array
    scale: Array
    links: Array
    regressor: Array
    level: Array
    rate_hz: float

    @staticmethod
    def of(robot: Robot, body: RigidBody, motion: Motion) -> _Columns:
        """Those of links and payload; gains, tilt and delay are filled in by `around`."""
        regressor = body.regressor(motion.position, motion.speed, motion.acceleration)
        rows, joints, links, _ = regressor.shape
        masses = np.maximum(body.parameters[:, 0], 0.0)
        mean_mass = float(masses.mean())
        reach = math.sqrt(float(np.mean([_reach(p) ** 2 for p in body.parameters if p[0] > 0.0])))
        ways = np.array([_link_errors(p, mean_mass, reach) for p in body.parameters])
        scale = mean_mass * np.r_[1.0, np.full(3, reach), np.full(6, reach**2)]
        wrong = [regressor[:, :, k] @ ways[k] for k in range(links)]
        later = np.zeros((rows, joints, joints + 3))
        values = np.concatenate([*wrong, later, regressor[:, :, body.tool] * scale], axis=-1)
        level = np.stack([body.at_rest(motion.position, change) for change in _level(robot)])
        return _Columns(values, scale, ways, regressor, level, motion.rate_hz)

    def around(self, body: RigidBody, mean: Array) -> _Columns:
        """The same with gains, tilt and delay of the links and the payload that `mean` makes of the body's."""
        links = len(body.links)
        found = body.parameters + np.einsum("bpq,bq->bp", self.links, mean[: links * 10].reshape(links, 10))
        found[body.tool] += self.scale * mean[HANGS]
        rigid = np.einsum("njbp,bp->nj", self.regressor, found)
        joints = np.arange(rigid.shape[1])
        values = self.values.copy()
        values[:, joints, links * 10 + joints] = GAIN_ERROR * rigid
        values[..., TILT] = TILT_RAD * np.einsum("tnjbp,bp->njt", self.level, found)
        values[..., LATE] = -LATE_S * np.gradient(rigid, axis=0)[..., None] * self.rate_hz
        return replace(self, values=values)


def shared_columns(robot: Robot, body: RigidBody, motion: Motion) -> Array:
    """Torque of all joints per standard deviation of all that they share, the payload's ten numbers last; shape (rows,
    joints, n)."""
    columns = _Columns.of(robot, body, motion)
    return columns.around(body, np.zeros(columns.values.shape[-1])).values


def shared_fits(robot: Robot, body: RigidBody, motions: Sequence[Motion]) -> tuple[SharedFit, ...]:
    """Fit what the joints share over all logs: links, drives and base are the same in them, payloads may not be."""
    every = _Normal.of([_Log.of(robot, body, motion) for motion in motions])
    hung = [every.payload(k) for k in range(len(motions))]
    empty = [k for k, one in enumerate(hung) if one.probability < AGAINST * PRIOR]
    normal = every.without_payload(empty)
    return tuple(_shared(normal, k, one if k in empty else normal.payload(k)) for k, one in enumerate(hung))


@dataclass(frozen=True)
class _Log:
    """One log's share of the normal equations. All columns but the last `OF_A_LOG` are the same in every log."""

    motion: Motion
    rigid: Array
    columns: _Columns
    rows: list[tuple[Array, Array]]  # of each joint: columns and torque beyond any friction, of unit noise
    grams: list[Array]
    moments: list[Array]

    @staticmethod
    def of(robot: Robot, body: RigidBody, motion: Motion) -> _Log:
        columns = _Columns.of(robot, body, motion)
        rigid = np.asarray(np.einsum("njbp,bp->nj", columns.regressor, body.parameters))
        rested = np.apply_along_axis(_felt_at_rest, 0, motion.speed, motion.rate_hz)
        used = [motion.counts & ~rests & (j not in motion.unmeasured) for j, rests in enumerate(rested.T)]
        left = motion.torque - rigid
        mean: Array = np.zeros(columns.values.shape[-1])
        for _ in range(ROUNDS):
            carried = rigid + columns.values @ mean
            columns = columns.around(body, mean)
            rows = [
                _beyond(
                    _friction(motion, j, carried[:, j])[at], columns.values[at, j], left[at, j], mean, motion.rate_hz
                )
                for j, at in enumerate(used)
            ]
            grams, moments = [c.T @ c for c, _ in rows], [c.T @ y for c, y in rows]
            mean = np.asarray(np.linalg.solve(np.eye(mean.size) + sum(grams), sum(moments)), dtype=np.float64)
        return _Log(motion, rigid, columns, rows, grams, moments)

    def blocks(self) -> list[tuple[Array, Array]]:
        """What each block of time adds to the normal equations: their matrix and right side."""
        split = [(np.array_split(c, BLOCKS), np.array_split(y, BLOCKS)) for c, y in self.rows]
        parts = [[(c[block], y[block]) for c, y in split] for block in range(BLOCKS)]
        return [
            (np.sum([c.T @ c for c, _ in part], axis=0), np.sum([c.T @ y for c, y in part], axis=0)) for part in parts
        ]


def _beyond(friction: Array, columns: Array, torque: Array, mean: Array, rate_hz: float) -> tuple[Array, Array]:
    """Columns and torque of a joint once its friction is projected out, over the deviation of what `mean` leaves.

    What is left is error of the model as much as noise, and lasts as long as motions do: a row counts by the long-run
    variance (Newey and West 1987). Noise made white would believe the few rows in which a model errs fast.
    """
    if not torque.size:
        return columns, torque
    q = np.linalg.qr(friction)[0]
    table = np.column_stack([columns, torque])
    table = table - q @ (q.T @ table)
    left = table[:, -1] - table[:, :-1] @ mean
    lasting = max(1, int(LASTING_S * rate_hz))
    long_run = float(np.sum(np.convolve(left, np.ones(lasting)) ** 2)) / lasting
    least = LEAST_NOISE * float(np.std(torque))
    variance = max(long_run, float(left @ left), torque.size * least**2, 1e-300) / torque.size
    table /= math.sqrt(variance)
    return table[:, :-1], table[:, -1]


@dataclass(frozen=True)
class _Normal:
    """Normal equations of all logs; `places`: of each log's columns."""

    logs: Sequence[_Log]
    places: Sequence[NDArray[np.int64]]
    precision: Array
    right: Array

    @staticmethod
    def of(logs: Sequence[_Log]) -> _Normal:
        common = logs[0].columns.values.shape[-1] - OF_A_LOG
        size = common + OF_A_LOG * len(logs)
        places = [np.r_[0:common, common + OF_A_LOG * k : common + OF_A_LOG * (k + 1)] for k in range(len(logs))]
        precision, right = np.eye(size), np.zeros(size)
        for log, place in zip(logs, places, strict=True):
            precision[np.ix_(place, place)] += sum(log.grams)
            right[place] += sum(log.moments)
        return _Normal(logs, places, precision, right)

    def without_payload(self, empty: Sequence[int]) -> _Normal:
        """The same where nothing hangs in these logs."""
        precision = self.precision.copy()
        for k in empty:
            hung = self.places[k][HANGS]
            precision[hung, hung] += NOTHING
        return replace(self, precision=precision)

    def without(self, *groups: tuple[int, Array, Array]) -> _Normal:
        """The same without groups of rows: of which log each is, its part of the matrix and of the right side."""
        precision, right = self.precision.copy(), self.right.copy()
        for k, gram, moment in groups:
            precision[np.ix_(self.places[k], self.places[k])] -= gram
            right[self.places[k]] -= moment
        return replace(self, precision=precision, right=right)

    def without_joint(self, joint: int) -> _Normal:
        """The same without the torques of a joint."""
        return self.without(*[(k, log.grams[joint], log.moments[joint]) for k, log in enumerate(self.logs)])

    @cached_property
    def mean(self) -> Array:
        return np.asarray(np.linalg.solve(self.precision, self.right))

    @cached_property
    def covariance(self) -> Array:
        """If what is left were noise."""
        return np.asarray(np.linalg.inv(self.precision))

    @cached_property
    def scatter(self) -> Array:
        """By how much the numbers change without each joint, then without each block of time, shape (groups, n): rows
        whose squares add up to what no noise explains (jackknife: Tukey 1958)."""
        joints = [self.without_joint(j).mean for j in range(len(self.logs[0].grams))]
        blocks = [self.without((k, *block)).mean for k, log in enumerate(self.logs) for block in log.blocks()]
        return np.concatenate(
            [(m - m.mean(axis=0)) * math.sqrt(1.0 - 1.0 / len(m)) for m in (np.stack(joints), np.stack(blocks))]
        )

    def payload(self, k: int) -> PayloadEstimate:
        """What hangs in a log."""
        place = self.places[k]
        return _payload(self.logs[k].columns, self.mean[place], self.spread[np.ix_(place, place)])

    @property
    def spread(self) -> Array:
        """Covariance, with what no noise explains."""
        return self.covariance + self.scatter.T @ self.scatter


def _shared(normal: _Normal, k: int, payload: PayloadEstimate) -> SharedFit:
    """What all logs and the other joints say of each joint of the `k`th log."""
    log, place = normal.logs[k], normal.places[k]
    columns, motion, rigid = log.columns, log.motion, log.rigid
    known, errors = rigid.copy(), []
    for joint in range(rigid.shape[1]):
        others = normal.without_joint(joint)
        own = columns.values[:, joint]
        known[:, joint] += own @ others.mean[place]
        ways = np.hstack([np.linalg.cholesky(others.covariance), np.delete(normal.scatter, joint, axis=0).T])
        speed = motion.speed[:, joint]
        losses = LOAD_LOSS * np.tanh(speed / max(TURNS[1] * float(np.abs(speed).max()), 1e-12))
        load = np.abs(rigid[:, joint])
        errors.append(np.column_stack([_few(own @ ways[place]), losses * (load - load[motion.counts].mean())]))
    mean, spread = normal.mean[place], normal.spread[np.ix_(place, place)]
    deviation = np.sqrt(np.diag(spread))[TILT] * TILT_RAD
    return SharedFit(
        motion, rigid, known, tuple(errors), payload, mean[TILT] * TILT_RAD, deviation,
        tuple(_late(normal, k, joint) for joint in range(rigid.shape[1])),
    )  # fmt: skip


def _late(normal: _Normal, k: int, joint: int) -> Late:
    """Whether the torque of a joint is late by itself, beside all that joints share.

    By what the rigid body asks for alone: friction that is late looks as if it built up over a longer way. As little
    torque as no drive measures may go along with it.
    """
    log, place = normal.logs[k], normal.places[k]
    columns, torque = log.rows[joint]
    own = columns[:, LATE.start]
    along = normal.covariance[:, place] @ (columns.T @ own)
    information = float(own @ own) + (LATE_S / LATEST_S) ** 2 - float(own @ columns @ along[place])
    size = float(own @ (torque - columns @ normal.mean[place])) / information
    form = LEAST_NOISE * float(np.std(log.motion.torque[:, joint]))
    rises = float(np.std(log.columns.values[:, joint, LATE.start])) / LATE_S
    deviation = math.hypot(LATE_S / math.sqrt(information), form / max(rises, 1e-300))
    return Late(size * LATE_S, deviation, 0.0).found_at(size * LATE_S, deviation)


def _odds(prior: float, log_ratio: float) -> float:
    """How likely something is by the log ratio of the likelihoods with it and without."""
    return 1.0 / (1.0 + math.exp(-min(max(math.log(prior / (1.0 - prior)) + log_ratio, -50.0), 50.0)))


def _reach(parameters: Array) -> float:
    """Root mean square distance of a link's mass from its frame [m]."""
    return math.sqrt(max(float(parameters[4:7].sum()) / 2.0 / max(float(parameters[0]), 1e-9), 0.0))


def _link_errors(parameters: Array, mean_mass: float, mean_reach: float) -> Array:
    """Directions in which a link's parameters may be wrong, each by a standard deviation, shape (10, 10)."""
    mass = float(parameters[0])
    much = GAIN_ERROR * math.hypot(mass, mean_mass)
    far = _reach(parameters) if mass > 0.0 else mean_reach
    out = np.diag(much * np.r_[1.0, np.full(3, far), np.full(6, far**2)])
    if mass > 0.0:
        out[:, 0] = much * parameters / mass
    return out


def _level(robot: Robot) -> Array:
    """Two changes of gravity by a tilt of a radian, about axes across it, shape (2, 3) [m/s2]."""
    g = np.array([robot.gravity_m_s2])
    return np.asarray(float(np.linalg.norm(g)) * np.linalg.svd(g)[2][1:])


def _friction(motion: Motion, joint: int, load: Array) -> Array:
    """Friction of a joint as any curve over the speed, with what the load adds to it, and the rotor, shape (rows, p);
    smoothed as its torque was."""
    position, speed, acceleration = (each[:, joint] for each in (motion.position, motion.speed, motion.acceleration))
    even = [speed / max(float(np.abs(speed).max()), 1e-12), np.ones_like(speed), acceleration]
    if math.isinf(motion.cut_hz):
        return np.column_stack([_laws(position, speed, load), *even])
    clock = motion.time_s
    fine = np.linspace(clock[0], clock[-1], (clock.size - 1) * FINE + 1)
    way = CubicSpline(clock, position)
    laws = _laws(way(fine), way(fine, 1), np.interp(fine, clock, load))
    smooth = [smoothed(law, motion.cut_hz, motion.rate_hz * FINE, 0)[::FINE] for law in laws.T]
    return np.column_stack([*smooth, *even])


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


def _payload(columns: _Columns, mean: Array, covariance: Array) -> PayloadEstimate:
    """A payload against none, by the ratio of the densities of its mass and first moments at 0 (Dickey 1971).

    Its place may tell of it more than its weight does, which errors of all links share. None weighs less than nothing.
    What all drives tell too little or too much of torque, and what gears lose, it weighs too little or too much.
    """
    own = np.arange(mean.size)[HANGS][:4]
    scale = columns.scale[:4]
    spread = covariance[np.ix_(own, own)] + np.outer(mean[own], mean[own]) * (GAIN_ERROR**2 + LOAD_LOSS**2)
    spread = 0.5 * (spread + spread.T)
    far = float(mean[own] @ np.linalg.solve(spread, mean[own]))
    weighs = log_ndtr(float(mean[own[0]]) / math.sqrt(float(spread[0, 0]))) + math.log(2.0)
    log_ratio = 0.5 * (np.linalg.slogdet(spread)[1] + far) + float(weighs)
    return PayloadEstimate(mean[own] * scale, spread * np.outer(scale, scale), _odds(PRIOR, float(log_ratio)))


def _few(errors: Array, least: float = 1e-3) -> Array:
    """The same covariance of rows by as few directions as hold all but a thousandth of it, shape (rows, p)."""
    power, ways = np.linalg.eigh(errors.T @ errors)
    return np.asarray(errors @ ways[:, power > least * float(power.sum())])
