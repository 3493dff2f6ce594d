"""The next motion of a robot: of many within its limits the one whose log tells most of what is open.

What a log tells is the information of a Gaussian posterior (D-optimal design; Lindley, Annals of Mathematical
Statistics 27 (1956) 986): half of how much the log of the determinant of the covariance falls. Torques of all joints
are linear in what the joints share (`shared_fit`), and linearised in the numbers of each joint's own model where these
were found, under the noise that this model leaves. What the present log told of what is shared is counted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.discrepancy.assessment.posterior import is_close
from sim.discrepancy.data.preprocessing import SLOW_ANGLE_CUT_HZ, SLOW_DIRECT_ANGLE_CUT_HZ, Measurement, prepare
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.robot.motion import Motion
from sim.robot.results import JointInvestigation, RobotInvestigation
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Payload, Robot
from sim.robot.shared_fit import LOAD_LOSS, PRIOR, TURNS, friction_curves, shared_columns
from sim.robot.trajectory import Harmonics, Limits, Trajectory, repeated

Array = NDArray[np.float64]

COARSE_HZ = 20.0  # of rows at which the links are asked: twenty for the fastest harmonic
DRAWS = 24
LEAST_S = 10.0
LEAST = 1e-9  # information of a step of a number, relative to the others': less is none
PAYLOAD, MASS = 10, 4  # numbers of a payload, and those that count: mass and first moments
OF_A_LOG = 1 + PAYLOAD  # the last of the shared numbers: delay and payload of each log


@dataclass(frozen=True)
class NextMotion:
    """A motion that is to be made, and how much more its log tells of what is open than one of the present motion that
    is as long (`gain`) [nat]."""

    motion: Harmonics
    gain: float

    def document(self) -> dict[str, object]:
        """JSON."""
        return {**self.motion.document(), "gain_nat": round(self.gain, 2)}


def next_motion(result: RobotInvestigation) -> NextMotion | None:
    """Return the motion whose log tells most of what is open.

    None where no joint has a model, or none that was drawn tells more than one more log of the present motion.

    Open are causes that could not be told apart, what is left without a name, and a payload that may or may not be
    there; where nothing is, the friction of each joint and the payload.
    """
    models = [model for k, joint in enumerate(result.joints) if (model := _model_of(result.robot, k, joint))]
    if not models:
        return None
    payload = PRIOR < result.shared.payload.probability < 1.0 - PRIOR
    if payload or any(model.is_open for model in models):
        models = [model if model.is_open else replace(model, asked=frozenset()) for model in models]
    else:
        payload = True
    present = result.shared.motion
    seconds = max(LEAST_S, round(float(present.time_s[-1] - present.time_s[0])))
    again = repeated(result.robot, present, seconds)
    worth = _Worth.of(result, models, again, payload=payload)
    limits, rng = Limits.of(result.robot, present), np.random.default_rng(0)
    drawn = [limits.drawn(rng, seconds) for _ in range(DRAWS)]
    told = [worth.told(one.trajectory()) for one in drawn]
    best = int(np.argmax(told))
    gain = told[best] - worth.told(again)
    return NextMotion(drawn[best], gain) if gain > 0.0 else None


@dataclass(frozen=True)
class _Model:
    """A joint's model at what was found, with rivals beside what is open; `asked`: names of the numbers in question.

    `as_one`: its gears are rigid and counted at the motor.
    """

    place: int
    ratio: float
    as_one: bool
    problem: Problem
    terms: tuple[Term, ...]
    values: Mapping[str, float]
    asked: frozenset[str]
    is_open: bool

    def measurement(self, motion: Trajectory, rigid: Array) -> Measurement:
        """What would be prepared of a log of `motion`, along which the links ask for `rigid` [N m].

        Its torque is that of the present log in size alone, by which steps of numbers are taken.
        """
        m, axis = self.problem.measurement, self.problem.axis
        clock = np.arange(int(motion.time_s[-1] * m.rate_hz) + 1) / m.rate_hz
        load = 0.0 if self.as_one else axis.load.inertia_kg_m2
        known = (rigid - load * motion.acceleration[:, self.place]) / (self.ratio if self.as_one else 1.0)
        angle, known = (
            CubicSpline(motion.time_s, values)(clock) for values in (motion.position[:, self.place] * self.ratio, known)
        )
        cut = SLOW_ANGLE_CUT_HZ if axis.stages else SLOW_DIRECT_ANGLE_CUT_HZ
        torque = np.full(clock.size, m.torque_rms)
        made = prepare(m.rate_hz, torque, angle, None, slow_angle_cut_hz=cut, known_torque=known)
        return replace(made, standstill=m.standstill, rests=m.rests, gear=m.gear)

    def columns(self, made: Measurement, beside: Array) -> tuple[Array, Array]:
        """White torque of the motor per step of each of the model's numbers, shape (rows, p); and of torques at the
        joint `beside`, shape (rows, n) [N m]."""
        noise = self.problem.noise
        noise = replace(noise, torque_level=np.full(1, float(np.median(noise.torque_level))), ways=np.zeros((0, 0)))
        problem = Problem(
            self.problem.axis, made, replace(noise, less=np.zeros(0)), self.problem.memory, unknown=self.problem.unknown
        )
        parameters = problem.parameters(self.terms)
        values = {p.name: self.values.get(p.name, p.start) for p in parameters}
        raw = problem.sensitivities(self.terms, values, parameters, problem.raw_residuals(self.terms, values))
        own = problem.whitened(parameters, raw)
        felt = [problem.white((made.across(-column / self.ratio), np.zeros(0))) for column in beside.T]
        return own[: made.samples], np.stack(felt, axis=1)

    @property
    def parameters(self) -> Sequence[tuple[str, float]]:
        """Name of each number, and its step over what is known of it beforehand."""
        return [(p.name, p.step / p.spread) for p in self.problem.parameters(self.terms)]


def _model_of(robot: Robot, place: int, joint: JointInvestigation) -> _Model | None:
    """A joint's model; None where it was held still, or no model was fitted."""
    one = joint.investigation
    if one.selection is None or one.weighed is None:
        return None
    problem, fit = one.selection.problem, one.selection.fit
    terms, values, asked = list(fit.terms), dict(fit.values), set()
    alike = {(f.mechanism, f.location): f.indistinguishable_from for f in one.findings}
    for term in one.weighed.found:
        standing = one.weighed.standings[term.key]
        for (other, behind), model in zip(standing.rivals, standing.instead, strict=True):
            if is_close(behind) or other.mechanism in alike.get((term.mechanism, term.location), ()):
                asked |= {p.name for p in (*term.parameters, *other.parameters)}
                terms += [other] if other.key not in {t.key for t in terms} else []
                values = {**model.values, **values}
    if one.verdict == "unnamed":
        asked |= {p.name for term in fit.terms if not term.named for p in term.parameters}
    is_open = bool(asked)
    if not is_open:
        asked = {p.name for term in fit.terms if term.named for p in term.parameters}
        asked |= {p.name for p in problem.base() if "friction" in p.name}
    ratio = robot.joints[place].axis.ratio
    as_one = ratio != problem.axis.ratio
    return _Model(place, ratio, as_one, problem, tuple(terms), values, frozenset(asked), is_open)


@dataclass(frozen=True)
class _Told:
    """What a log tells at one joint: white torque per number of the joint's own model, and per shared number, shape
    (rows, p) and (rows, n); and what is told of the latter whatever the friction's curve is, shape (n, n)."""

    own: Array
    shared: Array
    gram: Array


@dataclass(frozen=True)
class _Worth:
    """What a motion tells beside the present log, as an investigation of both will: what joints share is of both, by
    any friction; the friction of each joint and the payload are those of the new log, since they may have changed."""

    robot: Robot
    body: RigidBody
    models: Sequence[_Model]
    known: Array
    payload: bool

    @staticmethod
    def of(result: RobotInvestigation, models: Sequence[_Model], present: Trajectory, *, payload: bool) -> _Worth:
        robot = _with_payload(result)
        worth = _Worth(robot, RigidBody.of(robot), models, np.zeros((0, 0)), payload)
        grams = [one.gram for one in worth.log(present)]
        size, own = len(grams[0]), OF_A_LOG
        told = np.eye(size) + sum(grams)
        known, across = np.eye(size), told[:-own, -own:]
        known[:-own, :-own] = told[:-own, :-own] - across @ np.linalg.solve(told[-own:, -own:], across.T)
        return replace(worth, known=known)

    def told(self, motion: Trajectory) -> float:
        """What is known of what is asked after a log of `motion`: minus half the log of the determinant of its
        covariance, in units of the numbers' steps [nat]."""
        logs = self.log(motion)
        whole = self.known + sum(one.gram for one in logs)
        out = _narrow(whole, np.arange(len(whole))[-PAYLOAD:][:MASS]) if self.payload else 0.0
        for model, one in zip(self.models, logs, strict=True):
            if not model.asked:
                continue
            columns = np.hstack([one.own, one.shared])
            own = one.own.shape[1]
            information = columns.T @ columns
            information[own:, own:] += whole - one.gram
            names = [name for name, _ in model.parameters]
            information[range(len(names)), range(len(names))] += np.array([prior for _, prior in model.parameters]) ** 2
            information[own - 1, own - 1] += 1.0  # of losses of the load in its gears
            out += _narrow(information, np.flatnonzero([name in model.asked for name in names]))
        return out

    def log(self, motion: Trajectory) -> list[_Told]:
        """What a log of a motion tells at each joint that has a model."""
        step = max(1, round(1.0 / (COARSE_HZ * float(motion.time_s[1]))))
        coarse = _as_motion(motion, step)
        shared = shared_columns(self.robot, self.body, coarse)
        out = []
        for model in self.models:
            k, ratio = model.place, model.ratio
            rigid = CubicSpline(coarse.time_s, shared.rigid[:, k])(motion.time_s)
            made = model.measurement(motion, rigid)
            load = np.interp(made.time_s, motion.time_s, rigid)
            speed = made.speed / ratio
            turn = np.tanh(speed / max(TURNS[1] * float(np.abs(speed).max()), 1e-12))
            any_friction = friction_curves(made.angle / ratio, speed, made.acceleration / ratio, load)
            beside = [LOAD_LOSS * turn * np.abs(load), *CubicSpline(coarse.time_s, shared.values[:, k])(made.time_s).T]
            own, white = model.columns(made, np.column_stack([*beside, any_friction]))
            count = shared.values.shape[-1]
            lost, common, curves = white[:, :1], white[:, 1 : 1 + count], white[:, 1 + count :]
            q = np.linalg.qr(curves)[0]
            beyond = common - q @ (q.T @ common)
            out.append(_Told(np.hstack([own, lost]), common, beyond.T @ beyond))
        return out


def _narrow(information: Array, asked: NDArray[np.int64]) -> float:
    """Minus half the log of the determinant of the covariance of the numbers that are asked."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), LEAST))
    covariance = np.linalg.inv(information * np.outer(scale, scale) + LEAST * np.eye(scale.size))
    inside = np.ix_(asked, asked)
    return -0.5 * float(np.linalg.slogdet(covariance[inside])[1]) - float(np.sum(np.log(scale[asked])))


def _as_motion(motion: Trajectory, step: int) -> Motion:
    """Every `step`-th row as a log without torques."""
    position, speed, acceleration = (each[::step] for each in (motion.position, motion.speed, motion.acceleration))
    rows, joints = position.shape
    return Motion(
        motion.time_s[::step], 1.0 / (step * float(motion.time_s[1])), position, speed, acceleration,
        np.zeros((rows, joints)), np.ones(rows, dtype=np.bool_), np.ones(joints, dtype=np.bool_),
    )  # fmt: skip


def _with_payload(result: RobotInvestigation) -> Robot:
    """The robot with what was found to hang at its last link."""
    if result.payload is None:
        return result.robot
    numbers = {e.name: e.value for e in result.payload.parameters}
    x, y, z = (numbers[f"center_{way}_m"] for way in "xyz")
    return replace(result.robot, payload=Payload(numbers["mass_kg"], (x, y, z)))
