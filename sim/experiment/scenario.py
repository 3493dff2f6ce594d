"""One recording that never was: a specimen of an axis, moved back and forth by its servo, heard by a microphone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, hear, microphone_of
from sim.description.axis import Axis, Motion
from sim.description.axis_document import read_axis
from sim.errors import RunError
from sim.experiment.specimen import Specimen
from sim.mechanisms.catalogue import distort_sound
from sim.torsional.integrate import run_chain
from sim.torsional.model import Array, Chain, ChainResult, Servo
from sim.torsional.motion_profile import back_and_forth

MODEL_VERSION = "2"  # raise when the same scenario would sound otherwise
SPEED_BANDWIDTH_RAD_S = 80.0
POSITION_GAIN_PER_S = 15.0
INTEGRAL_TIME_S = 0.1
UNLIMITED = 1e9
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

    def simulate(self) -> ChainResult:
        """The run behind the sound; it begins `SETTLING_S` earlier.

        Raises RunError where the run left all bounds, and what the parts raise.
        """
        chain = self.specimen.chain(self.axis, self.payload_kg_m2)
        motion = self.motion()
        servo = servo_of(self.axis, chain, motion)
        run = run_chain(chain, servo, SAMPLE_RATE_HZ, motion.shape[1])
        if not np.isfinite(run.force_n_m).all():
            raise RunError(
                f"axis {self.axis.name!r} left all bounds under its servo; lower servo.speed_bandwidth_rad_s"
            )
        return run

    def motion(self, rate_hz: float = SAMPLE_RATE_HZ) -> Array:
        """Angle [rad], speed [rad/s] and acceleration [rad/s2] that the output is to have, shape (3, n)."""
        wanted = self.axis.motion
        position, speed, acceleration = back_and_forth(
            np.arange(round((SETTLING_S + self.duration_s) * rate_hz)) / rate_hz + self.start_phase * wanted.period_s,
            wanted.period_s,
            wanted.load_speed_rad_s,
            wanted.acceleration_time_s,
            wanted.dwell_s,
        )
        return np.stack([position - travel_rad(wanted) / 2 + self.middle_rad, speed, acceleration])

    def hear(self, run: ChainResult) -> NDArray[np.float32]:
        """What the scenario's microphone hears of a run, shape (n,), and what its recorder makes of that."""
        at_output = np.array([self.axis.ratio_from(stage.name) for stage in self.axis.stages])
        meshes = len(at_output)  # behind the output, more may hang on a spring
        torque, speed = run.force_n_m[:, :meshes] * at_output, run.speed_rad_s[:, meshes]
        sound = hear(torque, speed, SAMPLE_RATE_HZ, self.microphone, self.noise_seed)
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


def servo_of(axis: Axis, chain: Chain, motion: Array) -> Servo:
    """The servo of an axis with the motor's reference: angle [rad], speed [rad/s], feed-forward torque [N m]."""
    reflected = [1.0, *np.cumprod([link.ratio for link in chain.links])]
    inertia = sum(shaft.inertia_kg_m2 / ratio**2 for shaft, ratio in zip(chain.shafts, reflected, strict=True))
    bandwidth = axis.servo.speed_bandwidth_rad_s or SPEED_BANDWIDTH_RAD_S
    return Servo(
        reference=motion * axis.ratio * np.array([[1.0], [1.0], [inertia]]),
        position_gain_per_s=axis.servo.position_gain_per_s or POSITION_GAIN_PER_S,
        speed_gain_n_m_s=inertia * bandwidth,
        integral_time_s=axis.servo.integral_time_s or INTEGRAL_TIME_S,
        speed_limit_rad_s=min(axis.motor.speed_limit_rad_s, UNLIMITED),
        torque_limit_n_m=min(axis.motor.torque_limit_n_m, UNLIMITED),
    )


def travel_rad(motion: Motion) -> float:
    """From one end of a motion to the other."""
    return motion.load_speed_rad_s * (motion.period_s / 2 - motion.dwell_s - motion.acceleration_time_s)


def with_motion(axis: Axis, **changes: float) -> Axis:
    """The axis with another motion."""
    return replace(axis, motion=replace(axis.motion, **changes))
