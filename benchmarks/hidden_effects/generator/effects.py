"""The catalogue of what can be hidden."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.hidden_effects.generator.effect import Draw, Effect
from benchmarks.hidden_effects.generator.friction_effects import (
    coulomb_friction,
    friction_asymmetry,
    friction_drift,
    gravity_imbalance,
    stribeck_friction,
    torque_ripple,
    viscous_friction,
)
from benchmarks.hidden_effects.generator.gear_effects import (
    backlash,
    bearing_defect,
    eccentricity,
    hysteresis,
    load_dependent_loss,
    mesh_error,
    stiffness_hardening,
    structural_resonance,
    tooth_damage,
)
from benchmarks.hidden_effects.generator.sensor_effects import (
    clipping,
    electrical_hum,
    encoder_error,
    lost_samples,
    time_delay,
    torque_offset,
)
from benchmarks.hidden_effects.generator.unnamed_effects import (
    fixed_frequency_disturbance,
    position_dependent_viscous,
    quadratic_drag,
    speed_band_friction,
)

PLANT_EFFECTS = (
    backlash,
    tooth_damage,
    eccentricity,
    mesh_error,
    coulomb_friction,
    viscous_friction,
    stribeck_friction,
    friction_asymmetry,
    load_dependent_loss,
    friction_drift,
    gravity_imbalance,
    torque_ripple,
    stiffness_hardening,
    hysteresis,
    structural_resonance,
)
SENSOR_EFFECTS = (torque_offset, encoder_error, time_delay, electrical_hum, clipping, lost_samples)
SOUND_EFFECTS = (bearing_defect,)
UNNAMED_EFFECTS = (
    position_dependent_viscous,
    quadratic_drag,
    speed_band_friction,
    fixed_frequency_disturbance,
)
EFFECTS: dict[str, Callable[[Draw], Effect]] = {
    function.__name__: function for function in PLANT_EFFECTS + SENSOR_EFFECTS + SOUND_EFFECTS + UNNAMED_EFFECTS
}
GEARED = frozenset(
    {
        "backlash",
        "tooth_damage",
        "eccentricity",
        "mesh_error",
        "load_dependent_loss",
        "stiffness_hardening",
        "hysteresis",
    }
)
"""Effects that need a gear."""
