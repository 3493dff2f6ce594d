"""A drawn axis in a drawn motion with its noise: what happens, what sensors read, what the microphone hears."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from benchmarks.hidden_effects.second import sound
from benchmarks.hidden_effects.second.axes import DataSheet, draw_axis
from benchmarks.hidden_effects.second.kernel import Axis, run
from benchmarks.hidden_effects.second.motion import (
    RECORD_S,
    RUN_IN_S,
    STEP_S,
    STEPS_PER_SAMPLE,
    TELEMETRY_RATE_HZ,
    Motion,
    draw_motion,
)

NOISES = ("plain", "burst", "twice", "load")
STEPS_PER_SERVO = 5
MOTOR_ENCODER_STEP = 2 * np.pi / 2**17
LOAD_ENCODER_STEP = 2 * np.pi / 2**20
MOTOR_ENCODER_RMS = 8e-6
LOAD_ENCODER_RMS = 4e-6


@dataclass(frozen=True)
class Recording:
    """Signals (n,) at the telemetry's rate: time [s], angles [rad], motor torque [N m]."""

    time: NDArray[np.float64]
    reference: NDArray[np.float64]
    motor_torque: NDArray[np.float64]
    motor_position: NDArray[np.float64]
    load_position: NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """What happened, free of noise, run-in left out.

    `recording` is what perfect electronics would read, with the load encoder's error; angle [rad] and speeds [rad/s]
    are true; `mesh_torques` (m, 2) [N m] at the driven gears at the sound's rate.
    """

    recording: Recording
    load_angle: NDArray[np.float64]
    motor_speed: NDArray[np.float64]
    load_speed: NDArray[np.float64]
    mesh_torques: NDArray[np.float64]


@dataclass(frozen=True)
class EncoderError:
    """Once per turn of the load: amplitude and phase [rad]."""

    amplitude: float
    phase: float


@dataclass(frozen=True)
class Scene:
    """All that is drawn before an effect is: axis, motion, noise.

    Noise of the motor torque [N m] and of both encoders [rad] at the telemetry's rate, of the microphone at the
    sound's rate; `load_torque` [N m] disturbs the load at every step; `loudness`: rms of the gearbox in good order.
    """

    axis: Axis
    sheet: DataSheet
    motion: Motion = field(repr=False)
    load_torque: NDArray[np.float64] = field(repr=False)
    torque_noise: NDArray[np.float64] = field(repr=False)
    motor_encoder_noise: NDArray[np.float64] = field(repr=False)
    load_encoder_noise: NDArray[np.float64] = field(repr=False)
    encoder_error: EncoderError
    modes: tuple[sound.Mode, ...]
    microphone_noise: NDArray[np.float64] = field(repr=False)
    loudness: float
    bearing_seed: int


def coloured(
    rng: np.random.Generator, samples: int, rate_hz: float, corner_hz: float, rms: float
) -> NDArray[np.float64]:
    """Return first-order noise of a given rms."""
    pole = np.exp(-2 * np.pi * corner_hz / rate_hz)
    white = rng.standard_normal(samples + 20 * int(rate_hz / corner_hz))
    noise = signal.lfilter([1], [1, -pole], white)[-samples:]
    return noise / noise.std() * rms


def _draw_load_torque(rng: np.random.Generator, noise: str, samples: int, ratio: float) -> NDArray[np.float64]:
    if noise != "load":
        return np.zeros(samples * STEPS_PER_SAMPLE)
    torque = coloured(rng, samples, TELEMETRY_RATE_HZ, rng.uniform(1, 3), 0.025 * ratio)
    return np.repeat(torque, STEPS_PER_SAMPLE)


def _draw_torque_noise(rng: np.random.Generator, noise: str, samples: int) -> NDArray[np.float64]:
    torque = coloured(rng, samples, TELEMETRY_RATE_HZ, rng.uniform(4, 30), rng.uniform(0.03, 0.07))
    torque += rng.uniform(0.008, 0.02) * rng.standard_normal(samples)
    if noise == "burst":
        start = int(rng.uniform(0.1, 0.7) * samples)
        torque[start : start + samples // 5] *= rng.uniform(2.5, 4)
    return torque * 2 if noise == "twice" else torque


def draw_scene(seed: tuple[int, ...], motion_kind: str, noise: str = "plain") -> Scene:
    """Draw a scene with a motion of MOTIONS and a noise of NOISES."""
    rng = np.random.default_rng(seed)
    axis, sheet = draw_axis(rng)
    motion = draw_motion(rng, sheet.ratio, motion_kind)
    whole_inertia = axis.motor_inertia + axis.load_inertia / sheet.ratio**2
    samples, heard = int(RECORD_S * TELEMETRY_RATE_HZ), int(RECORD_S * sound.SOUND_RATE_HZ)
    return Scene(
        axis=axis._replace(torque_limit=3 * (whole_inertia * np.abs(motion.acceleration).max() + 2.0)),
        sheet=sheet,
        motion=motion,
        load_torque=_draw_load_torque(rng, noise, len(motion.position) // STEPS_PER_SAMPLE, sheet.ratio),
        torque_noise=_draw_torque_noise(rng, noise, samples),
        motor_encoder_noise=MOTOR_ENCODER_RMS * rng.standard_normal(samples),
        load_encoder_noise=LOAD_ENCODER_RMS * rng.standard_normal(samples),
        encoder_error=_draw_encoder_error(rng, sheet),
        modes=sound.draw_modes(rng),
        microphone_noise=_draw_microphone_noise(rng, heard),
        loudness=rng.uniform(0.006, 0.011),
        bearing_seed=int(rng.integers(1 << 31)),
    )


def _draw_encoder_error(rng: np.random.Generator, sheet: DataSheet) -> EncoderError:
    phase = rng.uniform(0, 2 * np.pi)
    return EncoderError(sheet.encoder_error * rng.uniform(0.3, 1.0), phase)


def _draw_microphone_noise(rng: np.random.Generator, samples: int) -> NDArray[np.float64]:
    white = 0.0035 * rng.uniform(0.7, 1.5) * rng.standard_normal(samples)
    return white + coloured(rng, samples, sound.SOUND_RATE_HZ, 60, 0.002)


def simulate(scene: Scene, axis: Axis, encoder_error: EncoderError | None = None) -> Run:
    """Run the scene's motion with an axis; `encoder_error` stands in for the load encoder's own."""
    motion, error = scene.motion, encoder_error or scene.encoder_error
    signals, mesh_torques = run(
        axis,
        motion.position,
        motion.speed,
        motion.acceleration,
        scene.load_torque,
        STEP_S,
        STEPS_PER_SAMPLE,
        STEPS_PER_SERVO,
        -RUN_IN_S,
    )
    first = int(RUN_IN_S * TELEMETRY_RATE_HZ)
    torque, motor_angle, load_angle, motor_speed, load_speed = np.ascontiguousarray(signals[first:].T)
    recording = Recording(
        time=np.arange(len(torque)) / TELEMETRY_RATE_HZ,
        reference=motion.position[::STEPS_PER_SAMPLE][first : first + len(torque)],
        motor_torque=torque,
        motor_position=motor_angle,
        load_position=load_angle + error.amplitude * np.sin(load_angle + error.phase),
    )
    return Run(recording, load_angle, motor_speed, load_speed, mesh_torques[int(RUN_IN_S * sound.SOUND_RATE_HZ) :])


def measure(scene: Scene, recording: Recording, torque_limit: float = np.inf) -> Recording:
    """Return what is recorded: with noise, torque cut at a limit [N m], encoders in steps."""
    motor = recording.motor_position + scene.motor_encoder_noise
    load = recording.load_position + scene.load_encoder_noise
    return Recording(
        recording.time,
        recording.reference,
        np.clip(recording.motor_torque + scene.torque_noise, -torque_limit, torque_limit),
        np.round(motor / MOTOR_ENCODER_STEP) * MOTOR_ENCODER_STEP,
        np.round(load / LOAD_ENCODER_STEP) * LOAD_ENCODER_STEP,
    )


def hear_meshes(scene: Scene, run: Run) -> NDArray[np.float64]:
    """Return the sound of the meshes, not yet scaled."""
    return sound.of_meshes(scene.modes, run.mesh_torques, scene.axis.output.ratio, scene.sheet.ratio)


def hear_bearing(scene: Scene, run: Run, bearing: sound.Bearing) -> NDArray[np.float64]:
    """Return the sound of a bearing's defect."""
    time = np.arange(len(run.mesh_torques)) / sound.SOUND_RATE_HZ
    angle = np.interp(time, run.recording.time, run.recording.motor_position)
    speed = np.interp(time, run.recording.time, run.motor_speed)
    return sound.of_bearing(np.random.default_rng(scene.bearing_seed), scene.modes, bearing, angle, speed)
