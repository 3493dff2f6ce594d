"""A wheel whose teeth do not run round its axis."""

import math

from sim.description.axis import Axis
from sim.mechanisms.locations import wheels, with_error
from sim.mechanisms.mechanism import SECURED, Discriminating, Law, Mechanics, Need, Parameter, Signature, Traits
from sim.rotational.drive_train import DriveTrain


class Eccentricity(Mechanics):
    """Transmission error once per revolution of the wheel, felt at the driven gear of its mesh.

    Equations: x = theta_driver / i - theta_driven - amplitude sin(theta + phase)
    Source: kinematic error of first order, 2 e tan(alpha) / r_b for an eccentric wheel of offset e
    """

    name = "eccentricity"
    parameters = (
        Parameter("amplitude_rad", "rad", 0.0, 0.05, 1e-3),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size = "amplitude_rad"
    locations = wheels
    as_new_key = "transmission_error_rad"
    shown_by = frozenset({Need.HALF_TURN})
    signature = Signature("angle", order=1, direction="same")
    sentence = "The {where} gear has a runout of {amplitude_rad:.3g} rad ({amplitude_rad_shown}) once per revolution."
    action = (
        f"{SECURED} put a dial gauge on the {{where}} gear or its shaft and turn it once by hand: check seat, keys and "
        "bearings. Do it at the next stop; runout wears teeth slowly."
    )
    check = (
        "Turn the load slowly through more than one revolution in both directions: runout keeps its place on the "
        "{where} gear whatever the speed, weight changes with the position of the axis in space."
    )
    discriminated_by = frozenset({Discriminating.BY_SECOND_ENCODER, Discriminating.OVER_A_TURN})
    traits = Traits(
        behind_the_motor=True,
        of_links=True,
        own_hypothesis=True,
        laws=frozenset({Law.RUNOUT_OR_DENT, Law.RUNOUT_OR_RIPPLE}),
        erring_teeth=True,
    )

    @classmethod
    def looks_like(cls, axis: Axis, location: str | None, load_encoder: bool) -> tuple[str, ...]:
        """Runout of the last gear and an error of the load encoder differ by the torque of the load's inertia along it:
        by the square of once per turn over the natural frequency, 0.2 % on a robot's joint."""
        return ("encoder_error",) if load_encoder and axis.stages and location == axis.stages[-1].name else ()

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        return with_error(train, place, 1.0, self["amplitude_rad"], self["phase_rad"])
