"""A torque channel whose factor changes for some time: a torque constant that falls, a current sensor that drifts."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.mechanism import Measurement, Need, Parameter, Signature
from sim.mechanisms.traits import Traits


class TorqueGain(Measurement):
    """The motor torque is read by another factor between two times."""

    name: ClassVar[str] = "torque_gain"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.5, 0.5, -0.1),
        Parameter("start_s", "s", 0.0, 1e6, 0.5),
        Parameter("end_s", "s", 0.0, 1e6, 8.0),
    )
    size: ClassVar[str] = "share"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.BOTH_DIRECTIONS})
    signature: ClassVar[Signature] = Signature("recording", grows_with="load")
    equations: ClassVar[str] = "measured(t) = (1 + share) true(t) for start <= t < end, else true(t)"
    source: ClassVar[str] = (
        "magnets lose about 0.1 % of their flux per kelvin, and sensors of current drift: Krishnan, Permanent Magnet "
        "Synchronous and Brushless DC Motor Drives, CRC Press 2010"
    )
    sentence: ClassVar[str] = (
        "Between {start_s:.1f} s and {end_s:.1f} s the torque is read by a factor that differs by {share:.1%}."
    )
    action: ClassVar[str] = (
        "Log the phase currents, the voltage of the supply and the temperature of the motor: a torque constant that "
        "falls and a sensor of current that drifts look alike."
    )
    check: ClassVar[str] = (
        "Repeat the same motion with a known weight on the load: a torque that is read by another factor differs by "
        "the same share whatever the weight is."
    )
    own_hypothesis: ClassVar[bool] = True
    of_the_recording: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_share=0.02,  # any part of a record has its own share of what the form of a model leaves
        form_of_any=0.15,
        once=True,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return ("motor",)

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        if "motor_torque_nm" not in telemetry:
            return telemetry
        time_s = telemetry.time_s
        inside = (time_s >= self["start_s"]) & (time_s < self["end_s"])
        torque = telemetry["motor_torque_nm"] * np.where(inside, 1.0 + self["share"], 1.0)
        return replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": torque})
