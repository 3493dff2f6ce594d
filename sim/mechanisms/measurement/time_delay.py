"""Channels that were not sampled at the same time."""

from dataclasses import replace

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.mechanism import Measurement, Need, Parameter, Signature, Traits, only


class TimeDelay(Measurement):
    """The channels of one shaft come late.

    Equations: measured(t) = true(t - delay)
    Source: buffers between drive and recorder
    """

    name = "time_delay"
    parameters = (Parameter("delay_s", "s", -1.0, 1.0, 2e-3),)
    size = "delay_s"
    locations = only("load", "motor")
    shown_by = frozenset({Need.SEVERAL_SPEEDS})
    signature = Signature("recording")
    sentence = "One channel is {delay_s:.3g} s later than the others."
    action = (
        "Check that all channels are sampled on one clock: filters, bus cycles and time stamps of the late channel; "
        "nothing is wrong with the machine."
    )
    check = (
        "Log one sharp step of torque with all channels at the full rate: a late channel lags by the same time at "
        "every step, a soft spring does not."
    )
    traits = Traits(
        own_hypothesis=True,
        beside_the_chain=True,
        of_the_recording=True,
        least_gain=13.0,
        form_of_any=0.1,  # a shift in time has the shape of what most errors of form leave
    )

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        prefix = f"{self.placed(axis)}_"
        late = telemetry.time_s - self["delay_s"]
        channels = {
            name: np.interp(late, telemetry.time_s, values) if name.startswith(prefix) else values
            for name, values in telemetry.channels.items()
        }
        return replace(telemetry, channels=channels)
