"""Mesh orders: lines at the rate of tooth engagement, where axis and speed are known."""

import math
from collections.abc import Sequence

from signals.analysis import Analysis
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition
from signals.orders import line_db, sidebands_db

MESHES = 2
SOURCE = "gear mesh frequency and its sidebands; Randall, Vibration-based Condition Monitoring, 2011, chapter 2"


class Meshing(FeatureFamily):
    """Mesh line, its second harmonic and its sidebands, for the first two meshes from the motor."""

    of_the_gear = False
    definitions = tuple(
        FeatureDefinition(f"mesh_{mesh}_{name}", "dB", sentence, SOURCE)
        for mesh in range(1, MESHES + 1)
        for name, sentence in (
            ("line", "Line at the rate of tooth engagement over its surroundings: transmission error and wear."),
            ("second_harmonic", "Line at twice the rate of tooth engagement: misalignment and worn flanks."),
            (
                "sidebands",
                "Lines at one and two turns of the driven shaft beside the mesh: eccentricity and local "
                "damage modulate the mesh.",
            ),
        )
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return three values per mesh; NaN without speed, mesh orders, or the mesh."""
        values: list[float] = []
        condition = analysis.condition
        for mesh in range(MESHES):
            if condition.speed_rad_s is None or mesh >= len(condition.mesh_orders):
                values += [math.nan] * 3
                continue
            output_hz = condition.speed_rad_s / (2 * math.pi)
            mesh_hz = condition.mesh_orders[mesh] * output_hz
            spectrum, highest_hz = analysis.spectrum, analysis.highest_hz
            values.append(line_db(spectrum, mesh_hz, highest_hz))
            values.append(line_db(spectrum, 2 * mesh_hz, highest_hz))
            known = mesh + 1 < len(condition.shaft_orders)
            shaft_hz = condition.shaft_orders[mesh + 1] * output_hz if known else math.nan
            values.append(sidebands_db(spectrum, mesh_hz, shaft_hz, highest_hz) if known else math.nan)
        return values
