"""Two sounds of one joint, made on different days: in good order, and now, when something may have gone wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden_effects.generator import microphone as mic
from benchmarks.hidden_effects.generator.effect import Effect
from benchmarks.hidden_effects.generator.joint import Joint
from benchmarks.hidden_effects.generator.kernel import SERVO_RATE_HZ
from benchmarks.hidden_effects.generator.motion import SETTLE_S, Motion, draw_motion
from benchmarks.hidden_effects.generator.noise import draw_noise
from benchmarks.hidden_effects.generator.plant import Plant, Run, build_plant, simulate
from benchmarks.hidden_effects.generator.recording import Placed, mesh_orders

GROWN = 10.0
"""Full size of a mesh error, in errors of the same gear as new."""
HARMLESS = ("quieter workshop", "heavier payload", "other gain")


@dataclass(frozen=True)
class Day:
    """What differs between recordings of a joint in good order.

    `payload`: inertia of the load, and `pace`: speed of the program, over those of the joint; `rolling`: rms of the
    rolling noise, and `whine` (stages, 3): amplitudes of the mesh lines, both at top speed.
    """

    microphone: mic.Microphone
    payload: float
    pace: float
    rolling: float
    whine: NDArray[np.float64]


@dataclass(frozen=True)
class Recorded:
    """A sound (m,) within -1 to 1 at the sound's rate, and the motor's angle (n,) [rad] at the telemetry's."""

    sound: NDArray[np.float64]
    motor_angle: NDArray[np.float64]


def _either_way(rng: np.random.Generator, low: float, high: float, size: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Draw factors between `low` and `high` decibels, up or down."""
    return np.asarray(10 ** (rng.choice([-1, 1], size) * rng.uniform(low, high, size) / 20))


def first_day(rng: np.random.Generator, joint: Joint) -> Day:
    """Draw the day of the recording in good order."""
    microphone = replace(mic.draw_microphone(rng), fan=float(rng.choice([0.0, 0.3])))
    levels = np.array([level for _, level in mic.WHINE])
    return Day(microphone, 1.0, 1.0, 0.5, levels * rng.uniform(0.3, 1.0, (len(joint.stages), len(levels))))


def another_day(rng: np.random.Generator, day: Day, harmless: str | None = None) -> Day:
    """Draw a later day; `harmless` (one of HARMLESS) is a difference larger than usual."""
    old = day.microphone
    gains = _either_way(rng, 1, 2, (len(old.modes) + 1,))
    quiet = 10 ** (-rng.uniform(10, 20) / 20) if harmless == "quieter workshop" else _either_way(rng, 1, 4)
    gain = _either_way(rng, 10, 20) if harmless == "other gain" else _either_way(rng, 2, 10)
    microphone = replace(
        old,
        modes=old.modes * np.column_stack([np.ones((len(old.modes), 2)), gains[1:]]),
        direct=float(old.direct * gains[0]),
        noise_ratio=float(old.noise_ratio * quiet),
        noise_corner_hz=float(old.noise_corner_hz * rng.uniform(0.8, 1.25)),
        fan_hz=float(rng.uniform(80, 140)),
        fan=float(rng.choice([0.0, 0.3])),
        loudness=float(old.loudness * gain),
    )
    payload = rng.uniform(1.2, 1.5) if harmless == "heavier payload" else 1 + rng.uniform(-0.05, 0.05)
    return Day(
        microphone,
        float(day.payload * payload),
        float(day.pace * rng.uniform(0.98, 1.02)),
        float(day.rolling * _either_way(rng, 1, 3)),
        day.whine * _either_way(rng, 1, 2, day.whine.shape),
    )


def _draw_program(rng: np.random.Generator, joint: Joint, seconds: float) -> NDArray[np.float64]:
    """Draw a motion that repeats itself: a course (3, n) like that of `Motion`, from a rest to another and back."""
    course = draw_motion(rng, joint.top_speed, seconds / 2).course
    rests = np.flatnonzero(course[1] == 0)
    there = course[:, rests[0] : rests[-1] + 1]
    return np.concatenate([there, there[:, ::-1] * np.array([[1], [-1], [1]])], axis=1)


def _excerpt(rng: np.random.Generator, program: NDArray[np.float64], pace: float, seconds: float) -> Motion:
    """Return the program as repeated on a day, from anywhere in it."""
    length = program.shape[1]
    place = rng.uniform(0, length) + pace * np.arange(round((SETTLE_S + seconds + 1) * SERVO_RATE_HZ))
    course = np.array([np.interp(place, np.arange(length), row, period=length) for row in program])
    course *= pace ** np.arange(3)[:, None]
    return Motion(course, float(program[0].min()), float(program[0].max()))


def _run(
    rng: np.random.Generator,
    joint: Joint,
    day: Day,
    program: NDArray[np.float64],
    seconds: float,
    placed: list[Placed],
    inside: int,
) -> Run:
    """Simulate a day; its force is over the joint's largest torque with the usual payload."""
    loaded = replace(joint, load_inertia=joint.load_inertia * day.payload)
    plant = build_plant(np.random.default_rng(inside), loaded)
    for one in placed:
        plant = one.effect.act(plant, one.amplitude)
    load_torque = draw_noise(rng, joint, "stationary", seconds, np.empty(0)).load_torque
    run = simulate(plant, _excerpt(rng, program, day.pace, seconds), seconds, disturbance=load_torque)
    return replace(run, force=run.force * np.float32(day.payload))


def _lines(rng: np.random.Generator, joint: Joint, day: Day, placed: list[Placed]) -> list[mic.Whine]:
    """Return the tooth whine of a day: where a gear's teeth err more, its lines grow and get weak sidebands."""
    lines = []
    for stage, order, amplitudes in zip(joint.stages, mesh_orders(joint), day.whine, strict=True):
        grown = next((p.amplitude for p in placed if p.effect.scored_location == stage.name), 1.0)
        for (harmonic, _), amplitude in zip(mic.WHINE, amplitudes, strict=True):
            middle, side = harmonic * order, order / stage.driven_teeth
            lines.append(mic.Whine(middle, grown * float(amplitude), float(rng.uniform(0, 2 * np.pi))))
            if grown > 1.0:
                weak, phases = float(grown * amplitude * rng.uniform(0.05, 0.15)), rng.uniform(0, 2 * np.pi, 2)
                lines += [mic.Whine(middle - side, weak, phases[0]), mic.Whine(middle + side, weak, phases[1])]
    return lines


def _running(
    rng: np.random.Generator, joint: Joint, day: Day, motor_angle: NDArray[np.float64], placed: list[Placed]
) -> NDArray[np.float64]:
    """Return how whine and rolling noise of a day excite the housing, not yet scaled."""
    angle = mic.fine_angle(motor_angle)
    rolling = day.rolling * rng.standard_normal(len(angle))
    top_speed = joint.top_speed * joint.ratio / mic.SOUND_RATE_HZ
    return mic.excited_by(angle, top_speed, rolling, _lines(rng, joint, day, placed))


def _recorded(
    rng: np.random.Generator, day: Day, run: Run, excitation: NDArray[np.float64], placed: list[Placed]
) -> Recorded:
    """Return what a microphone on the housing hears, with the workshop and, where something is loose, its mode."""
    own = mic.through_housing(day.microphone, excitation)
    heard = own + day.microphone.noise_ratio * mic.background(rng, day.microphone, len(own))
    for one in placed:
        if one.effect.where == "sound mode":
            frequency, damping = one.effect.detail
            loose = mic.through_mode(frequency, damping, 1.0, excitation)
            heard += one.amplitude * np.std(own) / np.std(loose) * loose
    heard *= day.microphone.loudness
    return Recorded(heard * min(1.0, 0.9 / np.max(np.abs(heard))), run.motor_angle)


def compare(
    rng: np.random.Generator, joint: Joint, effects: tuple[str, ...], level: float, seconds: float
) -> tuple[Recorded, Recorded, list[Placed]]:
    """Return the sound of a joint in good order, that of a later day, and what had gone wrong by then.

    With no effects the later day is as good; every third time it has one of HARMLESS.
    """
    first = first_day(rng, joint)
    placed = [_place(rng, name, joint, first.microphone, level) for name in effects]
    harmless = str(rng.choice(HARMLESS)) if not placed and rng.random() < 1 / 3 else None
    later = another_day(rng, first, harmless)
    program, inside = _draw_program(rng, joint, seconds), int(rng.integers(2**32))
    pair: list[tuple[Day, list[Placed]]] = [(first, []), (later, placed)]
    runs = [_run(rng, joint, day, program, seconds, ill, inside) for day, ill in pair]
    shaken = [mic.shaken_by(run.force) for run in runs]
    running = [_running(rng, joint, day, run.motor_angle, ill) for (day, ill), run in zip(pair, runs, strict=True)]
    # one scale for both days, so that what has grown is louder
    shaking = first.microphone.shaking / np.max(np.abs(mic.through_housing(first.microphone, shaken[0])))
    rolling = 1 / np.std(mic.through_housing(first.microphone, running[0]))
    as_new, now = (
        _recorded(rng, day, run, shaking * force + rolling * source, ill)
        for (day, ill), run, force, source in zip(pair, runs, shaken, running, strict=True)
    )
    return as_new, now, placed


def _place(rng: np.random.Generator, name: str, joint: Joint, microphone: mic.Microphone, level: float) -> Placed:
    """Draw place and shape of an effect and give it its size."""
    if name == "mesh_error":
        stage = str(rng.choice([stage.name for stage in joint.stages]))
        effect = Effect(name, stage, 1.0, scored_location=stage, act=lambda plant, a: _worn(plant, stage, a))
        return Placed(effect, GROWN * level, level)
    if name == "structural_resonance":
        frequency = 0.0
        while not frequency or np.min(np.abs(microphone.modes[:, 0] / frequency - 1)) < 0.12:
            frequency = float(rng.uniform(250, 3000))
        detail = (frequency, float(rng.uniform(0.004, 0.03)))
        effect = Effect(name, None, 1.0, where="sound mode", size=lambda a: {"frequency_hz": frequency}, detail=detail)
        return Placed(effect, level, level)
    raise ValueError(f"only mesh_error and structural_resonance are heard by comparison, got {name}")


def _worn(plant: Plant, name: str, factor: float) -> Plant:
    """Return the plant with the errors of a driven gear multiplied, as far as they recur with every tooth."""
    place = [stage.name for stage in plant.joint.stages].index(name)
    teeth = plant.joint.stages[place].driven_teeth
    driven = plant.meshes[place].driven
    return plant.with_mesh(
        name, driven=tuple(replace(x, amplitude=x.amplitude * factor) if x.order >= teeth else x for x in driven)
    )
