"""An amplifier or converter driven beyond its range."""

import numpy as np

from sim.mechanisms.mechanism import Array, Measurement, Parameter, Samples, Signature, SoundReport, Traits, only


class Clipping(Measurement):
    """The motor torque and the sound stop at a level: the fraction says how much of their peak is cut off.

    Equations: measured = min(max(true, -L), L), L = (1 - fraction) max |true|
    Source: range of the converter
    """

    name = "clipping"
    parameters = (Parameter("fraction", "1", 0.0, 0.95, 0.3),)
    size = "fraction"
    locations = only(None, "motor")
    signature = Signature("recording")
    action = (
        "Widen the range of the channel (or lower the gain of the microphone), or accelerate less, and record again; "
        "if it is the drive's own torque limit that is reached, the motion asks too much."
    )
    check = (
        "Repeat the same motion with a wider range or half the acceleration: what happens at the largest torque was "
        "not measured."
    )
    checked = ("values cut at their extremes", "none found")
    sound = SoundReport(
        "clipping",
        "Record again with the gain lowered and without gaps: what is missing of the sound could be a fault's.",
    )
    traits = Traits(
        own_hypothesis=True,
        beside_the_chain=True,
        of_the_recording=True,
    )

    def torque(self, time_s: Array, torque: Array) -> Array:
        level = (1 - self["fraction"]) * np.abs(torque).max()
        return np.clip(torque, -level, level)

    def distort_sound(self, samples: Samples, sample_rate_hz: float, seed: int = 0) -> Samples:
        level = np.float32((1 - self["fraction"]) * np.abs(samples).max(initial=0.0))
        return np.clip(samples, -level, level)
