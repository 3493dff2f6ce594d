"""One robot in closed loop, its description with errors, its log and what it hides; all follows from the seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage, signal
from scipy.spatial.transform import Rotation

from tests.robot_bank.effects import BEYOND, LEVELS, beyond
from tests.robot_bank.multibody import Array, Body
from tests.robot_bank.second import dynamics, servo
from tests.robot_bank.second.builds import Build, draw_build, draw_payload
from tests.robot_bank.second.description import (
    Sheet,
    Written,
    draw_written,
    in_last_frame,
    write_axis,
    write_robot,
    write_urdf,
)
from tests.robot_bank.second.dynamics import STEP_S
from tests.robot_bank.second.effects import EFFECTS, Course, Draw, Effect
from tests.robot_bank.second.programs import LEAD_S, RISE_S, Program, draw_program
from tests.robot_bank.second.record import Log, Recorder, draw_recorder, record, seen, write_log, write_map
from tests.robot_bank.second.servo import Drive, Friction, Run, Servo

GRAVITY = 9.81
TILT_DEG = 0.5
CENTER_M = 0.008
CONSTANT_SHARE = 0.04
SHOWS = 0.3
"""What is really there and nobody hid may be named where it is felt by this share of the noise."""
TRIES = 40
KINDS = ("null", "payload", *EFFECTS)
DESCRIBED = ("coulomb_friction", "viscous_friction")
"""Those that ask for joints whose friction is described."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot as it is: gravity (3,) [m/s2] in the base frame, what hangs at the flange, the drives of its joints."""

    build: Build
    gravity: Array
    payload: Body | None
    drives: tuple[Drive, ...]
    elastic: bool

    def bodies(self) -> tuple[Body, ...]:
        """Return the links as they move, the last with what hangs there."""
        return _loaded(self.build.bodies, self.payload)


@dataclass(frozen=True, eq=False)
class Description:
    """What the owner believes: links, what hangs at the flange, gravity (3,), drives (None: no axis files), and whether
    the log is of the motors and the axis files have their gears."""

    bodies: tuple[Body, ...]
    payload: Body | None
    gravity: Array
    sheets: tuple[Sheet, ...] | None
    geared: bool


@dataclass(frozen=True, eq=False)
class Scenario:
    """A case of the bank; `hidden`, `neutral` and `friction` are what an answer is judged by; noise (n,) [N m]."""

    seed: int
    kind: str
    level: str
    robot: Robot
    description: Description
    written: Written
    program: Program
    recorder: Recorder
    run: Run
    log: Log
    noise: Array
    hidden: tuple[dict[str, Any], ...]
    neutral: tuple[dict[str, Any], ...]
    friction: Mapping[str, Mapping[str, float]]
    strength: float

    @property
    def gears(self) -> Array:
        """Motor turns per turn of the joint (n,) where the log is of the motors, else 1."""
        return self.robot.build.gear if self.description.geared else np.ones(self.robot.build.joints)

    def answer(self) -> dict[str, Any]:
        """Return the truth as JSON data; sizes are in the units of the log's joint, N m as its drive counts them."""
        names, described = self.written.names, self.description.sheets is not None
        habit = "geared" if self.description.geared else "described" if described else "bare"
        return {
            "seed": self.seed,
            "kind": self.kind,
            "level": self.level,
            "hidden": list(self.hidden),
            "neutral": list(self.neutral),
            "strength": self.strength,
            "friction": {} if described else dict(self.friction),
            "noise": {name: float(rms) for name, rms in zip(names, self.noise / self.gears, strict=True)},
            "joints": list(names),
            "build": self.robot.build.name,
            "class_kg": round(self.robot.build.class_kg, 1),
            "motion": self.program.kind,
            "rate_hz": self.recorder.rate_hz,
            "seconds": self.recorder.seconds,
            "drives": f"{habit} elastic" if self.robot.elastic else habit,
        }


def _loaded(bodies: tuple[Body, ...], payload: Body | None) -> tuple[Body, ...]:
    return bodies if payload is None else (*bodies[:-1], bodies[-1] + payload)


def generate(seed: int, kind: str, level: str = "full", seconds: float | None = None) -> Scenario:
    """Return a case of a kind; robots that cannot show an effect of that level in any joint are drawn again.

    Raises ValueError where none can.
    """
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind}")
    for attempt in range(TRIES):
        scenario = _attempt(seed, np.random.default_rng([seed, attempt, 77]), kind, level, seconds)
        if scenario is not None:
            return scenario
    raise ValueError(f"none of {TRIES} robots shows {kind} at level {level}, seed {seed}")


def _attempt(seed: int, rng: np.random.Generator, kind: str, level: str, seconds: float | None) -> Scenario | None:
    build = draw_build(rng)
    described = kind in DESCRIBED or bool(rng.random() < 0.5)
    # the sheet of an elastic drive is one of motor and gear, which a sliding joint has none of here
    elastic = bool(rng.random() < 0.5) and not (described and any(build.sliding))
    if kind == "backlash":
        elastic = True
        if any(build.sliding):
            return None
    geared = described and not any(build.sliding) and (elastic or bool(rng.random() < 0.5))
    nominal = _draw_stand(rng, build)
    gravity = _tilted(rng, nominal)
    payload, believed_payload = _draw_payloads(rng, build, kind)
    rated = _rated(rng, build, nominal)
    written = draw_written(rng, build)
    recorder = draw_recorder(rng, rated, not any(build.sliding), seconds)
    drives = tuple(_draw_drives(rng, build, rated, payload, gravity, elastic, recorder.seconds))
    robot = Robot(build, gravity, payload, drives, elastic)
    bodies = tuple(_mistaken(rng, body) for body in build.bodies)
    sheets = None
    if described:
        believed = dynamics.model(build, _loaded(bodies, believed_payload), nominal)
        moved = dynamics.inertias(believed, build.home[None])[0] if elastic else np.zeros(build.joints)
        each = zip(drives, build.speed, moved, strict=True)
        sheets = tuple(_sheet(rng, drive, float(fastest), float(behind)) for drive, fastest, behind in each)
    description = Description(bodies, believed_payload, nominal, sheets, geared)
    program = _affordable(rng, robot, rated, recorder.seconds)
    if program is None:
        return None
    if kind == "payload" and not _payload_shown(rng, robot, description, program, recorder):
        return None
    bench = _Bench(rng, robot, description, program)
    run = bench.run(drives)
    courses = [_course(run, j) for j in range(build.joints)]
    noise = _noise(recorder, run, bench.shaken)
    hidden: tuple[dict[str, Any], ...] = ()
    strength, effect, joint, amplitude = 0.0, None, 0, 0.0
    if kind == "payload":
        strength = float(np.max(_missing(robot, description, program) / noise))
        if strength < 1:
            return None
        hidden = (_hidden_payload(robot, written),)
    elif kind != "null":
        found = _placed(rng, kind, LEVELS[level], robot, description, recorder, courses, noise)
        if found is None:
            return None
        joint, effect, amplitude, strength = found
        hidden = (_hidden_effect(effect, amplitude, written.names[joint], drives[joint], geared),)
        wrong = effect.act(drives[joint], amplitude)
        if wrong != drives[joint]:
            robot = replace(robot, drives=(*drives[:joint], wrong, *drives[joint + 1 :]))
            before, run = run, bench.run(robot.drives)
            if kind == "backlash":
                strength = _difference(before, run, joint) / float(noise[joint])
        if sheets is not None and kind in DESCRIBED:
            absent = "dry" if kind == "coulomb_friction" else "viscous"
            cut = replace(sheets[joint], **{absent: 0.0})
            description = replace(description, sheets=(*sheets[:joint], cut, *sheets[joint + 1 :]))
    offsets, delays = np.zeros(build.joints), np.zeros(build.joints)
    if effect is not None:
        offsets[joint] = effect.offset * amplitude
        delays[joint] = amplitude if effect.late else 0.0
    log = record(rng, recorder, run, offsets, delays)
    friction = {}
    for j, name in enumerate(written.names):
        dry, viscous = courses[j].straight(drives[j])
        friction[name] = {"dry": dry / drives[j].constant, "viscous": viscous / drives[j].constant}
    neutral = tuple(_neutral(robot, description, written, recorder, courses, noise))
    return Scenario(
        seed, kind, level, robot, description, written, program, recorder, run, log, noise, hidden, neutral, friction,
        strength,
    )  # fmt: skip


def _draw_stand(rng: np.random.Generator, build: Build) -> Array:
    """Draw gravity (3,) [m/s2] in the base frame: robots stand; those whose joints all turn may hang, or at a wall."""
    down = np.array([0.0, 0.0, -GRAVITY])
    if any(build.sliding) or rng.random() < 0.6:
        return down
    if rng.random() < 0.5:
        return -down
    about = rng.uniform(-np.pi, np.pi)
    return GRAVITY * np.round(np.array([np.cos(about), np.sin(about), 0.0]), 4)


def _tilted(rng: np.random.Generator, gravity: Array) -> Array:
    """Return gravity of a base that is not quite level."""
    across = np.cross(gravity, rng.standard_normal(3))
    across /= np.linalg.norm(across)
    return np.asarray(Rotation.from_rotvec(np.deg2rad(rng.uniform(0, TILT_DEG)) * across).apply(gravity))


def _draw_payloads(rng: np.random.Generator, build: Build, kind: str) -> tuple[Body | None, Body | None]:
    """Return what hangs at the flange and what is believed to hang there."""
    body = draw_payload(rng, build)
    if kind == "payload":
        return body, None
    if rng.random() < 0.35:
        share = float(rng.uniform(0.98, 1.02))
        return body, Body(body.mass * share, body.center, body.inertia * share)
    return None, None


def _rated(rng: np.random.Generator, build: Build, gravity: Array) -> Array:
    """Return torques (n,) [N m] that the drives are chosen by: what brisk motions with a load ask, and a reserve."""
    frame, place = build.flange
    load = Body(build.class_kg, place + 0.05 * frame[:, 2], 2e-3 * build.class_kg * np.eye(3))
    rigid = dynamics.model(build, _loaded(build.bodies, load), gravity)
    shape = (200, build.joints)
    angles = build.home + build.range * rng.uniform(-1, 1, shape)
    speeds, rises = (most * rng.uniform(-1, 1, shape) for most in (build.speed, build.speed / RISE_S))
    rated = 1.5 * np.percentile(np.abs(dynamics.asked(rigid, angles, speeds, rises)), 95, axis=0)
    for kind in (False, True):
        alike = np.array(build.sliding) == kind
        if np.any(alike):
            rated[alike] = np.maximum(rated[alike], 0.08 * rated[alike].max())
    return np.asarray(rated)


def _draw_drives(
    rng: np.random.Generator,
    build: Build,
    rated: Array,
    payload: Body | None,
    gravity: Array,
    elastic: bool,
    seconds: float,
) -> list[Drive]:
    """Draw the drives, all of one make: their gears lose much or little of the torque they carry."""
    rigid = dynamics.model(build, _loaded(build.bodies, payload), gravity)
    poses = build.home + build.range * rng.uniform(-1, 1, (10, build.joints))
    felt, free = dynamics.inertias(rigid, poses)
    lossy = bool(rng.random() < 0.5)
    power = rng.uniform(0.7, 1.0)
    bristled = bool(rng.random() < 0.5)
    forward = float(rng.choice([0.0, 1.0, 1.0]))
    drives = []
    for j in range(build.joints):
        most = float(rated[j])
        rotor = max(rng.uniform(0.15, 0.6) * float(felt[j]), most * rng.uniform(0.003, 0.006))
        dry = most * rng.uniform(0.02, 0.05)
        loss = rng.uniform(0.03, 0.1) if lossy else rng.uniform(0.03, 0.1) * dry / most
        stiffness = damping = 0.0
        lag = rng.uniform(5, 12)
        if elastic:
            mode = 2 * np.pi * rng.uniform(8, 25)
            # no gear is made that its torque would twist by more, nor one stiffer than the castings beside it
            stiff = max(mode**2 * float(felt[j]), most / 6e-3)
            stiffness = min(stiff, (2 * np.pi * 120) ** 2 * float(free[j]))
            locked = np.sqrt(stiffness / felt[j])
            damping = 2 * rng.uniform(0.02, 0.06) * stiffness / locked
            lag = min(lag, 0.35 * locked / (2 * np.pi))
        width = 2 * np.pi * lag
        inertia = rotor + float(felt[j])
        stroke = float(build.range[j])
        way = rng.uniform(1e-4, 6e-4) * stroke
        friction = Friction(
            dry=dry,
            loss=loss,
            viscous=most * rng.uniform(0.03, 0.09) / float(build.speed[j]) ** power,
            power=power,
            way=way,
            inner=rng.uniform(0.1, 0.5) * np.sqrt(dry / way * rotor) if bristled else 0.0,
            warming=-rng.uniform(0.01, 0.04) * min(1.0, seconds / 30),
        )
        step = float(np.exp(rng.uniform(np.log(5e-7), np.log(1e-5)))) * min(stroke, 1.0)
        servo_ = Servo(
            position=width / 4,
            speed=inertia * width,
            integral=inertia * width**2 / 6,
            torque_forward=forward,
            speed_forward=float(forward > 0),
            step=step,
            filter_hz=float(rng.uniform(150, 300)),
            limit=2 * most,
        )
        constant = 1 + CONSTANT_SHARE * rng.uniform(-1, 1)
        drives.append(
            Drive(friction, servo_, rotor, most, float(build.gear[j]), constant, stiffness=stiffness, damping=damping)
        )
    return drives


def _mistaken(rng: np.random.Generator, body: Body) -> Body:
    """Return a link as described: its mass off by 3 to 8 %, its centre by up to 8 mm, its inertia by 10 to 20 %."""
    mass = 1 + rng.choice([-1, 1]) * rng.uniform(0.03, 0.08)
    way = rng.standard_normal(3)
    center = body.center + CENTER_M * rng.uniform() * way / np.linalg.norm(way)
    inertia = 1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.2)
    return Body(body.mass * mass, center, body.inertia * inertia)


def _sheet(rng: np.random.Generator, drive: Drive, fastest: float, moved: float) -> Sheet:
    """Return a drive's sheet: the straight line through its friction up to its speed, all off by up to 10 %."""
    speed = np.linspace(0.03, 1, 40) * fastest
    matrix = np.column_stack([np.ones_like(speed), speed])
    line = np.linalg.lstsq(matrix, drive.friction.steady(speed) / drive.constant, rcond=None)[0]
    dry, viscous = line * (1 + 0.1 * rng.uniform(-1, 1, 2))
    rotor, stiffness = 1 + rng.uniform(-1, 1, 2) * [0.05, 0.1]
    return Sheet(
        drive.rotor * rotor,
        float(dry),
        float(viscous),
        drive.gear,
        drive.stiffness * stiffness,
        drive.damping * (1 + 0.3 * rng.uniform(-1, 1)),
        moved,
    )


def _sparse(program: Program) -> tuple[Array, Array, Array]:
    few = slice(round(LEAD_S / STEP_S), -round(LEAD_S / STEP_S), 200)
    rises = np.gradient(program.speeds, STEP_S, axis=0)
    return program.angles[few], program.speeds[few], rises[few]


def _affordable(rng: np.random.Generator, robot: Robot, rated: Array, seconds: float) -> Program | None:
    """Return a program that the drives suffice for."""
    rigid = dynamics.model(robot.build, robot.bodies(), robot.gravity)
    rotors = np.array([drive.rotor for drive in robot.drives])
    felt = dynamics.inertias(rigid, robot.build.home[None])[0]
    stiffness = np.array([drive.stiffness for drive in robot.drives])
    rings_hz = float(np.min(np.sqrt(stiffness / felt))) / (2 * np.pi) if robot.elastic else None
    for _ in range(4):
        program = draw_program(rng, robot.build, rigid, seconds, rings_hz=rings_hz)
        course = _sparse(program)
        if np.all(np.abs(dynamics.asked(rigid, *course) + rotors * course[2]) < 1.2 * rated):
            return program
    return None


class _Bench:
    """Where a robot's program is run: the same for drives with and without an effect."""

    def __init__(self, rng: np.random.Generator, robot: Robot, description: Description, program: Program) -> None:
        rotors = np.array([drive.rotor for drive in robot.drives])
        self._moving = dynamics.model(robot.build, robot.bodies(), robot.gravity, rotors, robot.elastic)
        self._program = program.angles, program.speeds
        rigid = dynamics.model(robot.build, robot.bodies(), robot.gravity)
        still = np.zeros((1, robot.build.joints))
        self._hold = dynamics.asked(rigid, program.angles[:1], still, still)[0]
        self._forward = _fed_forward(robot, description, program, rotors)
        rms = np.array([drive.rated for drive in robot.drives]) * rng.uniform(2e-4, 8e-4)
        keep = np.exp(-2 * np.pi * 15 * STEP_S)
        white = rng.standard_normal(program.angles.shape) * np.sqrt(1 - keep**2)
        self.shaken = rms * signal.lfilter([1.0], [1.0, -keep], white, axis=0)

    def run(self, drives: tuple[Drive, ...]) -> Run:
        return servo.run(self._moving, drives, self._program, self._forward, self.shaken, LEAD_S, self._hold)


def _fed_forward(robot: Robot, description: Description, program: Program, rotors: Array) -> Array:
    """Return the torques (m, n) of the robot as described along the program, as its servos count them."""
    believed = _loaded(description.bodies, description.payload)
    rigid = dynamics.model(robot.build, believed, description.gravity)
    few = slice(None, None, 10)
    rises = np.gradient(program.speeds, STEP_S, axis=0)
    torques = dynamics.asked(rigid, program.angles[few], program.speeds[few], rises[few]) + rotors * rises[few]
    at = np.arange(len(program.angles))
    return np.column_stack([np.interp(at, at[few], torques[:, j]) for j in range(torques.shape[1])])


def _course(run: Run, joint: int) -> Course:
    """Return what a joint's motor did while the log was written, every fourth step."""
    inside = slice(int(np.searchsorted(run.time, 0)), int(np.searchsorted(run.time, run.time[-1] - LEAD_S)), 4)
    parts = (run.angles, run.speeds, run.accelerations, run.carried, run.side)
    return Course(run.time[inside], *(part[inside, joint] for part in parts))


def _noise(recorder: Recorder, run: Run, shaken: Array) -> Array:
    """Return the noise (n,) [N m] of the torques, rms: of the sensor and its steps, of what shakes the motors, and what
    the servos do faster than a log of this rate can show a motion for."""
    inside = slice(int(np.searchsorted(run.time, 0)), int(np.searchsorted(run.time, run.time[-1] - LEAD_S)))
    torques = seen(recorder, run.torques)
    slow = ndimage.uniform_filter1d(torques, round(4 / recorder.rate_hz / STEP_S) | 1, axis=0)
    fast = 1.4826 * np.median(np.abs(torques - slow)[inside], axis=0)
    parts = recorder.sensor**2 + recorder.bits**2 / 12 + np.mean(shaken**2, axis=0) + fast**2
    return np.asarray(np.sqrt(parts))


def _tolerance(rng: np.random.Generator, robot: Robot, course: tuple[Array, Array, Array]) -> Array:
    """Return the rms torque (n,) [N m] that a description as uncertain as this one is off by; of eight drawn ones."""
    true = dynamics.asked(dynamics.model(robot.build, robot.bodies(), robot.gravity), *course)
    off = []
    for _ in range(8):
        bodies = tuple(_mistaken(rng, body) for body in robot.build.bodies)
        drawn = dynamics.model(robot.build, _loaded(bodies, robot.payload), _tilted(rng, robot.gravity))
        constants = 1 + CONSTANT_SHARE * rng.uniform(-1, 1, robot.build.joints)
        off.append(dynamics.asked(drawn, *course) * constants - true)
    return np.asarray(np.sqrt(np.mean(np.square(off), axis=(0, 1))))


def _missing(robot: Robot, description: Description, program: Program) -> Array:
    """Return the rms torque (n,) [N m] that what hangs at the flange takes."""
    course = _sparse(program)
    with_it = dynamics.model(robot.build, robot.bodies(), robot.gravity)
    without = dynamics.model(robot.build, _loaded(robot.build.bodies, description.payload), robot.gravity)
    off = dynamics.asked(with_it, *course) - dynamics.asked(without, *course)
    return np.asarray(np.sqrt(np.mean(off**2, axis=0)))


def _payload_shown(
    rng: np.random.Generator, robot: Robot, description: Description, program: Program, recorder: Recorder
) -> bool:
    """Return whether a payload is more than links of other masses, another constant and a base not level could be."""
    missing = _missing(robot, description, program)
    sure = missing > BEYOND * _tolerance(rng, replace(robot, payload=None), _sparse(program))
    return bool(np.any(sure & (missing >= recorder.sensor)))


def _columns(course: Course, rivals: tuple[str, ...]) -> list[Array]:
    """Return what other numbers of the joint's own drive could do to its torque, columns (m,)."""
    columns = {"dry": course.side, "viscous": course.speed, "offset": np.ones_like(course.time)}
    return [column * course.moving for column in (course.acceleration, *(columns[name] for name in rivals))]


def _placed(
    rng: np.random.Generator,
    kind: str,
    level: float,
    robot: Robot,
    description: Description,
    recorder: Recorder,
    courses: list[Course],
    noise: Array,
) -> tuple[int, Effect, float, float] | None:
    """Return a joint, the effect there, its amplitude and strength; None where no joint can show it within its cap."""
    tolerance: Array | None = None
    rigid = dynamics.model(robot.build, robot.bodies(), robot.gravity)
    felt = dynamics.inertias(rigid, _of(courses)[0][::5])[0]
    for joint in (int(j) for j in rng.permutation(robot.build.joints)):
        course, drive = courses[joint], robot.drives[joint]
        if not np.any(course.moving):
            continue
        draw = Draw(
            rng, drive, course, description.geared, robot.build.sliding[joint],
            float(felt[joint]) + drive.rotor, float(noise[joint]), recorder.rate_hz,
            *recorder.errors(drive.servo.step, drive.gear if description.geared else 1.0),
        )  # fmt: skip
        effect = EFFECTS[kind](draw)
        change = effect.change(course) * effect.shown(course) * course.moving
        unit = beyond(change, _columns(course, effect.rivals)) / float(noise[joint])
        if effect.amplitude is not None:
            turns = np.count_nonzero(np.diff(np.sign(course.carried[np.abs(course.carried) > 0.02 * drive.rated])))
            if effect.amplitude > 0 and (kind != "backlash" or turns >= 4) and (effect.may_be_missed or unit >= 0.5):
                return joint, effect, effect.amplitude, unit
            continue
        if unit <= 0:
            continue
        amplitude = level / unit
        if effect.beyond_masses:
            tolerance = _tolerance(rng, robot, _of(courses)) if tolerance is None else tolerance
            amplitude = max(amplitude, BEYOND * float(tolerance[joint]) / float(np.sqrt(np.mean(change**2))))
        amplitude = min(amplitude, effect.cap)
        if amplitude * unit >= 0.9 * level:
            return joint, effect, amplitude, amplitude * unit
    return None


def _of(courses: list[Course]) -> tuple[Array, Array, Array]:
    """Return the motion of all joints, every tenth of a second."""
    few = slice(None, None, 50)
    angles, speeds, rises = (
        np.column_stack([getattr(course, name)[few] for course in courses])
        for name in ("angle", "speed", "acceleration")
    )
    return angles, speeds, rises


def _difference(before: Run, after: Run, joint: int) -> float:
    """Return the rms of what an effect changed of the torque that is logged [N m]."""
    inside = before.time >= 0
    return float(np.sqrt(np.mean((after.torques - before.torques)[inside, joint] ** 2)))


def _neutral(
    robot: Robot, description: Description, written: Written, recorder: Recorder, courses: list[Course], noise: Array
) -> list[dict[str, Any]]:
    """Return what is really there and nobody hid, where it can be felt: named, it is neither right nor wrong."""
    found = [{"mechanism": "lost_samples", "location": None}] if recorder.lost > 0 else []
    course = _of(courses)
    level = dynamics.model(robot.build, robot.bodies(), description.gravity)
    tilted = dynamics.model(robot.build, robot.bodies(), robot.gravity)
    leaning = dynamics.asked(tilted, *course) - dynamics.asked(level, *course)
    for j, (name, drive, own) in enumerate(zip(written.names, robot.drives, courses, strict=True)):
        columns = _columns(own, ("dry", "viscous"))
        few = [column[::50] for column in _columns(own, ("dry", "viscous", "offset"))]
        if not np.any(own.moving):
            continue
        loss = drive.friction.loss * np.abs(own.carried) * own.side * own.moving
        warming = drive.friction.warming * own.time / own.time[-1] * own.friction(drive) * own.moving
        felt = {
            "load_dependent_loss": beyond(loss, columns),
            "friction_drift": beyond(warming, columns),
            "gravity_imbalance": beyond(leaning[:, j] * own.moving[::50], few),
        }
        found += [
            {"mechanism": mechanism, "location": name, "felt": round(rms / float(noise[j]), 2)}
            for mechanism, rms in felt.items()
            if rms > SHOWS * noise[j]
        ]
        if robot.elastic and description.sheets is None:
            found.append({"mechanism": "structural_resonance", "location": name})
    return found


def _hidden_payload(robot: Robot, written: Written) -> dict[str, Any]:
    body = robot.payload
    assert body is not None
    center = in_last_frame(written, body)
    sizes = {"mass_kg": body.mass} | {f"center_{c}_m": float(v) for c, v in zip("xyz", center, strict=True)}
    return {
        "mechanism": "payload",
        "location": "payload",
        "as_parameter": False,
        "may_be_missed": False,
        "sizes": sizes,
    }


def _hidden_effect(effect: Effect, amplitude: float, joint: str, drive: Drive, geared: bool) -> dict[str, Any]:
    """Return an effect as JSON data; where the log is of the motors, sizes are those at the motor."""
    gear = drive.gear if geared else 1.0
    behind = 1.0 if effect.mechanism == "gravity_imbalance" else 1 / gear
    # an offset is of the log itself, all other torques are counted as the drive counts its own
    counted = 1.0 if effect.offset else 1 / drive.constant
    per = {"torque_n_m": counted * behind, "coefficient_n_m_s_per_rad": counted / gear**2, "speed_rad_s": gear}
    return {
        "mechanism": effect.mechanism,
        "location": joint,
        "as_parameter": False,
        "may_be_missed": effect.may_be_missed,
        "sizes": {name: value * per.get(name, 1.0) for name, value in effect.sizes(amplitude).items()},
    }


def write(scenario: Scenario, folder: Path) -> None:
    """Write robot.toml, the URDF, axis files, channels.toml and log.csv; no answers."""
    folder.mkdir(parents=True, exist_ok=True)
    names, description, build = scenario.written.names, scenario.description, scenario.robot.build
    effort = np.array([drive.rated for drive in scenario.robot.drives])
    (folder / "robot.urdf").write_text(write_urdf(build, description.bodies, scenario.written, effort))
    axes: dict[str, str] = {}
    if description.sheets is not None:
        for name, sheet in zip(names, description.sheets, strict=True):
            axes[name] = f"{name}.toml"
            (folder / axes[name]).write_text(write_axis(name, sheet, description.geared))
    payload = None
    if description.payload is not None:
        payload = description.payload.mass, in_last_frame(scenario.written, description.payload)
    (folder / "robot.toml").write_text(write_robot(description.gravity, names, axes, payload))
    gears = scenario.gears
    (folder / "channels.toml").write_text(write_map(scenario.recorder, scenario.log, gears, build.sliding))
    (folder / "log.csv").write_text(write_log(scenario.recorder, scenario.log, gears))
