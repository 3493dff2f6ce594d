"""Envelope spectrum: how the sound is modulated by what turns."""

import math
from collections.abc import Sequence

from signals import envelope
from signals.analysis import Analysis
from signals.band import Band
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition

OCTAVES_HZ = tuple((2.0**k, 2.0 ** (k + 1)) for k in range(1, 9))
SOURCE = "squared envelope spectrum; Randall and Antoni 2011"


class Modulation(FeatureFamily):
    """Power of the squared envelope above 1 kHz per octave of modulation."""

    definitions = (
        *(
            FeatureDefinition(
                f"modulation_{low:.0f}_{high:.0f}_hz",
                "dB",
                f"How strongly the sound above 1 kHz swells {low:.0f} to {high:.0f} times a second: shafts, "
                "damaged teeth and bearings modulate at their own rates.",
                SOURCE,
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
        frequency, power = envelope.envelope_spectrum(calm, band.rate_hz)
        step = frequency[1]
        octaves = []
        for low, high in OCTAVES_HZ:
            part = power[math.ceil(low / step) : math.ceil(high / step)]
            known = low * analysis.duration_s >= 1 and part.size > 0
            octaves.append(10 * math.log10(float(part.sum())) if known and part.any() else math.nan)
        return octaves
