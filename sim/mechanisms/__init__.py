"""The catalogue of mechanisms: one per file; a new one is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from sim.mechanisms.friction.coulomb_friction import CoulombFriction
from sim.mechanisms.friction.friction_asymmetry import FrictionAsymmetry
from sim.mechanisms.friction.friction_drift import FrictionDrift
from sim.mechanisms.friction.stribeck_friction import StribeckFriction
from sim.mechanisms.friction.viscous_friction import ViscousFriction
from sim.mechanisms.gears.backlash import Backlash
from sim.mechanisms.gears.eccentricity import Eccentricity
from sim.mechanisms.gears.hysteresis import Hysteresis
from sim.mechanisms.gears.kinematic_error import KinematicError
from sim.mechanisms.gears.load_dependent_loss import LoadDependentLoss
from sim.mechanisms.gears.mesh_error import MeshError
from sim.mechanisms.gears.stiffness_hardening import StiffnessHardening
from sim.mechanisms.gears.tooth_damage import ToothDamage
from sim.mechanisms.measurement.clipping import Clipping
from sim.mechanisms.measurement.electrical_hum import ElectricalHum
from sim.mechanisms.measurement.encoder_error import EncoderError
from sim.mechanisms.measurement.lost_samples import LostSamples
from sim.mechanisms.measurement.time_delay import TimeDelay
from sim.mechanisms.measurement.torque_gain import TorqueGain
from sim.mechanisms.measurement.torque_offset import TorqueOffset
from sim.mechanisms.mechanism import Mechanism
from sim.mechanisms.shafts.bearing_defect import BearingDefect
from sim.mechanisms.shafts.gravity_imbalance import GravityImbalance
from sim.mechanisms.shafts.structural_resonance import StructuralResonance
from sim.mechanisms.shafts.torque_ripple import TorqueRippleOfMotor

MECHANISMS: Mapping[str, type[Mechanism]] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            Backlash,
            ToothDamage,
            Eccentricity,
            MeshError,
            KinematicError,
            CoulombFriction,
            ViscousFriction,
            StribeckFriction,
            FrictionAsymmetry,
            LoadDependentLoss,
            FrictionDrift,
            GravityImbalance,
            TorqueRippleOfMotor,
            StiffnessHardening,
            Hysteresis,
            BearingDefect,
            StructuralResonance,
            TorqueOffset,
            TorqueGain,
            EncoderError,
            TimeDelay,
            ElectricalHum,
            Clipping,
            LostSamples,
        )
    }
)

__all__ = [
    "MECHANISMS",
    "Backlash",
    "BearingDefect",
    "Clipping",
    "CoulombFriction",
    "Eccentricity",
    "ElectricalHum",
    "EncoderError",
    "FrictionAsymmetry",
    "FrictionDrift",
    "GravityImbalance",
    "Hysteresis",
    "KinematicError",
    "LoadDependentLoss",
    "LostSamples",
    "MeshError",
    "StiffnessHardening",
    "StribeckFriction",
    "StructuralResonance",
    "TimeDelay",
    "ToothDamage",
    "TorqueGain",
    "TorqueOffset",
    "TorqueRippleOfMotor",
    "ViscousFriction",
]
