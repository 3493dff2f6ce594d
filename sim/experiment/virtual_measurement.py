"""A simulated measurement: an axis moves back and forth, a recorder takes its telemetry and a microphone its sound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals.telemetry import Telemetry
from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, Mode, hear
from sim.assembly import drive_train_of
from sim.chain.model import Array
from sim.chain.motion_profile import moving
from sim.description.axis import Axis
from sim.mechanisms.catalogue import distort_sound, distort_telemetry
from sim.mechanisms.locations import with_error
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import Trajectory

TELEMETRY_RATE_HZ = 2000.0
LEVEL_OF_16_BIT = 2.0**-15
BEARING = "_bearing.tau"  # of a shaft
STANDING_S = 0.5  # heard before the run begins, so that no microphone is switched on with it

DEFAULT_MICROPHONE = Microphone(
    modes=(Mode(95.0, 0.05, 1.0), Mode(315.0, 0.03, 0.6), Mode(760.0, 0.02, 0.5), Mode(1650.0, 0.02, 0.4)),
    gain=2e-3,
    rubbing_n_m=2.0,
    ambient_n_m=0.5,
)
"""A housing with four modes, near enough that rubbing stands above a quiet hall."""


@dataclass(frozen=True)
class Measurement:
    """What a run gives: the whole trajectory at 8 kHz, telemetry at 2 kHz, sound at 8 kHz in full scales."""

    trajectory: Trajectory
    telemetry: Telemetry
    sound: NDArray[np.float32]


def built(axis: Axis) -> DriveTrain:
    """The drive train of an axis with its servo, its mechanisms, and the transmission error it has as new."""
    train = drive_train_of(axis)
    for stage in axis.stages:
        if stage.transmission_error_rad and stage.driven_teeth:
            train = with_error(train, stage.name, float(stage.driven_teeth), stage.transmission_error_rad, 0.0)
    return moving(train, axis)


def measure(
    axis: Axis,
    duration_s: float,
    seed: int = 0,
    microphone: Microphone = DEFAULT_MICROPHONE,
    watch: Array | None = None,
) -> Measurement:
    """Simulate an axis along its `motion` and measure it; the same seed gives the same bytes.

    Raises SimulationError for an axis or a duration that cannot be, RunError where the motion left all bounds.
    """
    trajectory = moved(axis, duration_s, watch)
    return Measurement(trajectory, recorded(trajectory, axis, seed), heard(trajectory, axis, seed, microphone))


def moved(axis: Axis, duration_s: float, watch: Array | None = None) -> Trajectory:
    """The motion of an axis along its `motion`, at 8 kHz; raises as `measure` does."""
    from sim.solver import simulate  # engines are slow to import

    return simulate(built(axis), duration_s, SAMPLE_RATE_HZ, watch=watch)


def recorded(trajectory: Trajectory, axis: Axis, seed: int = 0) -> Telemetry:
    """What the recorder takes of a motion, at 2 kHz, with the faults of the measurement."""
    return distort_telemetry(telemetry_of(trajectory, axis), axis, seed)


def heard(
    trajectory: Trajectory, axis: Axis, seed: int = 0, microphone: Microphone = DEFAULT_MICROPHONE
) -> NDArray[np.float32]:
    """What the microphone takes of a motion in full scales, at 8 kHz, with the faults of the measurement."""
    sound = distort_sound(sound_of(trajectory, axis, microphone, seed), SAMPLE_RATE_HZ, axis, seed)
    return np.asarray(np.clip(sound, -1.0, 1.0 - LEVEL_OF_16_BIT), np.float32)


def telemetry_of(trajectory: Trajectory, axis: Axis) -> Telemetry:
    """The channels that a drive records, at 2 kHz, as they are; `shaft_torque_nm` is that on the load."""
    every = round(trajectory.sample_rate_hz / TELEMETRY_RATE_HZ)
    end = "load" if "load.phi" in trajectory.channels else "motor"
    sources = {
        "reference_position_rad": "drive.reference",
        "motor_torque_nm": "drive.tau",
        "motor_position_rad": "motor.phi",
        "motor_speed_rad_s": "motor.w",
        "load_position_rad": f"{end}.phi",
        "load_speed_rad_s": f"{end}.w",
    }
    channels = {name: trajectory[source][::every] for name, source in sources.items()}
    last = axis.stages[-1].name if axis.stages else "coupling"
    if f"{last}.tau" in trajectory.channels:
        channels["shaft_torque_nm"] = -trajectory[f"{last}.tau"][::every]
    return Telemetry(time_s=trajectory.time_s[::every], channels=channels)


def sound_of(trajectory: Trajectory, axis: Axis, microphone: Microphone, seed: int) -> NDArray[np.float32]:
    """What the microphone hears of the meshes and bearings of a trajectory."""
    before = round(STANDING_S * trajectory.sample_rate_hz)
    forces, speed = heard_forces(trajectory, axis, before)
    return hear(forces, speed, trajectory.sample_rate_hz, microphone, seed)[before:]


def heard_forces(trajectory: Trajectory, axis: Axis, before: int = 0) -> tuple[Array, Array]:
    """Torques of meshes and bearings felt at the output [N m], shape (n, sources), and its speed [rad/s].

    `before`: samples of standstill that are put in front.
    """
    factors = {f"{stage.name}.tau": -axis.ratio_from(stage.name) for stage in axis.stages}
    bearings = (name for name in trajectory.channels if name.endswith(BEARING))
    factors |= {name: axis.ratio_from(name.removesuffix(BEARING)) for name in bearings}
    forces = np.zeros((before + len(trajectory.time_s), max(len(factors), 1)))
    for column, (name, factor) in zip(forces.T, factors.items(), strict=False):
        np.multiply(trajectory[name], factor, out=column[before:])
        column[:before] = column[before]
    end = "load.w" if "load.w" in trajectory.channels else "motor.w"
    return forces, np.pad(trajectory[end], (before, 0))
