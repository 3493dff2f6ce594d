"""One recording that never was: a specimen of an axis, moved back and forth by its servo, heard by a microphone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, hear, microphone_of
from sim.chain.motion_profile import Array, servo_drive
from sim.description.axis import Axis, Motion
from sim.description.axis_document import read_axis
from sim.experiment.specimen import Specimen
from sim.experiment.virtual_measurement import heard_forces
from sim.mechanisms.catalogue import distort_sound
from sim.rotational.trajectory import Trajectory

MODEL_VERSION = "3"  # raise when the same scenario would sound otherwise
SPEED_BANDWIDTH_RAD_S = 80.0
POSITION_GAIN_PER_S = 15.0
INTEGRAL_TIME_S = 0.1
LOUDEST = 0.5  # of full scale: 6 dB of head-room, as usual for sound whose loudest moment is not known beforehand
SETTLING_S = 0.5  # simulated before the recording begins: no microphone is switched on together with the axis


@dataclass(frozen=True)
class Scenario:
    """Everything that determines one simulated recording; equal scenarios give equal samples.

    Parameters
    ----------
    axis
        With its motion and servo; its mechanisms are the faults.
    start_phase
        Where in the cycle of back and forth the recording begins, 0 to 1.
    middle_rad
        Angle of the output midway between the two ends of the motion.
    noise_seed
        Of rubbing and ambient noise.
    """

    axis: Axis
    payload_kg_m2: float
    specimen: Specimen
    microphone: Microphone
    duration_s: float
    start_phase: float = 0.0
    middle_rad: float = 0.0
    noise_seed: int = 0

    def to_mapping(self) -> dict[str, object]:
        """As nested dicts and lists (JSON), complete: `scenario_of` reads it back."""
        return {
            "axis": self.axis.to_mapping(),
            "payload_kg_m2": self.payload_kg_m2,
            "specimen": asdict(self.specimen),
            "microphone": asdict(self.microphone),
            "duration_s": self.duration_s,
            "start_phase": self.start_phase,
            "middle_rad": self.middle_rad,
            "noise_seed": self.noise_seed,
        }

    def perform(self) -> NDArray[np.float32]:
        """The sound, shape (n,) at 8 kHz. Raises what `simulate` raises."""
        return self.hear(self.simulate())

    def simulate(self) -> Trajectory:
        """The run behind the sound; it begins `SETTLING_S` earlier. Raises what the parts raise."""
        from sim.solver import simulate  # engines are slow to import

        built = self.specimen.built(self.axis, self.payload_kg_m2)
        servo = replace(
            built.servo,
            speed_bandwidth_rad_s=built.servo.speed_bandwidth_rad_s or SPEED_BANDWIDTH_RAD_S,
            position_gain_per_s=built.servo.position_gain_per_s or POSITION_GAIN_PER_S,
            integral_time_s=built.servo.integral_time_s or INTEGRAL_TIME_S,
        )
        motion = self.axis.motion
        drive = replace(
            servo_drive(replace(built, servo=servo)),
            begin=self.start_phase * motion.period_s,
            offset=(self.middle_rad - travel_rad(motion) / 2) * self.axis.ratio,
        )
        train = self.specimen.train(built).add("drive", drive, flange="motor.flange_a")
        samples = round((SETTLING_S + self.duration_s) * SAMPLE_RATE_HZ)
        return simulate(train, (samples - 1) / SAMPLE_RATE_HZ, SAMPLE_RATE_HZ)

    def hear(self, run: Trajectory) -> NDArray[np.float32]:
        """What the scenario's microphone hears of a run, shape (n,), and what its recorder makes of that."""
        return self.hear_forces(*heard_forces(run, self.axis))

    def hear_forces(self, forces_n_m: Array, speed_rad_s: Array) -> NDArray[np.float32]:
        """What it hears of torques felt at the output, shape (n, sources), and of the output's speed, shape (n,)."""
        sound = hear(forces_n_m, speed_rad_s, SAMPLE_RATE_HZ, self.microphone, self.noise_seed)
        sound = sound[round(SETTLING_S * SAMPLE_RATE_HZ) :]
        return distort_sound(sound, SAMPLE_RATE_HZ, self.axis, self.noise_seed)

    def with_head_room(self, sound: NDArray[np.float32]) -> tuple[Scenario, NDArray[np.float32]]:
        """The scenario and its sound at the gain that a recordist sets: the loudest moment at most `LOUDEST`."""
        factor = LOUDEST / max(float(np.abs(sound).max(initial=0.0)), LOUDEST)
        microphone = replace(self.microphone, gain=self.microphone.gain * factor)
        return replace(self, microphone=microphone), sound * np.float32(factor)


def scenario_of(document: Mapping[str, Any]) -> Scenario:
    """Read a scenario back from its mapping. Raises SimulationError where it is wrong."""
    rest = {name: document[name] for name in ("payload_kg_m2", "duration_s", "start_phase", "middle_rad", "noise_seed")}
    return Scenario(
        axis=read_axis(document["axis"]),
        specimen=Specimen(**document["specimen"]),
        microphone=microphone_of(document["microphone"]),
        **rest,
    )


def travel_rad(motion: Motion) -> float:
    """From one end of a motion to the other."""
    return motion.load_speed_rad_s * (motion.period_s / 2 - motion.dwell_s - motion.acceleration_time_s)


def with_motion(axis: Axis, **changes: float) -> Axis:
    """The axis with another motion."""
    return replace(axis, motion=replace(axis.motion, **changes))
