"""Lines of the squared envelope while the axis moves: what strikes at a steady rate, as a flawed bearing does."""

import math
from collections.abc import Sequence

from signals import envelope
from signals.analysis import Analysis
from signals.band import Band
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition
from signals.synchronous_average import noise_peak_db

LINES_HZ = (4.0, 300.0)
"""Rates at which rollers, shafts and worn teeth of an axis strike [Hz]."""
SURROUNDINGS_HZ = 24.0
"""A line is held against the median of so much around it [Hz]."""
BANDS = (Band.MIDDLE, Band.HIGH)


class EnvelopeLines(FeatureFamily):
    """Highest line of the envelope spectrum on the way, above what noise would reach, in two bands."""

    definitions = tuple(
        FeatureDefinition(
            f"envelope_line_{band.label}",
            "dB",
            "Highest line of the envelope spectrum between reversals above what noise would reach: impacts at a steady "
            "rate while the axis moves, as of a flawed bearing or a worn tooth that meets at every turn. A notch and "
            "play strike once per stroke and make none.",
            "squared envelope spectrum (Randall and Antoni 2011), averaged over strokes (Welch 1967)",
        )
        for band in BANDS
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return the height in each band; NaN without the band or without a way long enough."""
        return [self._line_db(analysis, band) for band in BANDS]

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
