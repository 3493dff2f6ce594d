"""A motor whose torque depends on its angle."""

import math
from typing import ClassVar

from sim.chain.components import MeshLine, TorqueRipple
from sim.description.axis import Axis
from sim.mechanisms.mechanism import SECURED, Mechanics, Parameter, Signature
from sim.mechanisms.places import unused_name
from sim.mechanisms.traits import Law, Traits
from sim.rotational.drive_train import DriveTrain


class TorqueRippleOfMotor(Mechanics):
    """Cogging or ripple of one order of the motor's angle, present without load too."""

    name: ClassVar[str] = "torque_ripple"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("torque_n_m", "N m", 0.0, 1e3, 0.1),
        Parameter("order", "1", 0.5, 200.0, 6.0),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size: ClassVar[str] = "torque_n_m"
    signature: ClassVar[Signature] = Signature("angle", order="order")
    equations: ClassVar[str] = "tau on the motor = torque sin(order theta_motor + phase)"
    source: ClassVar[str] = "cogging at multiples of lcm(slots, poles), current ripple at 6 per pole pair"
    sentence: ClassVar[str] = (
        "The motor torque has a ripple of {torque_n_m:.3g} N m, {order:g} times per revolution of the motor."
    )
    action: ClassVar[str] = (
        f"Check calibration of current sensors and commutation of the drive. {SECURED} turn the motor by hand and feel "
        "for cogging. Not urgent."
    )
    check: ClassVar[str] = (
        "Repeat the motion at half the speed: ripple keeps its order of the motor, hum its frequency."
    )
    own_hypothesis: ClassVar[bool] = True
    told_by: ClassVar[str | None] = "order"
    traits: ClassVar[Traits] = Traits(
        torque_over_angle=True,
        laws=frozenset({Law.RIPPLE_OF_TEETH, Law.RUNOUT_OR_RIPPLE}),
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return ("motor",)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        ripple = TorqueRipple((MeshLine(self["order"], self["torque_n_m"], self["phase_rad"]),))
        return train.add(unused_name(train, "torque_ripple"), ripple, flange="motor.flange_a")
