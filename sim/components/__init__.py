"""Components of Modelica.Mechanics.Rotational, one file each; COMPONENTS lists them all.

Angles [rad], torques [N.m]; signs as in `sim.component`. Names and parameters are Modelica's.
"""

from sim.component import Component
from sim.components.bearing_friction import BearingFriction
from sim.components.brake import Brake
from sim.components.clutch import Clutch, OneWayClutch
from sim.components.damper import Damper
from sim.components.elasto_backlash import ElastoBacklash, ElastoBacklash2
from sim.components.fixed import Fixed
from sim.components.gearbox import Gearbox
from sim.components.ideal_gear import IdealGear
from sim.components.ideal_planetary import IdealPlanetary
from sim.components.inertia import Inertia
from sim.components.lossy_gear import LossyGear
from sim.components.motion_source import Accelerate, ConstantSpeed, Move, Position, Speed
from sim.components.signals import Constant, Product, Pulse, Ramp, Sampled, Sine, Step
from sim.components.speed_torque import (
    InverseSpeedDependentTorque,
    LinearSpeedDependentTorque,
    QuadraticSpeedDependentTorque,
    SignTorque,
)
from sim.components.spring import Spring
from sim.components.spring_damper import SpringDamper
from sim.components.torque import ConstantTorque, Torque, Torque2, TorqueStep

COMPONENTS: tuple[type[Component], ...] = (
    Inertia,
    Spring,
    Damper,
    SpringDamper,
    ElastoBacklash,
    ElastoBacklash2,
    IdealGear,
    IdealPlanetary,
    LossyGear,
    BearingFriction,
    Brake,
    Clutch,
    OneWayClutch,
    Fixed,
    Torque,
    Torque2,
    ConstantTorque,
    TorqueStep,
    LinearSpeedDependentTorque,
    QuadraticSpeedDependentTorque,
    InverseSpeedDependentTorque,
    SignTorque,
    Position,
    Speed,
    ConstantSpeed,
    Accelerate,
    Move,
)

__all__ = [
    "COMPONENTS",
    "Accelerate",
    "BearingFriction",
    "Brake",
    "Clutch",
    "Constant",
    "ConstantSpeed",
    "ConstantTorque",
    "Damper",
    "ElastoBacklash",
    "ElastoBacklash2",
    "Fixed",
    "Gearbox",
    "IdealGear",
    "IdealPlanetary",
    "Inertia",
    "InverseSpeedDependentTorque",
    "LinearSpeedDependentTorque",
    "LossyGear",
    "Move",
    "OneWayClutch",
    "Position",
    "Product",
    "Pulse",
    "QuadraticSpeedDependentTorque",
    "Ramp",
    "Sampled",
    "SignTorque",
    "Sine",
    "Speed",
    "Spring",
    "SpringDamper",
    "Step",
    "Torque",
    "Torque2",
    "TorqueStep",
]
