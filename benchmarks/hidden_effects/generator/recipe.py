"""What a scenario is to hide, how large, and what is measured: drawn by seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.hidden_effects.generator.effects import (
    EFFECTS,
    GEARED,
    PLANT_EFFECTS,
    SENSOR_EFFECTS,
    SOUND_EFFECTS,
    UNNAMED_EFFECTS,
)
from benchmarks.hidden_effects.generator.joint import KINDS
from benchmarks.hidden_effects.generator.noise import STYLES

LEVELS = {"strong": 3.0, "full": 1.0, "half": 0.5, "third": 1 / 3, "quarter": 0.25}
"""Size of the effect's change in the signals against the noise, rms; or of the full size where as new counts."""

GROUPS = (
    "null",
    "wrong parameters",
    "mechanics",
    "sensor",
    "unnamed",
    "two",
    "confounded",
    "sound alone",
    "sound alone null",
    "sound compared",
    "sound compared null",
    "several",
    "several null",
)
PAIRS = (
    ("backlash", "viscous_friction"),
    ("coulomb_friction", "eccentricity"),
    ("tooth_damage", "backlash"),
    ("gravity_imbalance", "stribeck_friction"),
    ("electrical_hum", "eccentricity"),
    ("gravity_imbalance", "mesh_error"),
    ("bearing_defect", "backlash"),
    ("coulomb_friction", "viscous_friction"),
    ("torque_offset", "tooth_damage"),
    ("friction_drift", "eccentricity"),
)
CONFOUNDED = ("eccentricity", "encoder_error", "torque_offset", "friction_asymmetry", "stiffness_hardening")
NEED_LOAD_ENCODER = frozenset({"encoder_error", "stiffness_hardening", "hysteresis", "structural_resonance"})
HEARD = ("tooth_damage", "backlash", "bearing_defect", "electrical_hum", "clipping")
COMPARED = ("mesh_error", "structural_resonance")
RECORDED_TWICE = (
    "friction_asymmetry",
    "load_dependent_loss",
    "stiffness_hardening",
    "gravity_imbalance",
    "eccentricity",
    "stribeck_friction",
)


@dataclass(frozen=True)
class Recipe:
    """What to hide: `effects` are keys of EFFECTS, `level` a key of LEVELS.

    `whole_transmission` and `teeth` shape the description, the last two what is recorded.
    """

    group: str
    kind: str
    effects: tuple[str, ...] = ()
    level: str = "full"
    load_encoder: bool = True
    telemetry: bool = True
    sound: bool = True
    noise: str = "stationary"
    whole_transmission: bool = False
    teeth: bool = True
    reference: bool = True
    speed_channel: bool = False


def _effects_of(rng: np.random.Generator, group: str) -> tuple[str, ...]:
    if group == "mechanics":
        return (str(rng.choice([f.__name__ for f in PLANT_EFFECTS + SOUND_EFFECTS])),)
    if group == "sensor":
        return (str(rng.choice([f.__name__ for f in SENSOR_EFFECTS])),)
    if group == "unnamed":
        return (str(rng.choice([f.__name__ for f in UNNAMED_EFFECTS])),)
    if group == "two":
        return PAIRS[int(rng.integers(len(PAIRS)))]
    if group == "confounded":
        return (str(rng.choice(CONFOUNDED)),)
    if group == "sound alone":
        return (str(rng.choice(HEARD)),)
    if group == "sound compared":
        return (str(rng.choice(COMPARED)),)
    if group == "several":
        return (str(rng.choice(RECORDED_TWICE)),)
    return ()


def draw_recipe(
    seed: int,
    group: str | None = None,
    effects: tuple[str, ...] | None = None,
    level: str | None = None,
    kind: str | None = None,
    load_encoder: bool | None = None,
) -> Recipe:
    """Draw a recipe; what is given is kept, as far as it is physically possible."""
    rng = np.random.default_rng([seed, 1])
    group = group or str(rng.choice(GROUPS, p=[0.2, 0.06, 0.38, 0.1, 0.08, 0.08, 0.04, 0.04, 0.02, 0.0, 0.0, 0.0, 0.0]))
    drawn = _effects_of(rng, group)
    effects = drawn if effects is None else effects
    unknown = set(effects) - set(EFFECTS)
    if unknown:
        raise ValueError(f"effects must be of {sorted(EFFECTS)}, got {sorted(unknown)}")
    alone = group.startswith("sound")
    geared = alone or any(name in GEARED | {"bearing_defect"} for name in effects)
    drawn_kind = str(rng.choice(KINDS[:2], p=[0.7, 0.3]) if geared else rng.choice(KINDS, p=[0.55, 0.3, 0.15]))
    kind = kind or drawn_kind
    if geared and kind == "direct drive":
        raise ValueError(f"{effects} need a gear, got direct drive")
    levels = ["strong", "full"] if group in ("unnamed", "confounded") else list(LEVELS)
    drawn_level = str(rng.choice(levels))
    drawn_encoder = bool(rng.random() < 0.72)
    sound, reference, speed_channel = rng.random() < 0.85, rng.random() < 0.85, rng.random() < 0.15
    noise, whole, teeth = str(rng.choice(STYLES, p=[0.6, 0.2, 0.2])), rng.random() < 0.2, rng.random() < 0.9
    if load_encoder is None:
        load_encoder = drawn_encoder or bool(NEED_LOAD_ENCODER & set(effects))
    if group == "confounded" and effects == ("eccentricity",):
        load_encoder = False
    needs_teeth = alone or any(name in ("mesh_error", "tooth_damage") for name in effects)
    return Recipe(
        group,
        kind,
        effects,
        level or drawn_level,
        load_encoder=load_encoder and not alone,
        telemetry=not alone,
        sound=(bool(sound) or alone or "bearing_defect" in effects) and not group.startswith("several"),
        noise=noise,
        whole_transmission=bool(whole) and kind == "three shafts" and not alone,
        teeth=bool(teeth) or needs_teeth,
        reference=bool(reference),
        speed_channel=bool(speed_channel),
    )
