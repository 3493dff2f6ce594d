"""Lines: what turns, meshes or strikes at a steady rate."""

import math
from collections.abc import Sequence

import numpy as np

from signals import envelope
from signals.analysis import Analysis
from signals.band import Band
from signals.features.vector import FeatureDefinition, FeatureFamily
from signals.half_cycles import noise_peak_db
from signals.spectra import LongSpectrum

TOLERANCE = 0.015
"""Relative error that speed and slip may have [1]."""

MESH_SURROUNDINGS = 0.1
"""Relative distance up to which the background is taken [1]."""


def mesh_line_db(spectrum: LongSpectrum, frequency_hz: float, highest_hz: float) -> float:
    """Return how far the strongest bin near a frequency is above the median around it [dB].

    NaN where the recording does not reach, or is too short to tell the line from its surroundings.
    """
    if frequency_hz * (1 + MESH_SURROUNDINGS) > highest_hz:
        return math.nan
    near = spectrum.bins(frequency_hz * (1 - TOLERANCE), frequency_hz * (1 + TOLERANCE))
    around = spectrum.bins(frequency_hz * (1 - MESH_SURROUNDINGS), frequency_hz * (1 + MESH_SURROUNDINGS))
    if near.stop - near.start < 1 or around.stop - around.start < 8:
        return math.nan
    background = float(np.median(spectrum.windowed_power[around]))
    highest = float(spectrum.windowed_power[near].max())
    return 10 * math.log10(highest / background) if background > 0 and highest > 0 else math.nan


def sidebands_db(spectrum: LongSpectrum, mesh_hz: float, shaft_hz: float, highest_hz: float) -> float:
    """Return the mean height of the first two sidebands on either side of a mesh frequency [dB]; NaN as above."""
    frequencies = [mesh_hz + k * shaft_hz for k in (-2, -1, 1, 2)]
    heights = [mesh_line_db(spectrum, frequency, highest_hz) for frequency in frequencies if frequency > 0]
    return float(np.mean(heights)) if len(heights) == 4 else math.nan


MESHES = 2
OF_MESHES = "gear mesh frequency and its sidebands; Randall, Vibration-based Condition Monitoring, 2011, chapter 2"


class Meshing(FeatureFamily):
    """Mesh line, its second harmonic and its sidebands, for the first two meshes from the motor."""

    of_the_gear = False
    definitions = tuple(
        FeatureDefinition(f"mesh_{mesh}_{name}", "dB", sentence, OF_MESHES)
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
            values.append(mesh_line_db(spectrum, mesh_hz, highest_hz))
            values.append(mesh_line_db(spectrum, 2 * mesh_hz, highest_hz))
            known = mesh + 1 < len(condition.shaft_orders)
            shaft_hz = condition.shaft_orders[mesh + 1] * output_hz if known else math.nan
            values.append(sidebands_db(spectrum, mesh_hz, shaft_hz, highest_hz) if known else math.nan)
        return values


OCTAVES_HZ = tuple((2.0**k, 2.0 ** (k + 1)) for k in range(1, 9))
OF_MODULATION = "squared envelope spectrum; Randall and Antoni 2011"


class Modulation(FeatureFamily):
    """Power of the squared envelope above 1 kHz per octave of modulation."""

    definitions = (
        *(
            FeatureDefinition(
                f"modulation_{low:.0f}_{high:.0f}_hz",
                "dB",
                f"How strongly the sound above 1 kHz swells {low:.0f} to {high:.0f} times a second: shafts, "
                "damaged teeth and bearings modulate at their own rates.",
                OF_MODULATION,
            )
            for low, high in OCTAVES_HZ
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return the octaves, NaN where the record is too short for them."""
        band = analysis.envelope(Band.HIGH)
        if band is None:
            return [math.nan] * len(self.definitions)
        calm = analysis.calmed(band.inside(), band.rate_hz)
        found = envelope.averaged_spectrum([calm], band.rate_hz)
        if found is None:
            return [math.nan] * len(self.definitions)
        octaves = []
        for low, high in OCTAVES_HZ:
            part = found.power[math.ceil(low / found.step_hz) : math.ceil(high / found.step_hz)]
            known = low * analysis.duration_s >= 1 and part.any()
            octaves.append(10 * math.log10(2 / calm.size * float(part.sum())) if known else math.nan)
        return octaves


LINES_HZ = (4.0, 300.0)
"""Rates at which rollers, shafts and worn teeth of an axis strike [Hz]."""
SURROUNDINGS_HZ = 24.0
"""A line is held against the median of so much around it [Hz]."""
LINE_BANDS = (Band.MIDDLE, Band.HIGH)


class EnvelopeLines(FeatureFamily):
    """Highest line of the envelope spectrum on the way, above what noise would reach, in two bands."""

    definitions = tuple(
        FeatureDefinition(
            f"envelope_line_{band.label}",
            "dB",
            "Highest line of the envelope spectrum between reversals above what noise would reach: impacts at a steady "
            "rate while the axis moves, as of a flawed bearing or a worn tooth that meets at every turn. Damaged teeth "
            "and backlash strike once per stroke and make none.",
            "squared envelope spectrum (Randall and Antoni 2011), averaged over strokes (Welch 1967)",
        )
        for band in LINE_BANDS
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return the height in each band; NaN without the band or without a way long enough."""
        return [self._line_db(analysis, band) for band in LINE_BANDS]

    @staticmethod
    def _line_db(analysis: Analysis, band: Band) -> float:
        whole = analysis.envelope(band)
        if whole is None:
            return math.nan
        power, rate_hz = whole.inside(), whole.rate_hz
        pieces = [power[int(span.start_s * rate_hz) : int(span.end_s * rate_hz)] for span in analysis.ways()]
        found = envelope.averaged_spectrum(pieces, rate_hz)
        if found is None:
            return math.nan
        relative_db, independent = envelope.over_surroundings_db(found, LINES_HZ, SURROUNDINGS_HZ)
        if independent < 1:
            return math.nan
        return float(relative_db.max()) - noise_peak_db(1, 2.0 * found.pieces, independent)
