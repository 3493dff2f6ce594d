"""A motor whose torque depends on its angle."""

import math

from sim.chain.components import MeshLine, TorqueRipple
from sim.mechanisms.locations import unused_name
from sim.mechanisms.mechanism import SECURED, Law, Mechanics, Parameter, Signature, Traits, only
from sim.rotational.drive_train import DriveTrain


class TorqueRippleOfMotor(Mechanics):
    """Cogging or ripple of one order of the motor's angle, present without load too.

    Equations: tau on the motor = torque sin(order theta_motor + phase)
    Source: cogging at multiples of lcm(slots, poles), current ripple at 6 per pole pair
    """

    name = "torque_ripple"
    parameters = (
        Parameter("torque_n_m", "N m", 0.0, 1e3, 0.1),
        Parameter("order", "1", 0.5, 200.0, 6.0),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size = "torque_n_m"
    locations = only("motor")
    signature = Signature("angle", order="order")
    sentence = "The motor torque has a ripple of {torque_n_m:.3g} N m, {order:g} times per revolution of the motor."
    action = (
        f"Check calibration of current sensors and commutation of the drive. {SECURED} turn the motor by hand and feel "
        "for cogging. Not urgent."
    )
    check = "Repeat the motion at half the speed: ripple keeps its order of the motor, hum its frequency."
    traits = Traits(
        own_hypothesis=True,
        identified_by="order",
        torque_over_angle=True,
        laws=frozenset({Law.RIPPLE_OF_TEETH, Law.RUNOUT_OR_RIPPLE}),
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        ripple = TorqueRipple((MeshLine(self["order"], self["torque_n_m"], self["phase_rad"]),))
        return train.add(unused_name(train, "torque_ripple"), ripple, flange="motor.flange_a")
