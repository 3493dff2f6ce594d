"""One robot, its description with errors, a log of it, and what it hides; everything follows from the seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robot_bank.arm import Arm, draw_arm
from benchmarks.robot_bank.drive import Drive, bristles, motor_torque
from benchmarks.robot_bank.effects import (
    BEYOND,
    DESCRIBED,
    EFFECTS,
    LEVELS,
    Draw,
    Effect,
    beyond,
    draw_payload,
)
from benchmarks.robot_bank.log import Recorder, Signals, draw_recorder, sample, write_log, write_map
from benchmarks.robot_bank.motion import Motion, draw_motion
from benchmarks.robot_bank.multibody import Array, Body, torques
from benchmarks.robot_bank.urdf import Written, draw_written, last_frame, write_urdf

MASS_SHARE, CENTER_M, INERTIA_SHARE = 0.05, 0.005, 0.1
"""By which a description is off, link by link."""
FRICTION_SHARE, ROTOR_SHARE = 0.1, 0.05
"""By which a described drive is off, at most."""
GRAVITY = 9.81
TRIES = 40
KINDS = ("null", "payload", "payload_wrong", *EFFECTS)


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot as it is, and as it stands in space; gravity (3,) [m/s2] in the base frame, payload None for nothing."""

    arm: Arm
    drives: tuple[Drive, ...]
    gravity: Array
    payload: Body | None

    def bodies(self) -> tuple[Body, ...]:
        """Return the links as they move, the last with what hangs there."""
        if self.payload is None:
            return self.arm.bodies
        return (*self.arm.bodies[:-1], self.arm.bodies[-1] + self.payload)


@dataclass(frozen=True, eq=False)
class Description:
    """What the owner believes: bodies of the links, the payload, drives (None where a joint has no axis file).

    geared: the log has angles and torques of the motors, and the axis files their gears.
    """

    bodies: tuple[Body, ...]
    payload: Body | None
    drives: tuple[Drive, ...] | None
    geared: bool


@dataclass(frozen=True, eq=False)
class Scenario:
    """A case of the bank. `hidden` and `drives` are the truth that an answer is judged by."""

    seed: int
    kind: str
    level: str
    robot: Robot
    description: Description
    written: Written
    motion: Motion
    recorder: Recorder
    signals: Signals
    gravity_in_world: Array
    hidden: tuple[dict[str, Any], ...]
    strength: float

    def answer(self) -> dict[str, Any]:
        """Return the truth as JSON data; sizes are in the units of the log's joint."""
        order = self.recorder.order
        described = self.description.drives is not None
        friction = {
            self.written.names[j]: {"dry": drive.dry * drive.raised, "viscous": drive.viscous}
            for j, drive in enumerate(self.robot.drives)
        }
        noise = {
            name: float(rms / gear)
            for name, rms, gear in zip(self.written.names, self.recorder.torque_noise, self.signals.gears, strict=True)
        }
        return {
            "seed": self.seed,
            "kind": self.kind,
            "level": self.level,
            "hidden": list(self.hidden),
            "strength": self.strength,
            "friction": {} if described else friction,
            "noise": noise,
            "joints": [self.written.names[j] for j in order],
            "build": self.robot.arm.build,
            "class_kg": round(self.robot.arm.class_kg, 1),
            "motion": self.motion.kind,
            "rate_hz": self.recorder.rate_hz,
            "seconds": self.recorder.seconds,
            "drives": "geared" if self.description.geared else "described" if described else "bare",
        }


def generate(seed: int, kind: str, level: str = "full", seconds: float | None = None) -> Scenario:
    """Return a case of a kind; joints that cannot show an effect of that level are drawn again.

    `seconds`: length of the log, else drawn.

    Raises ValueError where none can.
    """
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind}")
    for attempt in range(TRIES):
        scenario = _attempt(seed, np.random.default_rng([seed, attempt, 54]), kind, level, seconds)
        if scenario is not None:
            return scenario
    raise ValueError(f"none of {TRIES} robots shows {kind} at level {level}, seed {seed}")


def _attempt(seed: int, rng: np.random.Generator, kind: str, level: str, seconds: float | None) -> Scenario | None:
    arm = draw_arm(rng)
    mount, gravity_in_world = _draw_mount(rng)
    written = draw_written(rng, arm, mount)
    drives = tuple(_draw_drive(rng, arm, j) for j in range(6))
    recorder = draw_recorder(rng, arm.torque)
    if seconds is not None:
        recorder = replace(recorder, seconds=seconds)
    payload, believed_payload = _draw_payloads(rng, arm, kind)
    robot = Robot(arm, drives, mount.T @ gravity_in_world, payload)
    motion = _affordable_motion(rng, robot, recorder.seconds)
    if motion is None:
        return None
    habit = str(rng.choice(["described", "geared"] if kind in DESCRIBED else ["bare", "bare", "described", "geared"]))
    believed = None if habit == "bare" else tuple(_believed_drive(rng, drive) for drive in drives)
    description = Description(_believed_bodies(rng, arm), believed_payload, believed, habit == "geared")
    carried = torques(arm.chain, robot.bodies(), motion.angles, motion.speeds, motion.accelerations, robot.gravity)
    hidden: tuple[dict[str, Any], ...] = ()
    strength, effect, joint, amplitude = 0.0, None, 0, 0.0
    if kind.startswith("payload"):
        found = _payload_shown(rng, robot, description, motion, carried, recorder)
        if found is None:
            return None
        strength = found
        hidden = (_hidden_payload(robot, description, written, kind),)
    elif kind != "null":
        joint = int(rng.integers(6))
        draw = Draw(rng, joint, drives[joint], motion, description.geared, recorder.rate_hz)
        effect = EFFECTS[kind](draw)
        sized = _sized(rng, robot, effect, joint, motion, carried, recorder, LEVELS[level])
        if sized is None:
            return None
        amplitude, strength = sized
        hidden = (_hidden_effect(effect, amplitude, written.names[joint], drives[joint], description.geared),)
        wrong = effect.act(drives[joint], amplitude)
        robot = replace(robot, drives=(*drives[:joint], wrong, *drives[joint + 1 :]))
        if description.drives is not None:
            sheet = replace(description.drives[joint], **dict.fromkeys(effect.described_without, 0.0))
            sheets = (*description.drives[:joint], sheet, *description.drives[joint + 1 :])
            description = replace(description, drives=sheets)
    offsets, delays = np.zeros(6), np.zeros(6)
    if effect is not None and effect.offset:
        offsets[joint] = next(iter(effect.sizes(amplitude).values()))
    if effect is not None and effect.delay:
        delays[joint] = amplitude
    runs = [motor_torque(robot.drives[j], motion.time, motion.angles[:, j], carried[:, j]) for j in range(6)]
    torque, angle, speed = (np.column_stack([run[k] for run in runs]) for k in range(3))
    gears = np.array([drive.gear for drive in robot.drives]) if description.geared else np.ones(6)
    signals = sample(rng, recorder, motion.time, torque, angle, speed, offsets, delays, gears)
    return Scenario(
        seed, kind, level, robot, description, written, motion, recorder, signals, gravity_in_world, hidden, strength
    )


def _draw_mount(rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw how the robot stands: rotation (3, 3) from base into world as the URDF has it, gravity (3,) in the world.

    On a table, hanging, at a wall or tilted; said by a joint to the world or by the vector of gravity.
    """
    tilt = float(rng.choice([0.0, 0.0, 0.0, np.pi, np.pi / 2, rng.uniform(0.2, 1.2)]))
    about = rng.uniform(-np.pi, np.pi)
    axis = np.array([np.cos(about), np.sin(about), 0.0])
    skew = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(tilt) * skew + (1 - np.cos(tilt)) * skew @ skew
    down = np.array([0.0, 0.0, -GRAVITY])
    if rng.random() < 0.5:
        return turn, down
    return np.eye(3), np.round(turn.T @ down, 6)


def _draw_drive(rng: np.random.Generator, arm: Arm, joint: int) -> Drive:
    rated = float(arm.torque[joint])
    return Drive(
        rotor=rated * rng.uniform(0.004, 0.009),
        dry=rated * rng.uniform(0.025, 0.055),
        viscous=rated * rng.uniform(0.035, 0.075),
        rated=rated,
        gear=float(rng.choice([50, 80, 100])),
        way=float(np.exp(rng.uniform(np.log(2e-4), np.log(2e-3)))),
        start=float(rng.uniform(-1, 1)),
    )


def _believed_drive(rng: np.random.Generator, drive: Drive) -> Drive:
    off = 1 + FRICTION_SHARE * rng.uniform(-1, 1, 2)
    rotor = drive.rotor * (1 + ROTOR_SHARE * rng.uniform(-1, 1))
    return replace(drive, rotor=rotor, dry=drive.dry * off[0], viscous=drive.viscous * off[1])


def _believed_bodies(rng: np.random.Generator, arm: Arm) -> tuple[Body, ...]:
    """Return the links as described: masses off by 5 % up or down, centres by 5 mm in any direction."""
    return tuple(_mistaken(rng, body) for body in arm.bodies)


def _mistaken(rng: np.random.Generator, body: Body) -> Body:
    mass = 1 + MASS_SHARE * rng.choice([-1, 1])
    way = rng.standard_normal(3)
    center = body.center + CENTER_M * way / np.linalg.norm(way)
    # the principal moments keep their proportions, so that they stay those of a body
    return Body(body.mass * mass, center, body.inertia * mass * (1 + INERTIA_SHARE * rng.uniform(-1, 1)))


def _draw_payloads(rng: np.random.Generator, arm: Arm, kind: str) -> tuple[Body | None, Body | None]:
    """Return what hangs at the flange and what is believed to hang there."""
    body = draw_payload(rng, arm)
    if kind == "payload":
        return body, None
    if kind == "payload_wrong":
        share = float(rng.choice([rng.uniform(0.3, 0.65), rng.uniform(1.5, 2.0)]))
        return body, Body(body.mass * share, body.center, body.inertia * share)
    if rng.random() < 0.3:
        share = float(rng.uniform(0.98, 1.02))
        return body, Body(body.mass * share, body.center, body.inertia * share)
    return None, None


def _affordable_motion(rng: np.random.Generator, robot: Robot, seconds: float) -> Motion | None:
    """Return a motion that the joints' rated torques suffice for."""
    for _ in range(3):
        motion = draw_motion(rng, robot.arm, seconds)
        few = slice(None, None, 25)
        course = motion.angles[few], motion.speeds[few], motion.accelerations[few]
        asked = torques(robot.arm.chain, robot.bodies(), *course, robot.gravity)
        asked = asked + course[2] * [drive.rotor for drive in robot.drives]
        if np.all(np.abs(asked) < 0.95 * robot.arm.torque):
            return motion
    return None


def _tolerance(rng: np.random.Generator, robot: Robot, motion: Motion, course: tuple[Array, Array, Array]) -> Array:
    """Return the rms torque (6,) [N m] that links as uncertain as described make; of eight drawn descriptions."""
    chain, gravity = robot.arm.chain, robot.gravity
    true = torques(chain, robot.arm.bodies, *course, gravity)
    drawn = [torques(chain, _believed_bodies(rng, robot.arm), *course, gravity) - true for _ in range(8)]
    return np.asarray(np.sqrt(np.mean(np.square(drawn), axis=(0, 1))))


def _sparse(motion: Motion) -> tuple[Array, Array, Array]:
    few = slice(None, None, 50)
    return motion.angles[few], motion.speeds[few], motion.accelerations[few]


def _own_columns(drive: Drive, motion: Motion, joint: int, rivals: tuple[str, ...]) -> list[Array]:
    """Return what other numbers of the joint's own drive could do to its torque, columns (n,)."""
    angle, speed = motion.angles[:, joint], motion.speeds[:, joint]
    columns = {
        "dry": bristles(angle, drive.way, drive.start),
        "viscous": speed,
        "offset": np.ones_like(angle),
    }
    return [motion.accelerations[:, joint], *(columns[name] for name in rivals)]


def _sized(
    rng: np.random.Generator,
    robot: Robot,
    effect: Effect,
    joint: int,
    motion: Motion,
    carried: Array,
    recorder: Recorder,
    level: float,
) -> tuple[float, float] | None:
    """Return amplitude and strength of an effect at a level; None where the joint cannot show it within its cap."""
    drive, noise = robot.drives[joint], float(recorder.torque_noise[joint])
    columns = _own_columns(drive, motion, joint, effect.rivals)
    least = effect.least
    if effect.beyond_masses:
        least = BEYOND * float(_tolerance(rng, robot, motion, _sparse(motion))[joint])
    change = _changes(drive, effect, joint, motion, carried)

    def strength(amplitude: float) -> float:
        return beyond(change(amplitude)[::4], [column[::4] for column in columns]) / noise

    if effect.amplitude is not None:
        return effect.amplitude, strength(effect.amplitude)
    if effect.cap <= 0:
        return None
    # nearly proportional: two steps
    amplitude = min(effect.cap, 1.0)
    for _ in range(2):
        felt = strength(amplitude)
        if felt <= 0:
            return None
        amplitude = min(effect.cap, amplitude * level / felt)
    if effect.beyond_masses:
        rms = float(np.sqrt(np.mean(change(amplitude) ** 2)))
        amplitude = min(effect.cap, amplitude * max(1.0, least / rms))
    else:
        amplitude = max(amplitude, least)
    reached = strength(amplitude)
    return (amplitude, reached) if reached >= 0.9 * level else None


def _changes(drive: Drive, effect: Effect, joint: int, motion: Motion, carried: Array) -> Callable[[float], Array]:
    """Return the change (n,) [N m] that an effect makes in its joint's torque, by amplitude."""
    before = motor_torque(drive, motion.time, motion.angles[:, joint], carried[:, joint])[0]
    # what is absent from the description is compared with a drive that lacks it
    if effect.described_without:
        without = replace(drive, **dict.fromkeys(effect.described_without, 0.0))
        before = motor_torque(without, motion.time, motion.angles[:, joint], carried[:, joint])[0]

    def change(amplitude: float) -> Array:
        if effect.offset:
            return np.full_like(before, amplitude)
        if effect.delay:
            return np.interp(motion.time - amplitude, motion.time, before) - before
        wrong = effect.act(drive, amplitude)
        return motor_torque(wrong, motion.time, motion.angles[:, joint], carried[:, joint])[0] - before

    return change


def _payload_shown(
    rng: np.random.Generator, robot: Robot, description: Description, motion: Motion, carried: Array, recorder: Recorder
) -> float | None:
    """Return the strength of what the described payload lacks where it is felt most; None where masses could be it."""
    described = robot.arm.bodies
    if description.payload is not None:
        described = (*described[:-1], described[-1] + description.payload)
    course = _sparse(motion)
    missing = carried[::50] - torques(robot.arm.chain, described, *course, robot.gravity)
    rms = np.sqrt(np.mean(missing**2, axis=0))
    strength = rms / recorder.torque_noise
    sure = rms > BEYOND * _tolerance(rng, robot, motion, course)
    return float(np.max(strength)) if np.any(sure & (strength >= 1)) else None


def _hidden_payload(robot: Robot, description: Description, written: Written, kind: str) -> dict[str, Any]:
    body = robot.payload
    assert body is not None
    rotation, origin = last_frame(written)
    center = rotation.T @ (body.center - origin)
    sizes = {"mass_kg": body.mass} | {f"center_{c}_m": float(v) for c, v in zip("xyz", center, strict=True)}
    return {
        "mechanism": "payload",
        "location": "payload",
        "as_parameter": kind == "payload_wrong",
        "may_be_missed": False,
        "sizes": sizes,
    }


def _hidden_effect(effect: Effect, amplitude: float, joint: str, drive: Drive, geared: bool) -> dict[str, Any]:
    """Return an effect as JSON data; where the log is of the motors, sizes are those at the motor."""
    gear = drive.gear if geared else 1.0
    per = {"torque_n_m": 1 / gear, "coulomb_friction_n_m": 1 / gear, "coefficient_n_m_s_per_rad": 1 / gear**2}
    per["speed_rad_s"] = gear
    # a weight and a play are felt behind the gear
    behind = effect.mechanism in ("gravity_imbalance", "backlash")
    sizes = {name: value * (1.0 if behind else per.get(name, 1.0)) for name, value in effect.sizes(amplitude).items()}
    return {
        "mechanism": effect.mechanism,
        "location": joint,
        "as_parameter": effect.as_parameter,
        "may_be_missed": effect.may_be_missed,
        "sizes": sizes,
    }


def write(scenario: Scenario, folder: Path) -> None:
    """Write robot.toml, the URDF, axis files, channels.toml and log.csv; no answers."""
    folder.mkdir(parents=True, exist_ok=True)
    names = scenario.written.names
    urdf = write_urdf("arm", scenario.robot.arm, scenario.description.bodies, scenario.written)
    (folder / "arm.urdf").write_text(urdf)
    order = scenario.recorder.order
    drives = scenario.description.drives
    if drives is not None:
        for j in range(6):
            (folder / f"{names[j]}.toml").write_text(write_axis(names[j], drives[j], scenario.description.geared))
    axes = {names[j]: f"{names[j]}.toml" for j in order} if drives is not None else {}
    payload = scenario.description.payload
    text = write_robot(scenario, [names[j] for j in order], axes, payload)
    (folder / "robot.toml").write_text(text)
    (folder / "channels.toml").write_text(write_map(scenario.recorder, scenario.signals, names))
    (folder / "log.csv").write_text(write_log(scenario.recorder, scenario.signals, names))


def write_robot(scenario: Scenario, joints: list[str], axes: Mapping[str, str], payload: Body | None) -> str:
    """Return robot.toml."""
    gravity = ", ".join(f"{value:g}" for value in scenario.gravity_in_world)
    lines = ['schema = "gearcase-robot/1"', 'name = "arm"', 'urdf = "arm.urdf"', f"gravity_m_s2 = [{gravity}]"]
    if payload is not None:
        rotation, origin = last_frame(scenario.written)
        center = ", ".join(f"{value:.5f}" for value in rotation.T @ (payload.center - origin))
        lines += ["", "[payload]", f"mass_kg = {payload.mass:.4f}", f"center_m = [{center}]"]
    for joint in joints:
        lines += ["", "[[joints]]", f'name = "{joint}"']
        if joint in axes:
            lines.append(f'axis = "{axes[joint]}"')
    return "\n".join(lines) + "\n"


def write_axis(name: str, drive: Drive, geared: bool) -> str:
    """Return the description of a joint's drive: direct, or a rigid gear with the rotor's numbers at the motor."""
    gear = drive.gear if geared else 1.0
    stage = ""
    if geared:
        # the gear's own inertia is counted with the rotor
        stage = f'\n[[stages]]\nname = "output"\nratio = {gear:g}\ninertia_kg_m2 = {1e-4 * drive.rotor:.6g}\n'
    return f"""schema = "gearcase-axis/1"
name = "{name}"

[motor]
inertia_kg_m2 = {drive.rotor / gear**2:.8g}
coulomb_friction_n_m = {drive.dry / gear:.8g}
viscous_friction_n_m_s_per_rad = {drive.viscous / gear**2:.8g}
{stage}
[load]
inertia_kg_m2 = 0.0
"""
