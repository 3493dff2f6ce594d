"""Components of Modelica.Mechanics.Rotational, one file each; COMPONENTS lists them all.

Angles [rad], torques [N.m]; signs as in `sim.rotational.component`. Names and parameters are Modelica's.
"""

from sim.rotational.component import Component
from sim.rotational.components.bearing_friction import BearingFriction
from sim.rotational.components.brake import Brake
from sim.rotational.components.clutch import Clutch, OneWayClutch
from sim.rotational.components.damper import Damper
from sim.rotational.components.disc import Disc
from sim.rotational.components.elasto_backlash import ElastoBacklash, ElastoBacklash2
from sim.rotational.components.fixed import Fixed
from sim.rotational.components.gearbox import Gearbox
from sim.rotational.components.ideal_gear import IdealGear
from sim.rotational.components.ideal_planetary import IdealPlanetary
from sim.rotational.components.inertia import Inertia
from sim.rotational.components.lossy_gear import LossyGear
from sim.rotational.components.motion_source import Accelerate, ConstantSpeed, Move, Position, Speed
from sim.rotational.components.relative_states import RelativeStates
from sim.rotational.components.rotation_to_translation import IdealGearR2T, IdealRollingWheel, Mass
from sim.rotational.components.sensors import (
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
from sim.rotational.components.signals import Constant, ExpSine, Product, Pulse, Ramp, Sampled, Sine, Step
from sim.rotational.components.speed_torque import (
    LinearSpeedDependentTorque,
)
from sim.rotational.components.spring import Spring
from sim.rotational.components.spring_damper import SpringDamper
from sim.rotational.components.torque import ConstantTorque, Torque, Torque2, TorqueStep

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
    "Ramp",
    "RelAccSensor",
    "RelAngleSensor",
    "RelSpeedSensor",
    "RelativeStates",
    "Sampled",
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
