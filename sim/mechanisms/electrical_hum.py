"""The mains in the signal."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.heard import Heard
from sim.mechanisms.mechanism import Measurement, Need, Parameter, Samples, Signature
from sim.mechanisms.traits import Traits


class ElectricalHum(Measurement):
    """A steady sine on the measured motor torque, and on the sound in units of full scale."""

    name: ClassVar[str] = "electrical_hum"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("frequency_hz", "Hz", 1.0, 4000.0, 50.0),
        Parameter("torque_n_m", "N m", 0.0, 1e3, 0.1),
        Parameter("sound", "1", 0.0, 1.0, 0.0),
        Parameter("phase_rad", "rad", -np.pi, np.pi, 0.0, periodic=True, shown=False),
    )
    size: ClassVar[str] = "torque_n_m"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.SEVERAL_SPEEDS, Need.TWO_ROWS_PER_PERIOD})
    signature: ClassVar[Signature] = Signature("frequency")
    equations: ClassVar[str] = "measured = true + amplitude sin(2 pi f t + phase)"
    source: ClassVar[str] = "induced at 50 or 60 Hz and their multiples"
    sentence: ClassVar[str] = "A hum of {frequency_hz:g} Hz from the mains is on the torque channel."
    action: ClassVar[str] = (
        "Check shielding and grounding of the cable and keep it away from power lines: one earth, shield on one side; "
        "nothing is wrong with the machine."
    )
    check: ClassVar[str] = (
        "Log the torque for ten seconds at standstill with the drive on: hum of the mains stays, ripple of the motor "
        "is gone."
    )
    own_hypothesis: ClassVar[bool] = True
    beside_the_chain: ClassVar[bool] = True
    of_the_recording: ClassVar[bool] = True
    checked: ClassVar[tuple[str, str] | None] = ("hum of the mains", "none found")
    heard: ClassVar[Heard | None] = Heard(
        "hum",
        "Mend the earthing of the recorder, then repeat; friction, stiffness and backlash need telemetry with a load "
        "encoder.",
    )
    traits: ClassVar[Traits] = Traits(
        form_left=0.0,  # a sine in the current has no other form
        restless=True,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return ("motor", None)

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        if "motor_torque_nm" not in telemetry:
            return telemetry
        angle = 2 * np.pi * self["frequency_hz"] * telemetry.time_s + self["phase_rad"]
        torque = telemetry["motor_torque_nm"] + self["torque_n_m"] * np.sin(angle)
        return replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": torque})

    def distort_sound(self, samples: Samples, sample_rate_hz: float, seed: int = 0) -> Samples:
        angle = 2 * np.pi * self["frequency_hz"] * np.arange(samples.size) / sample_rate_hz + self["phase_rad"]
        return np.asarray(samples + self["sound"] * np.sin(angle), dtype=np.float32)
