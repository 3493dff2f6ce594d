"""An encoder mounted off its axis."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.mechanism import Measurement, Need, Parameter, Signature


class EncoderError(Measurement):
    """The angle is wrong by a sine once per revolution of its shaft, and the speed accordingly."""

    name: ClassVar[str] = "encoder_error"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("amplitude_rad", "rad", 0.0, 0.1, 1e-3),
        Parameter("phase_rad", "rad", -np.pi, np.pi, 0.0, periodic=True),
    )
    size: ClassVar[str] = "amplitude_rad"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.HALF_TURN, Need.LOAD_ENCODER})
    signature: ClassVar[Signature] = Signature("angle", order=1)
    equations: ClassVar[str] = "measured = theta + amplitude sin(theta + phase)"
    source: ClassVar[str] = "eccentric disc: e / r of the grating"
    sentence: ClassVar[str] = (
        "The load encoder has an error of {amplitude_rad:.3g} rad ({amplitude_rad_shown}) once per revolution, "
        "more than its data sheet allows."
    )
    action: ClassVar[str] = (
        "Check seat, centring and coupling of the load encoder and clean its scale; nothing needs to be wrong with "
        "the machine."
    )
    check: ClassVar[str] = (
        "Turn the load slowly through more than one revolution with a second encoder or a laser beside it: the "
        "encoder's error shows between the two, runout of the gear does not."
    )
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.BY_SECOND_ENCODER, Differing.OVER_A_TURN})
    of_links: ClassVar[bool] = True
    unseen_at: ClassVar[frozenset[str]] = frozenset({"motor"})  # by the motor's angle all others are told
    own_hypothesis: ClassVar[bool] = True
    beside_the_chain: ClassVar[bool] = True

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        return axis.load_encoder.error_rad

    @classmethod
    def looks_like(cls, axis: Axis, location: str | None, load_encoder: bool) -> tuple[str, ...]:
        return ("eccentricity",) if load_encoder and axis.stages else ()

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return ("load", "motor")

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
