"""What physics says about features before a library has said anything: which ones tell faults apart.

A feature that no line here speaks of counts 1. The sentences are the reason; they are shown with the weights.
"""

import functools

import numpy as np

from casebase.search.similarity import Floats
from signals.features import catalogue

LEVEL = "a level depends on the gain of the microphone, which nobody calibrated: shown, never compared"
FOLDED = "a tooth with a notch or a gear with play strikes at the same place of every cycle of the motion"
IMPACT = "an impact rises above the noise in the band that the gear excites, wherever it falls in time"
UPPER = "impacts reach higher bands too, as far as the housing and the place of the microphone let them"
SPREAD = "crest factor and kurtosis rise with impacts, but with any other knock as well"
CYCLIC = "impacts at a steady rate while the axis moves are of a bearing or of wear, and not of a notch or play"
MESH = "wear and eccentricity change the lines of the mesh and their sidebands"
COLOUR = "the colour of the sound tells more of housing and microphone than of the gear"

HEARD = "it says how well a fault would be heard, not whether there is one"
WHOLE = "a brake or an arm that comes to rest knocks at standstill: shown, compared by windows on the way"
MOTION = "that the sound follows the motion tells a gear from other sounds, not one fault from another"

PRIORS: tuple[tuple[str, float, str], ...] = (
    ("cycles_left", 0.0, HEARD),
    ("share_left_out", 0.0, HEARD),
    ("standstill_fall", 0.0, HEARD),
    ("noise_on_the_way", 0.0, HEARD),
    ("unrepeated_share", 0.0, HEARD),
    ("louder_after_start", 0.0, HEARD),
    ("low_band_level", 0.0, HEARD),
    ("rms", 0.0, LEVEL),
    ("peak", 0.0, LEVEL),
    ("crest_factor_whole_record", 0.0, WHOLE),
    ("crest_factor_low_pass_200_hz_whole_record", 0.0, WHOLE),
    ("crest_factor_median", 0.5, SPREAD),
    ("crest_factor", 1.0, SPREAD),
    ("kurtosis", 1.0, SPREAD),
    ("notch_bump_12_200", 12.0, FOLDED),
    ("play_bump_12_200", 12.0, FOLDED),
    ("both_directions_bump_12_200", 4.0, FOLDED),
    ("standstill_bump_12_200", 4.0, FOLDED),
    ("notch_bump", 2.0, UPPER),
    ("play_bump", 2.0, UPPER),
    ("both_directions_bump", 1.0, UPPER),
    ("standstill_bump", 1.0, UPPER),
    ("strongest_impulse_12_200", 4.0, IMPACT),
    ("spectral_kurtosis_12_200", 4.0, IMPACT),
    ("impulse_rate", 2.0, IMPACT),
    ("strongest_impulse", 1.0, UPPER),
    ("spectral_kurtosis", 1.0, UPPER),
    ("mesh", 1.0, MESH),
    ("envelope_line", 1.0, CYCLIC),
    ("modulation", 0.2, COLOUR),
    ("band_level", 0.1, COLOUR),
    ("loudness_fall", 0.0, MOTION),
)
"""(how the feature's name begins, weight, why); the first line that fits holds."""

KIND: dict[str, float] = {IMPACT: 0.5, UPPER: 0.25, SPREAD: 0.25}
"""What is left of a weight when the question is the kind of a fault: any impact raises these, the harder the more."""
REPEATABILITY_DB = 0.5
"""Two recordings of the same thing differ by so much in a level above its surroundings."""


@functools.lru_cache
def prior_weights(names: tuple[str, ...]) -> Floats:
    """Return the weight of every feature before learning, shape (n,), sum 1."""
    weights = np.array([prior_of(name)[0] for name in names])
    return np.asarray(weights / weights.sum())


def prior_of(name: str) -> tuple[float, str]:
    """Return the weight of a feature and why."""
    for beginning, weight, why in PRIORS:
        if name.startswith(beginning):
            return weight, why
    return 1.0, "nothing is known of it beforehand"


@functools.lru_cache
def even_weights(names: tuple[str, ...]) -> Floats:
    """Return the same weight for every feature that may be compared at all, shape (n,), sum 1."""
    weights = np.array([float(prior_of(name)[0] > 0) for name in names])
    return np.asarray(weights / weights.sum())


@functools.lru_cache
def kind_weights(names: tuple[str, ...]) -> Floats:
    """Return how much every feature says about the kind of a fault, shape (n,), sum 1."""
    weights = np.array([weight * KIND.get(why, 1.0) for weight, why in map(prior_of, names)])
    return np.asarray(weights / weights.sum())


@functools.lru_cache
def repeatability(names: tuple[str, ...]) -> Floats:
    """Return what every feature differs by between recordings of the same thing, shape (n,); 0 where unknown."""
    known = catalogue()
    return np.array([REPEATABILITY_DB if name in known and known[name].unit == "dB" else 0.0 for name in names])
