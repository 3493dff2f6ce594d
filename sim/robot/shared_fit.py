"""What the joints of a robot share, fitted over all of them together: payload, errors of masses, tilt of the base.

Torques are linear in all of it, so the posterior is a Gaussian. Friction of each joint is any curve over its speed here,
and what its load adds to it: its form is asked for joint by joint, later. For that, each joint is given the rigid torque
as the *other* joints correct it, and what is left uncertain of it as directions in which the model may be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.discrepancy.estimation.whitening import SHORT, Noise, whitener
from sim.robot.motion import Motion
from sim.robot.rigid_body import PARAMETERS, RigidBody
from sim.robot.robot import Robot

Array = NDArray[np.float64]

LINK_ERROR = 0.05  # of a link's mass and of the mean link's: two editions of a maker's data differ by 5.4 % of the mean
GAIN_ERROR = 0.05  # of the N m per ampere of a drive: what data sheets of motors allow, gears included
TILT_RAD = 0.02  # of the base: what feet are levelled to without an instrument
LATE_S = 0.005  # torque against position: half a period of a log of 100 Hz
LOAD_LOSS = 0.1  # of what a joint carries, lost in its gears: a harmonic drive or a cycloid passes on 70 to 95 %
ROUNDS = 4  # of noise taken anew
BLOCK_S = 2.0  # rows apart by more are independent; for intervals that hold where noise is not white
TURNS = (0.01, 0.03, 0.1)  # of the largest speed, over which friction may turn its sign
RESTING = 0.005  # of the largest speed, below which friction is whatever holds
PRIOR = 0.1  # that something hangs at the flange that nobody described
NINETY = 1.645  # standard deviations to either side of which 90 % lie
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
class SharedFit:
    """What all joints say together, of one log.

    `known`: torque that the rigid body asks for of each joint, corrected by the others, shape (rows, joints) [N m];
    `rigid`: the same as described; `errors`: of each joint, directions in which `known` may be wrong, shape (rows, p).
    """

    motion: Motion
    rigid: Array
    known: Array
    errors: tuple[Array, ...]
    payload: PayloadEstimate
    tilt_rad: Array
    tilt_deviation_rad: Array
    late_s: float


@dataclass(frozen=True)
class _Columns:
    """All that is linear in the torque of all joints, per standard deviation of its prior, shape (rows, joints, n)."""

    values: Array
    tilt: slice
    late: slice
    payload: slice
    scale: Array  # of the payload's ten numbers


def shared_fit(robot: Robot, body: RigidBody, motion: Motion) -> SharedFit:
    """Fit what the joints share."""
    regressor = body.regressor(motion.position, motion.speed, motion.acceleration)
    rigid = np.asarray(np.einsum("njbp,bp->nj", regressor, body.parameters))
    columns = _columns(robot, body, motion, regressor, rigid)
    frictions = [_friction(motion.speed[:, j], motion.acceleration[:, j], rigid[:, j]) for j in range(rigid.shape[1])]
    resting = np.abs(motion.speed) < RESTING * np.abs(motion.speed).max(axis=0)
    left = motion.torque - rigid
    grams, moments, rows = _whitened(columns.values, left, frictions, resting, motion.rate_hz)
    mean, covariance, robust = _posterior(grams, moments, rows, slice(None), motion.rate_hz)
    payload = _payload(columns, mean, covariance, robust)
    hangs = payload.probability > 0.5
    used = slice(None) if hangs else slice(0, columns.payload.start)
    known, errors = rigid.copy(), []
    for joint in range(rigid.shape[1]):
        others = [k for k in range(rigid.shape[1]) if k != joint]
        precision = np.eye(grams[0].shape[0])[used, used] + sum(grams[k][used, used] for k in others)
        factor = np.linalg.cholesky(precision)
        guess = np.linalg.solve(precision, sum(moments[k][used] for k in others))
        own = columns.values[:, joint, used]
        known[:, joint] += own @ guess
        losses = LOAD_LOSS * np.tanh(motion.speed[:, joint] / (TURNS[1] * np.abs(motion.speed[:, joint]).max()))
        doubts = np.linalg.solve(factor, own.T).T
        errors.append(np.column_stack([_few(doubts), losses * np.abs(rigid[:, joint])]))
    tilted = np.sqrt(np.diag(robust))[columns.tilt] * TILT_RAD
    return SharedFit(
        motion, rigid, known, tuple(errors), payload, mean[columns.tilt] * TILT_RAD, tilted,
        float(mean[columns.late][0]) * LATE_S,
    )  # fmt: skip


def _columns(robot: Robot, body: RigidBody, motion: Motion, regressor: Array, rigid: Array) -> _Columns:
    rows, joints, links, _ = regressor.shape
    masses = np.maximum(body.parameters[:, 0], 0.0)
    mean_mass = float(masses.mean())
    reach = math.sqrt(float(np.mean([_reach(p) ** 2 for p in body.parameters if p[0] > 0.0])))
    wrong = [regressor[:, :, k] @ _link_errors(body.parameters[k], mean_mass, reach) for k in range(links)]
    gains = np.zeros((rows, joints, joints))
    gains[:, range(joints), range(joints)] = GAIN_ERROR * rigid
    tilt = np.stack([_tilted(body, motion, direction) for direction in _level(robot)], axis=-1)
    late = -LATE_S * np.gradient(rigid, axis=0)[..., None] * motion.rate_hz
    scale = mean_mass * np.r_[1.0, np.full(3, reach), np.full(6, reach**2)]
    parts = [*wrong, gains, tilt, late, regressor[:, :, body.tool] * scale]
    ends = np.cumsum([part.shape[-1] for part in parts])
    return _Columns(
        np.concatenate(parts, axis=-1), *(slice(int(ends[k - 1]), int(ends[k])) for k in (-3, -2, -1)), scale
    )


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


def _tilted(body: RigidBody, motion: Motion, change: Array) -> Array:
    """Torque by a change of gravity, per `TILT_RAD`, shape (rows, joints): that of the robot at rest."""
    g = body.model.opt.gravity.copy()
    rest = np.zeros_like(motion.speed)
    try:
        body.model.opt.gravity[:] = change
        return TILT_RAD * body.torque(motion.position, rest, rest)
    finally:
        body.model.opt.gravity[:] = g


def _friction(speed: Array, acceleration: Array, load: Array) -> Array:
    """Friction as any curve over the speed, with what the load adds to it, and the rotor; shape (rows, p)."""
    top = max(float(np.abs(speed).max()), 1e-12)
    u = speed / top
    turns = [np.tanh(u / width) for width in TURNS]
    columns = [*turns, u, u * np.abs(u), np.abs(u), np.ones_like(u), turns[1] * np.abs(load), acceleration]
    return np.stack(columns, axis=1)


def _whitened(
    columns: Array, torque: Array, frictions: Sequence[Array], resting: NDArray[np.bool_], rate_hz: float
) -> tuple[list[Array], list[Array], list[tuple[Array, Array]]]:
    """Gram matrices and moments of each joint once its friction is projected out, and the whitened rows."""
    joints = torque.shape[1]
    mean = np.zeros(columns.shape[-1])
    for _ in range(ROUNDS):
        rows = []
        for j in range(joints):
            beyond = torque[:, j] - columns[:, j] @ mean
            weight = (~resting[:, j]).astype(float)
            used = weight > 0.5
            shape = np.linalg.lstsq(frictions[j][used], beyond[used], rcond=None)[0]
            left = (beyond - frictions[j] @ shape) * weight
            least = LEAST_NOISE * float(np.std(torque[:, j]))
            taps, level = whitener(left, weight, rate_hz, SHORT, teeth=False, least=least)
            rows.append(_projected(Noise(taps, np.ones(1), level), columns[:, j], torque[:, j], frictions[j], used))
        grams = [c.T @ c for c, _ in rows]
        moments = [c.T @ y for c, y in rows]
        mean = np.linalg.solve(np.eye(mean.size) + sum(grams), sum(moments))
    return grams, moments, rows


def _projected(noise: Noise, columns: Array, torque: Array, friction: Array, used: Array) -> tuple[Array, Array]:
    white = [noise.whiten(np.ascontiguousarray(c), np.zeros(0)) for c in (*columns.T, torque, *friction.T)]
    table = np.stack(white, axis=1)[used]
    n = columns.shape[1]
    q, _ = np.linalg.qr(table[:, n + 1 :])
    table = table[:, : n + 1] - q @ (q.T @ table[:, : n + 1])
    return table[:, :n], table[:, n]


def _posterior(
    grams: list[Array], moments: list[Array], rows: list[tuple[Array, Array]], used: slice, rate_hz: float
) -> tuple[Array, Array, Array]:
    """Mean, covariance, and the covariance by blocks of rows (Huber's sandwich), which holds for noise of any kind."""
    size = grams[0].shape[0]
    covariance = np.linalg.inv(np.eye(size)[used, used] + sum(g[used, used] for g in grams))
    mean = covariance @ sum(m[used] for m in moments)
    middle = np.eye(size)[used, used]
    block = max(1, int(BLOCK_S * rate_hz))
    for columns, torque in rows:
        left = torque - columns[:, used] @ mean
        scores = [columns[k : k + block, used].T @ left[k : k + block] for k in range(0, left.size, block)]
        middle = middle + sum(np.outer(s, s) for s in scores)
    return mean, covariance, covariance @ middle @ covariance


def _payload(columns: _Columns, mean: Array, covariance: Array, robust: Array) -> PayloadEstimate:
    """The payload's mass against none, by the ratio of its densities at 0 (Dickey 1971)."""
    own = slice(columns.payload.start, columns.payload.start + 4)
    scale = columns.scale[:4]
    numbers = mean[own] * scale
    spread = np.where(np.diag(robust)[own] > np.diag(covariance)[own], 1.0, 0.0)
    spread = spread[:, None] * robust[own, own] + (1.0 - spread[:, None]) * covariance[own, own]
    spread = 0.5 * (spread + spread.T) * np.outer(scale, scale)
    deviation = math.sqrt(float(spread[0, 0]))
    z = float(numbers[0]) / deviation
    log_odds = math.log(PRIOR / (1.0 - PRIOR)) + math.log(deviation / float(scale[0])) + 0.5 * z * z
    return PayloadEstimate(numbers, spread, 1.0 / (1.0 + math.exp(-min(max(log_odds, -50.0), 50.0))))


def _few(errors: Array, least: float = 1e-3) -> Array:
    """The same covariance of rows by as few directions as hold all but a thousandth of it, shape (rows, p)."""
    power, ways = np.linalg.eigh(errors.T @ errors)
    return np.asarray(errors @ ways[:, power > least * float(power.sum())])
