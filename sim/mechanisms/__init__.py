"""The catalogue of mechanisms: one per file; a new one is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from sim.mechanisms.backlash import Backlash
from sim.mechanisms.bearing_defect import BearingDefect
from sim.mechanisms.clipping import Clipping
from sim.mechanisms.coulomb_friction import CoulombFriction
from sim.mechanisms.eccentricity import Eccentricity
from sim.mechanisms.electrical_hum import ElectricalHum
from sim.mechanisms.encoder_error import EncoderError
from sim.mechanisms.friction_asymmetry import FrictionAsymmetry
from sim.mechanisms.friction_drift import FrictionDrift
from sim.mechanisms.gravity_imbalance import GravityImbalance
from sim.mechanisms.hysteresis import Hysteresis
from sim.mechanisms.kinematic_error import KinematicError
from sim.mechanisms.load_dependent_loss import LoadDependentLoss
from sim.mechanisms.lost_samples import LostSamples
from sim.mechanisms.mechanism import Mechanism
from sim.mechanisms.mesh_error import MeshError
from sim.mechanisms.stiffness_hardening import StiffnessHardening
from sim.mechanisms.stribeck_friction import StribeckFriction
from sim.mechanisms.structural_resonance import StructuralResonance
from sim.mechanisms.time_delay import TimeDelay
from sim.mechanisms.tooth_damage import ToothDamage
from sim.mechanisms.torque_gain import TorqueGain
from sim.mechanisms.torque_offset import TorqueOffset
from sim.mechanisms.torque_ripple import TorqueRippleOfMotor
from sim.mechanisms.viscous_friction import ViscousFriction

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
