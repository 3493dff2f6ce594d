"""The mains in the signal."""

import numpy as np

from sim.mechanisms.mechanism import Array, Measurement, Need, Parameter, Samples, Signature, SoundReport, Traits, only


class ElectricalHum(Measurement):
    """A steady sine on the measured motor torque, and on the sound in units of full scale.

    Equations: measured = true + amplitude sin(2 pi f t + phase)
    Source: induced at 50 or 60 Hz and their multiples
    """

    name = "electrical_hum"
    parameters = (
        Parameter("frequency_hz", "Hz", 1.0, 4000.0, 50.0),
        Parameter("torque_n_m", "N m", 0.0, 1e3, 0.1),
        Parameter("sound", "1", 0.0, 1.0, 0.0),
        Parameter("phase_rad", "rad", -np.pi, np.pi, 0.0, periodic=True, shown=False),
    )
    size = "torque_n_m"
    locations = only("motor", None)
    shown_by = frozenset({Need.SEVERAL_SPEEDS, Need.TWO_ROWS_PER_PERIOD})
    signature = Signature("frequency")
    sentence = "A hum of {frequency_hz:g} Hz from the mains is on the torque channel."
    action = (
        "Check shielding and grounding of the cable and keep it away from power lines: one earth, shield on one side; "
        "nothing is wrong with the machine."
    )
    check = (
        "Log the torque for ten seconds at standstill with the drive on: hum of the mains stays, ripple of the motor "
        "is gone."
    )
    checked = ("hum of the mains", "none found")
    sound = SoundReport(
        "hum",
        "Mend the earthing of the recorder, then repeat; friction, stiffness and backlash need telemetry with a load "
        "encoder.",
    )
    traits = Traits(
        own_hypothesis=True,
        beside_the_chain=True,
        of_the_recording=True,
        form_left=0.0,  # a sine in the current has no other form
        restless=True,
    )

    def torque(self, time_s: Array, torque: Array) -> Array:
        angle = 2 * np.pi * self["frequency_hz"] * time_s + self["phase_rad"]
        return np.asarray(torque + self["torque_n_m"] * np.sin(angle))

    def distort_sound(self, samples: Samples, sample_rate_hz: float, seed: int = 0) -> Samples:
        angle = 2 * np.pi * self["frequency_hz"] * np.arange(samples.size) / sample_rate_hz + self["phase_rad"]
        return np.asarray(samples + self["sound"] * np.sin(angle), dtype=np.float32)
