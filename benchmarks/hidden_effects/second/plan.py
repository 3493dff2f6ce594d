"""Which scenarios are made: what each hides, how large, in which motion and noise, and what is measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Entry:
    """One scenario: `hidden` gives each effect its gear, channel or kind, None if it has none.

    `mistaken` is what the description has wrong by 15 to 30 %; `level` is a key of LEVELS, or null.
    """

    motion: str
    hidden: Mapping[str, str | None] = field(default_factory=dict)
    level: str = "null"
    load_encoder: bool = True
    noise: str = "plain"
    mistaken: str | None = None


NOTHING = (
    Entry("trapezoid"),
    Entry("trapezoid", noise="burst"),
    Entry("multisine"),
    Entry("multisine", load_encoder=False, noise="twice"),
    Entry("varied"),
    Entry("varied", load_encoder=False),
    Entry("mixture", noise="load"),
    Entry("mixture", noise="twice"),
    Entry("trapezoid", load_encoder=False, noise="load"),
    Entry("varied", noise="burst"),
    Entry("multisine", noise="load"),
    Entry("trapezoid", mistaken="payload"),
    Entry("varied", mistaken="friction"),
    Entry("mixture", mistaken="stiffness"),
)
ONE = (
    Entry("trapezoid", {"backlash": "output"}, "full"),
    Entry("multisine", {"backlash": "output"}, "half"),
    Entry("mixture", {"backlash": "output"}, "quarter"),
    Entry("varied", {"backlash": "transfer"}, "full", noise="burst"),
    Entry("trapezoid", {"tooth_damage": "output"}, "full", noise="twice"),
    Entry("mixture", {"tooth_damage": "output"}, "half"),
    Entry("varied", {"tooth_damage": "transfer"}, "full"),
    Entry("multisine", {"eccentricity": "transfer"}, "full"),
    Entry("varied", {"eccentricity": "transfer"}, "half", noise="load"),
    Entry("mixture", {"eccentricity": "transfer"}, "quarter"),
    Entry("varied", {"mesh_error": "output"}, "full"),
    Entry("mixture", {"mesh_error": "transfer"}, "full"),
    Entry("mixture", {"coulomb_friction": None}, "full"),
    Entry("varied", {"coulomb_friction": None}, "half", load_encoder=False),
    Entry("varied", {"viscous_friction": None}, "full", noise="burst"),
    Entry("multisine", {"viscous_friction": None}, "quarter", load_encoder=False),
    Entry("mixture", {"stribeck_friction": None}, "full", load_encoder=False),
    Entry("varied", {"stribeck_friction": None}, "half"),
    Entry("multisine", {"stribeck_friction": None}, "quarter"),
    Entry("varied", {"friction_asymmetry": None}, "full"),
    Entry("mixture", {"friction_asymmetry": None}, "half", load_encoder=False),
    Entry("varied", {"load_dependent_loss": None}, "full"),
    Entry("trapezoid", {"friction_drift": None}, "full"),
    Entry("varied", {"friction_drift": None}, "half", load_encoder=False),
    Entry("multisine", {"gravity_imbalance": None}, "full"),
    Entry("trapezoid", {"gravity_imbalance": None}, "half", load_encoder=False),
    Entry("varied", {"gravity_imbalance": None}, "quarter"),
    Entry("varied", {"torque_ripple": "motor"}, "full", load_encoder=False),
    Entry("mixture", {"torque_ripple": "motor"}, "half"),
    Entry("trapezoid", {"stiffness_hardening": None}, "full"),
    Entry("mixture", {"stiffness_hardening": None}, "half"),
    Entry("varied", {"hysteresis": None}, "full"),
    Entry("trapezoid", {"bearing_defect": None}, "full"),
    Entry("mixture", {"bearing_defect": None}, "half", load_encoder=False),
    Entry("varied", {"structural_resonance": None}, "full"),
    Entry("varied", {"torque_offset": None}, "full", load_encoder=False),
    Entry("mixture", {"torque_offset": None}, "half"),
    Entry("mixture", {"encoder_error": None}, "full"),
    Entry("trapezoid", {"time_delay": "load"}, "full"),
    Entry("varied", {"time_delay": "torque"}, "half"),
    Entry("varied", {"electrical_hum": None}, "full"),
    Entry("multisine", {"electrical_hum": None}, "quarter", load_encoder=False),
    Entry("varied", {"clipping": None}, "full", load_encoder=False),
    Entry("mixture", {"lost_samples": "rows"}, "full"),
    Entry("varied", {"lost_samples": "held"}, "half"),
)
TWO = (
    Entry("trapezoid", {"backlash": "output", "gravity_imbalance": None}, "full"),
    Entry("varied", {"stribeck_friction": None, "eccentricity": "transfer"}, "full"),
    Entry("mixture", {"tooth_damage": "output", "viscous_friction": None}, "full"),
    Entry("varied", {"bearing_defect": None, "friction_drift": None}, "full", load_encoder=False),
    Entry("multisine", {"gravity_imbalance": None, "electrical_hum": None}, "half"),
    Entry("mixture", {"backlash": "output", "coulomb_friction": None}, "half"),
)
PLAN = NOTHING + ONE + TWO
