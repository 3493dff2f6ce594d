"""A torque or current sensor that does not show zero at rest."""

from sim.mechanisms.mechanism import (
    UNLIKE,
    Array,
    Discriminating,
    Law,
    Measurement,
    Need,
    Parameter,
    Signature,
    Traits,
    only,
)


class TorqueOffset(Measurement):
    """A constant on the measured motor torque.

    Equations: measured = true + torque
    Source: zero error of a current transducer
    """

    name = "torque_offset"
    parameters = (Parameter("torque_n_m", "N m", -1e4, 1e4, 0.2),)
    size = "torque_n_m"
    locations = only("motor", None)
    needs = frozenset({Need.BOTH_DIRECTIONS})
    signature = Signature("recording")
    sentence = (
        "A constant torque of {torque_n_m:.3g} N m is in the torque channel, whatever the motion: its zero, or a "
        "weight that the axis lifts."
    )
    action = (
        "If the axis lifts something (a hoist, a vertical axis), this is its weight: give it as the channel "
        "known_torque_nm. Otherwise support the load (it may drop when the brake is released) and zero the torque "
        "channel at standstill, brake open and load balanced. It says nothing of the state of the machine."
    )
    check = Discriminating.AT_REST.value
    discriminated_by = frozenset({Discriminating.AT_REST})
    or_of_the_machine = "a weight that the axis lifts"
    traits = Traits(
        own_hypothesis=True,
        of_the_recording=True,
        least_gain=10.0,
        laws=frozenset({Law.OFFSET}),
        known_within_a_little=True,
        over_strokes=True,
        in_good_order=UNLIKE,
        restless=True,
    )

    def torque(self, time_s: Array, torque: Array) -> Array:
        return torque + self["torque_n_m"]
