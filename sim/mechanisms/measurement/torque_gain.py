"""A torque channel whose factor changes for some time: a torque constant that falls, a current sensor that drifts."""

import numpy as np

from sim.mechanisms.mechanism import Array, Measurement, Need, Parameter, Signature, Traits, only


class TorqueGain(Measurement):
    """The motor torque is read by another factor between two times.

    Equations: measured(t) = (1 + share) true(t) for start <= t < end, else true(t)
    Source: magnets lose about 0.1 % of their flux per kelvin, and sensors of current drift: Krishnan, Permanent
    Magnet Synchronous and Brushless DC Motor Drives, CRC Press 2010
    """

    name = "torque_gain"
    parameters = (
        Parameter("share", "1", -0.5, 0.5, -0.1),
        Parameter("start_s", "s", 0.0, 1e6, 0.5),
        Parameter("end_s", "s", 0.0, 1e6, 8.0),
    )
    size = "share"
    locations = only("motor")
    shown_by = frozenset({Need.BOTH_DIRECTIONS})
    signature = Signature("recording")
    sentence = "Between {start_s:.1f} s and {end_s:.1f} s the torque is read by a factor that differs by {share:.1%}."
    action = (
        "Log the phase currents, the voltage of the supply and the temperature of the motor: a torque constant that "
        "falls and a sensor of current that drifts look alike."
    )
    check = (
        "Repeat the same motion with a known weight on the load: a torque that is read by another factor differs by "
        "the same share whatever the weight is."
    )
    traits = Traits(
        own_hypothesis=True,
        of_the_recording=True,
        least_share=0.02,  # any part of a record has its own share of what the form of a model leaves
        form_of_any=0.15,
        once=True,
    )

    def torque(self, time_s: Array, torque: Array) -> Array:
        inside = (time_s >= self["start_s"]) & (time_s < self["end_s"])
        return np.asarray(torque * np.where(inside, 1.0 + self["share"], 1.0))
