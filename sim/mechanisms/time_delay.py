"""Channels that were not sampled at the same time."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.mechanism import Measurement, Need, Parameter, Signature
from sim.mechanisms.traits import Traits


class TimeDelay(Measurement):
    """The channels of one shaft come late."""

    name: ClassVar[str] = "time_delay"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("delay_s", "s", -1.0, 1.0, 2e-3),)
    size: ClassVar[str] = "delay_s"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.SEVERAL_SPEEDS})
    signature: ClassVar[Signature] = Signature("recording", grows_with="speed")
    equations: ClassVar[str] = "measured(t) = true(t - delay)"
    source: ClassVar[str] = "buffers between drive and recorder"
    sentence: ClassVar[str] = "One channel is {delay_s:.3g} s later than the others."
    action: ClassVar[str] = (
        "Check that all channels are sampled on one clock: filters, bus cycles and time stamps of the late channel; "
        "nothing is wrong with the machine."
    )
    check: ClassVar[str] = (
        "Log one sharp step of torque with all channels at the full rate: a late channel lags by the same time at "
        "every step, a soft spring does not."
    )
    own_hypothesis: ClassVar[bool] = True
    beside_the_chain: ClassVar[bool] = True
    of_the_recording: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_gain=13.0,
        form_of_any=0.1,  # a shift in time has the shape of what most errors of form leave
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return ("load", "motor")

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        prefix = f"{self.placed(axis)}_"
        late = telemetry.time_s - self["delay_s"]
        channels = {
            name: np.interp(late, telemetry.time_s, values) if name.startswith(prefix) else values
            for name, values in telemetry.channels.items()
        }
        return replace(telemetry, channels=channels)
