"""An encoder mounted off its axis."""

from dataclasses import replace

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.mechanism import Discriminating, Measurement, Need, Parameter, Signature, Traits, only


class EncoderError(Measurement):
    """The angle is wrong by a sine once per revolution of its shaft, and the speed accordingly.

    Equations: measured = theta + amplitude sin(theta + phase)
    Source: eccentric disc: e / r of the grating
    """

    name = "encoder_error"
    parameters = (
        Parameter("amplitude_rad", "rad", 0.0, 0.1, 1e-3),
        Parameter("phase_rad", "rad", -np.pi, np.pi, 0.0, periodic=True),
    )
    size = "amplitude_rad"
    locations = only("load", "motor")
    shown_by = frozenset({Need.HALF_TURN, Need.LOAD_ENCODER})
    signature = Signature("angle", order=1)
    sentence = (
        "The load encoder has an error of {amplitude_rad:.3g} rad ({amplitude_rad_shown}) once per revolution, "
        "more than its data sheet allows."
    )
    action = (
        "Check seat, centring and coupling of the load encoder and clean its scale; nothing needs to be wrong with "
        "the machine."
    )
    check = (
        "Turn the load slowly through more than one revolution with a second encoder or a laser beside it: the "
        "encoder's error shows between the two, runout of the gear does not."
    )
    discriminated_by = frozenset({Discriminating.BY_SECOND_ENCODER, Discriminating.OVER_A_TURN})
    traits = Traits(
        of_links=True,
        own_hypothesis=True,
        beside_the_chain=True,
        unseen_at=frozenset({"motor"}),
    )

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        return axis.load_encoder.error_rad

    @classmethod
    def looks_like(cls, axis: Axis, location: str | None, load_encoder: bool) -> tuple[str, ...]:
        return ("eccentricity",) if load_encoder and axis.stages else ()

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        end = self.placed(axis)
        channels = dict(telemetry.channels)
        position, speed = f"{end}_position_rad", f"{end}_speed_rad_s"
        if position in channels:
            theta = channels[position] + self["phase_rad"]
            channels[position] = channels[position] + self["amplitude_rad"] * np.sin(theta)
            if speed in channels:
                channels[speed] = channels[speed] * (1 + self["amplitude_rad"] * np.cos(theta))
        return replace(telemetry, channels=channels)
