"""An arm whose weight is not balanced."""

import math
from typing import ClassVar

from sim.chain.components import Gravity
from sim.description.axis import Axis
from sim.mechanisms.differing import Differing
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import shaft_name, unused_name
from sim.mechanisms.traits import Traits
from sim.rotational.drive_train import DriveTrain


class GravityImbalance(Mechanics):
    """The weight pulls the load towards theta = -phase."""

    name: ClassVar[str] = "gravity_imbalance"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("torque_n_m", "N m", 0.0, 1e5, 50.0),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size: ClassVar[str] = "torque_n_m"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.LOAD_TURN})
    signature: ClassVar[Signature] = Signature("angle", order=1)
    equations: ClassVar[str] = "tau on the load = -torque sin(theta_load + phase)"
    source: ClassVar[str] = "pendulum"
    sentence: ClassVar[str] = "A weight off the axis of rotation pulls at the load with up to {torque_n_m:.3g} N m."
    action: ClassVar[str] = (
        "Check payload, its centre of gravity and the balancer against what is described, and enter the weight in the "
        "axis description."
    )
    check: ClassVar[str] = (
        "Hold the axis at four positions a quarter turn apart and log the torque: weight follows the sine of the "
        "angle, friction and offset do not."
    )
    behind_the_motor: ClassVar[bool] = True
    differs: ClassVar[frozenset[Differing]] = frozenset({Differing.OVER_A_TURN})
    own_hypothesis: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_gain=16.0,
        restless=True,
        torque_over_angle=True,
        shakes_load=True,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return ("load",)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        arm = Gravity(self["torque_n_m"], self["phase_rad"])
        return train.add(unused_name(train, "gravity"), arm, flange=f"{shaft_name(train, 'load')}.flange_b")
