"""An arm whose weight is not balanced."""

import math

from sim.chain.components import Gravity
from sim.mechanisms.locations import shaft_name, unused_name
from sim.mechanisms.mechanism import Discriminating, Mechanics, Need, Parameter, Signature, Traits, only
from sim.rotational.drive_train import DriveTrain


class GravityImbalance(Mechanics):
    """The weight pulls the load towards theta = -phase.

    Equations: tau on the load = -torque sin(theta_load + phase)
    Source: pendulum
    """

    name = "gravity_imbalance"
    parameters = (
        Parameter("torque_n_m", "N m", 0.0, 1e5, 50.0),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size = "torque_n_m"
    locations = only("load")
    shown_by = frozenset({Need.LOAD_TURN})
    signature = Signature("angle", order=1)
    sentence = "A weight off the axis of rotation pulls at the load with up to {torque_n_m:.3g} N m."
    action = (
        "Check payload, its centre of gravity and the balancer against what is described, and enter the weight in the "
        "axis description."
    )
    check = (
        "Hold the axis at four positions a quarter turn apart and log the torque: weight follows the sine of the "
        "angle, friction and offset do not."
    )
    discriminated_by = frozenset({Discriminating.OVER_A_TURN})
    traits = Traits(
        behind_the_motor=True,
        own_hypothesis=True,
        least_gain=16.0,
        restless=True,
        torque_over_angle=True,
        shakes_load=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        arm = Gravity(self["torque_n_m"], self["phase_rad"])
        return train.add(unused_name(train, "gravity"), arm, flange=f"{shaft_name(train, 'load')}.flange_b")
