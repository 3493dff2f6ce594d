"""Templates of usual gear units: a description to begin with, whose numbers the data sheet then replaces.

Ratio, efficiency and backlash (0.5 to 6 arc minutes) are those that catalogues of such units usually give; inertias
are placeholders of the size of a medium robot joint.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

MOTOR = {"inertia_kg_m2": 0.0005}
LOAD = {"inertia_kg_m2": 5.0}


@dataclass(frozen=True)
class Template:
    """A usual gear unit: words, and its stages as in a description."""

    words: str
    stages: tuple[Mapping[str, Any], ...]

    def document(self, name: str) -> dict[str, Any]:
        """Return the description of an axis that has it."""
        stages = [dict(stage) for stage in self.stages]
        return {"name": name, "motor": dict(MOTOR), "load": dict(LOAD)} | ({"stages": stages} if stages else {})


TEMPLATES = {
    "spur": Template(
        "Spur or helical gears, two stages",
        (
            {"name": "first", "driver_teeth": 17, "driven_teeth": 85, "inertia_kg_m2": 0.001, "mesh_efficiency": 0.98},
            {"name": "output", "driver_teeth": 15, "driven_teeth": 90, "backlash_rad": 1.2e-3},
        ),
    ),
    "planetary": Template("Planetary gear, one stage", ({"name": "output", "ratio": 10.0, "backlash_rad": 0.9e-3},)),
    "cycloidal": Template(
        "Cycloidal gear with a spur stage before it (RV)",
        (
            {"name": "spur", "ratio": 3.0, "inertia_kg_m2": 0.001},
            {"name": "cycloid", "ratio": 40.0, "mesh_efficiency": 0.85, "backlash_rad": 0.3e-3},
        ),
    ),
    "strain_wave": Template(
        "Strain wave gear",
        ({"name": "flexspline", "ratio": 100.0, "mesh_efficiency": 0.75, "backlash_rad": 0.15e-3},),
    ),
    "worm": Template(
        "Worm gear",
        ({"name": "wheel", "ratio": 40.0, "mesh_efficiency": 0.7, "backlash_rad": 1.7e-3},),
    ),
    "belt": Template(
        "Toothed belt", ({"name": "pulley", "driver_teeth": 20, "driven_teeth": 60, "mesh_efficiency": 0.97},)
    ),
    "direct": Template("No gear: the motor turns the load", ()),
}
