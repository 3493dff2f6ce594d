"""A torque or current sensor that does not show zero at rest."""

from dataclasses import replace
from typing import ClassVar

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.mechanism import Measurement, Need, Parameter, Signature
from sim.mechanisms.traits import UNLIKE, Law, Traits


class TorqueOffset(Measurement):
    """A constant on the measured motor torque."""

    name: ClassVar[str] = "torque_offset"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("torque_n_m", "N m", -1e4, 1e4, 0.2),)
    size: ClassVar[str] = "torque_n_m"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.BOTH_DIRECTIONS})
    signature: ClassVar[Signature] = Signature("recording")
    equations: ClassVar[str] = "measured = true + torque"
    source: ClassVar[str] = "zero error of a current transducer"
    sentence: ClassVar[str] = (
        "A constant torque of {torque_n_m:.3g} N m is in the torque channel, whatever the motion: its zero, or a "
        "weight that the axis lifts."
    )
    action: ClassVar[str] = (
        "If the axis lifts something (a hoist, a vertical axis), this is its weight: give it as the channel "
        "known_torque_nm. Otherwise support the load (it may drop when the brake is released) and zero the torque "
        "channel at standstill, brake open and load balanced. It says nothing of the state of the machine."
    )
    check: ClassVar[str] = Differing.AT_REST.value
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.AT_REST})
    own_hypothesis: ClassVar[bool] = True
    of_the_recording: ClassVar[bool] = True
    or_of_the_machine: ClassVar[str | None] = "a weight that the axis lifts"
    traits: ClassVar[Traits] = Traits(
        least_gain=10.0,
        over_bending=0.4,
        laws=frozenset({Law.OFFSET}),
        known_within_a_little=True,
        over_strokes=True,
        in_good_order=UNLIKE,
        restless=True,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return ("motor", None)

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        if "motor_torque_nm" not in telemetry:
            return telemetry
        torque = telemetry["motor_torque_nm"] + self["torque_n_m"]
        return replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": torque})
