"""Examples of Modelica.Mechanics.Rotational as drive trains; parameters from the library's documentation."""

import math

from sim.rotational.components import (
    BearingFriction,
    Brake,
    Clutch,
    Constant,
    Damper,
    ElastoBacklash,
    Fixed,
    IdealGear,
    Inertia,
    LossyGear,
    Product,
    Ramp,
    Sine,
    Spring,
    SpringDamper,
    Step,
    Torque,
)
from sim.rotational.drive_train import DriveTrain

HALF_RIGHT_ANGLE = math.pi / 4


def lossy_gear_demo_1(**bearing: BearingFriction) -> DriveTrain:
    return DriveTrain.series(
        torque1=Torque(Sine(amplitude=10, f=1)),
        **bearing,
        Inertia1=Inertia(J=1),
        gear=LossyGear(ratio=2, lossTable=[0, 0.5, 0.5, 0, 0]),
        Inertia2=Inertia(J=1.5, phi=0, w=0),
        torque2=Torque(Ramp(height=5, duration=2, offset=-10)),
    )


def lossy_gear_demo_2() -> DriveTrain:
    return lossy_gear_demo_1(bearingFriction=BearingFriction(tau_pos=[[0, 0.5], [1, 1]], peak=1))


def lossy_gear_demo_3() -> DriveTrain:
    return DriveTrain.series(
        torque1=Torque(Step(height=0)),
        Inertia1=Inertia(J=0.001, w=10),
        gear=LossyGear(ratio=1, lossTable=[0, 0.25, 0.25, 0.625, 2.5]),
        Inertia2=Inertia(J=0.001, phi=0, w=10),
        torque2=Torque(Step(height=1, startTime=0.5)),
    )


def backlash() -> DriveTrain:
    train = DriveTrain.series(
        fixed=Fixed(),
        springDamper=SpringDamper(c=20e3, d=50),
        inertia1=Inertia(J=5, phi=2 * HALF_RIGHT_ANGLE, w=0),
    )
    return train.branch(
        "fixed.flange",
        elastoBacklash=ElastoBacklash(c=20e3, d=50, b=HALF_RIGHT_ANGLE),
        inertia2=Inertia(J=5, phi=2 * HALF_RIGHT_ANGLE, w=0),
    )


def first() -> DriveTrain:
    train = DriveTrain.series(
        torque=Torque(Sine(amplitude=10, f=5)),
        inertia1=Inertia(J=0.1),
        idealGear=IdealGear(ratio=10),
        inertia2=Inertia(J=2, phi=0, w=0),
        spring=Spring(c=1e4, phi_rel=0),
        inertia3=Inertia(J=2, w=0),
    )
    return train.branch("inertia2.flange_b", damper=Damper(d=10), fixed=Fixed())


def elastic_bearing() -> DriveTrain:
    train = DriveTrain.series(
        torque=Torque(Ramp(height=100, duration=5)),
        shaft=Inertia(J=1, phi=0, w=0),
        idealGear=IdealGear(ratio=3),
        spring=Spring(c=1e3, phi_rel=0),
        load=Inertia(J=50, w=0),
    )
    train = train.branch("idealGear.support", housing=Inertia(J=5))
    return train.add("fixed", Fixed()).add(
        "springDamper",
        SpringDamper(c=1e5, d=5, phi_rel=0, w_rel=0),
        flange_a="fixed.flange",
        flange_b="housing.flange_b",
    )


def friction() -> DriveTrain:
    train = DriveTrain.series(
        torque=Torque(Product(Sine(amplitude=200, f=50 / math.pi), Step(height=-1, offset=1, startTime=0.5))),
        inertia3=Inertia(J=1, phi=0, w=100),
        clutch=Clutch(fn_max=160, f_normalized=Constant(1)),
        inertia2=Inertia(J=0.05, phi=0, w=90),
        spring=SpringDamper(c=160, d=1),
        brake=Brake(fn_max=1600, f_normalized=Step(startTime=0.5)),
        inertia1=Inertia(J=1, phi=0, w=90),
    )
    return train.branch("torque.support", fixed=Fixed()).connect("brake.support", "fixed.flange")
