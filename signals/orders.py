"""Orders: lines that follow the speed of a shaft."""

import math

import numpy as np

from signals.spectra import LongSpectrum

TOLERANCE = 0.015
"""Relative error that speed and slip may have [1]."""

SURROUNDINGS = 0.1
"""Relative distance up to which the background is taken [1]."""


def line_db(spectrum: LongSpectrum, frequency_hz: float, highest_hz: float) -> float:
    """Return how far the strongest bin near a frequency is above the median around it [dB].

    NaN where the recording does not reach, or is too short to tell the line from its surroundings.
    """
    if frequency_hz * (1 + SURROUNDINGS) > highest_hz:
        return math.nan
    near = spectrum.bins(frequency_hz * (1 - TOLERANCE), frequency_hz * (1 + TOLERANCE))
    around = spectrum.bins(frequency_hz * (1 - SURROUNDINGS), frequency_hz * (1 + SURROUNDINGS))
    if near.stop - near.start < 1 or around.stop - around.start < 8:
        return math.nan
    background = float(np.median(spectrum.windowed_power[around]))
    highest = float(spectrum.windowed_power[near].max())
    return 10 * math.log10(highest / background) if background > 0 and highest > 0 else math.nan


def sidebands_db(spectrum: LongSpectrum, mesh_hz: float, shaft_hz: float, highest_hz: float) -> float:
    """Return the mean height of the first two sidebands on either side of a mesh frequency [dB]; NaN as above."""
    frequencies = [mesh_hz + k * shaft_hz for k in (-2, -1, 1, 2)]
    heights = [line_db(spectrum, frequency, highest_hz) for frequency in frequencies if frequency > 0]
    return float(np.mean(heights)) if len(heights) == 4 else math.nan
