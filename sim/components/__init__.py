"""Components of Modelica.Mechanics.Rotational, one file each; COMPONENTS lists them all.

Angles [rad], torques [N.m]; signs as in `sim.component`. Names and parameters are Modelica's.
"""

from sim.component import Component
from sim.components.bearing_friction import BearingFriction
from sim.components.brake import Brake
from sim.components.clutch import Clutch, OneWayClutch
from sim.components.damper import Damper
from sim.components.disc import Disc
from sim.components.elasto_backlash import ElastoBacklash, ElastoBacklash2
from sim.components.fixed import Fixed
from sim.components.gearbox import Gearbox
from sim.components.ideal_gear import IdealGear
from sim.components.ideal_planetary import IdealPlanetary
from sim.components.inertia import Inertia
from sim.components.lossy_gear import LossyGear
from sim.components.motion_source import Accelerate, ConstantSpeed, Move, Position, Speed
from sim.components.relative_states import RelativeStates
from sim.components.rotation_to_translation import IdealGearR2T, IdealRollingWheel, Mass
from sim.components.sensors import (
    AccSensor,
    AngleSensor,
    MultiSensor,
    PowerSensor,
    RelAccSensor,
    RelAngleSensor,
    RelSpeedSensor,
    SpeedSensor,
    TorqueSensor,
)
from sim.components.signals import Constant, ExpSine, Product, Pulse, Ramp, Sampled, Sine, Step
from sim.components.speed_torque import (
    EddyCurrentTorque,
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
    Disc,
    RelativeStates,
    IdealGearR2T,
    IdealRollingWheel,
    Mass,
    EddyCurrentTorque,
    AngleSensor,
    SpeedSensor,
    AccSensor,
    RelAngleSensor,
    RelSpeedSensor,
    RelAccSensor,
    TorqueSensor,
    PowerSensor,
    MultiSensor,
)

__all__ = [
    "COMPONENTS",
    "AccSensor",
    "Accelerate",
    "AngleSensor",
    "BearingFriction",
    "Brake",
    "Clutch",
    "Constant",
    "ConstantSpeed",
    "ConstantTorque",
    "Damper",
    "Disc",
    "EddyCurrentTorque",
    "ElastoBacklash",
    "ElastoBacklash2",
    "ExpSine",
    "Fixed",
    "Gearbox",
    "IdealGear",
    "IdealGearR2T",
    "IdealPlanetary",
    "IdealRollingWheel",
    "Inertia",
    "InverseSpeedDependentTorque",
    "LinearSpeedDependentTorque",
    "LossyGear",
    "Mass",
    "Move",
    "MultiSensor",
    "OneWayClutch",
    "Position",
    "PowerSensor",
    "Product",
    "Pulse",
    "QuadraticSpeedDependentTorque",
    "Ramp",
    "RelAccSensor",
    "RelAngleSensor",
    "RelSpeedSensor",
    "RelativeStates",
    "Sampled",
    "SignTorque",
    "Sine",
    "Speed",
    "SpeedSensor",
    "Spring",
    "SpringDamper",
    "Step",
    "Torque",
    "Torque2",
    "TorqueSensor",
    "TorqueStep",
]
