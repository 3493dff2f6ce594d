"""One recording that never was: a specimen of an axis, moved back and forth by its servo, heard by a microphone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.axis import Axis, Motion
from sim.chain_model import Chain, ChainResult, Servo
from sim.chain_run import run_chain
from sim.errors import RunError
from sim.sound import SAMPLE_RATE_HZ, Microphone, hear
from sim.specimen import Specimen

Array = NDArray[np.float64]
SPEED_BANDWIDTH_RAD_S = 80.0
POSITION_GAIN_PER_S = 15.0
INTEGRAL_TIME_S = 0.1
UNLIMITED = 1e9
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

    def perform(self) -> tuple[NDArray[np.float32], ChainResult]:
        """The sound, shape (n,) at 8 kHz, and the run behind it, which begins `SETTLING_S` earlier.

        Raises RunError where the run left all bounds, and what the parts raise.
        """
        chain = self.specimen.chain(self.axis, self.payload_kg_m2)
        lead = round(SETTLING_S * SAMPLE_RATE_HZ)
        samples = lead + round(self.duration_s * SAMPLE_RATE_HZ)
        servo = servo_of(self.axis, chain, samples, self.start_phase, self.middle_rad)
        run = run_chain(chain, servo, SAMPLE_RATE_HZ, samples)
        if not np.isfinite(run.force_n_m).all():
            raise RunError(
                f"axis {self.axis.name!r} left all bounds under its servo; lower servo.speed_bandwidth_rad_s"
            )
        at_output = np.array([self.axis.ratio_from(stage.name) for stage in self.axis.stages])
        sound = hear(
            run.force_n_m * at_output, run.speed_rad_s[:, -1], SAMPLE_RATE_HZ, self.microphone, self.noise_seed
        )
        return sound[lead:], run


def servo_of(axis: Axis, chain: Chain, samples: int, start_phase: float, middle_rad: float) -> Servo:
    """The servo of an axis with the motor's reference: angle [rad], speed [rad/s], feed-forward torque [N m]."""
    position, speed, acceleration = back_and_forth(axis.motion, samples, start_phase)
    reflected = [1.0, *np.cumprod([link.ratio for link in chain.links])]
    inertia = sum(shaft.inertia_kg_m2 / ratio**2 for shaft, ratio in zip(chain.shafts, reflected, strict=True))
    bandwidth = axis.servo.speed_bandwidth_rad_s or SPEED_BANDWIDTH_RAD_S
    return Servo(
        reference=np.stack(
            [(position + middle_rad) * axis.ratio, speed * axis.ratio, acceleration * axis.ratio * inertia]
        ),
        position_gain_per_s=axis.servo.position_gain_per_s or POSITION_GAIN_PER_S,
        speed_gain_n_m_s=inertia * bandwidth,
        integral_time_s=axis.servo.integral_time_s or INTEGRAL_TIME_S,
        speed_limit_rad_s=min(axis.motor.speed_limit_rad_s, UNLIMITED),
        torque_limit_n_m=min(axis.motor.torque_limit_n_m, UNLIMITED),
    )


def back_and_forth(motion: Motion, samples: int, start_phase: float = 0.0) -> tuple[Array, Array, Array]:
    """Angle [rad], speed [rad/s] and acceleration [rad/s2] of the output at 8 kHz, each of shape (samples,).

    Speed rises and falls as a half cosine over the acceleration time; the mean angle of a cycle is 0.
    """
    rate = SAMPLE_RATE_HZ
    half = motion.period_s / 2
    moving = half - motion.dwell_s
    phase = (np.arange(samples) / rate + start_phase * motion.period_s) % motion.period_s
    way = np.where(phase < half, 1.0, -1.0)
    into = phase % half
    rise = np.clip(np.minimum(into, moving - into) / motion.acceleration_time_s, 0.0, 1.0)
    speed = way * motion.load_speed_rad_s * 0.5 * (1 - np.cos(math.pi * rise))
    braking = np.where(into > moving / 2, -1.0, 1.0)
    slope = 0.5 * math.pi / motion.acceleration_time_s * np.sin(math.pi * rise)
    acceleration = way * braking * motion.load_speed_rad_s * slope
    travel = motion.load_speed_rad_s * (moving - motion.acceleration_time_s)
    return _angle(into, rise, motion, moving, travel, way), speed, acceleration


def _angle(into: Array, rise: Array, motion: Motion, moving: float, travel: float, way: Array) -> Array:
    """Integral of the speed in closed form: no drift however long the run."""
    ramp = motion.acceleration_time_s
    gone = np.where(into > moving / 2, moving - into, into)
    gone = np.maximum(gone, 0.0)
    within = 0.5 * (gone - ramp / math.pi * np.sin(math.pi * rise))
    covered = motion.load_speed_rad_s * np.where(gone < ramp, within, 0.5 * ramp + gone - ramp)
    covered = np.where(into > moving / 2, travel - covered, covered)
    return way * (covered - travel / 2)


def with_motion(axis: Axis, **changes: float) -> Axis:
    """The axis with another motion."""
    return replace(axis, motion=replace(axis.motion, **changes))
