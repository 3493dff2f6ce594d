"""An amplifier or converter driven beyond its range."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.heard import Heard
from sim.mechanisms.mechanism import Measurement, Parameter, Samples, Signature


class Clipping(Measurement):
    """The motor torque and the sound stop at a level: the fraction says how much of their peak is cut off."""

    name: ClassVar[str] = "clipping"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("fraction", "1", 0.0, 0.95, 0.3),)
    size: ClassVar[str] = "fraction"
    signature: ClassVar[Signature] = Signature("recording", grows_with="load")
    equations: ClassVar[str] = "measured = min(max(true, -L), L), L = (1 - fraction) max |true|"
    source: ClassVar[str] = "range of the converter"
    action: ClassVar[str] = (
        "Widen the range of the channel (or lower the gain of the microphone), or accelerate less, and record again; "
        "if it is the drive's own torque limit that is reached, the motion asks too much."
    )
    check: ClassVar[str] = (
        "Repeat the same motion with a wider range or half the acceleration: what happens at the largest torque was "
        "not measured."
    )
    own_hypothesis: ClassVar[bool] = True
    beside_the_chain: ClassVar[bool] = True
    of_the_recording: ClassVar[bool] = True
    checked: ClassVar[tuple[str, str] | None] = ("values cut at their extremes", "none found")
    heard: ClassVar[Heard | None] = Heard(
        "clipping",
        "Record again with the gain lowered and without gaps: what is missing of the sound could be a fault's.",
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return (None, "motor")

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        if "motor_torque_nm" not in telemetry:
            return telemetry
        torque = telemetry["motor_torque_nm"]
        level = (1 - self["fraction"]) * np.abs(torque).max()
        return replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": np.clip(torque, -level, level)})

    def distort_sound(self, samples: Samples, sample_rate_hz: float, seed: int = 0) -> Samples:
        level = np.float32((1 - self["fraction"]) * np.abs(samples).max(initial=0.0))
        return np.clip(samples, -level, level)
