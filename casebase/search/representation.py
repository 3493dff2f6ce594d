"""Representations of a recording: which features of the stored vector a search compares, and how much each counts."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches

import numpy as np

from casebase.errors import InvalidRequestError
from casebase.reasoning.priors import prior_of
from casebase.search.similarity import Floats

CREST_FACTORS = (
    "crest_factor_low_pass_200_hz_whole_record",
    "crest_factor_low_pass_200_hz_mean_of_1_s_windows",
)
BANDS = "band_level_"
NAMED = 3
"""Names that are told where one is not known."""


def full(name: str) -> float:
    """Return the weight that physics gives a feature before anything is learned; 0 for what is never compared."""
    return prior_of(name)[0]


def paper(name: str) -> float:
    """Return the weight of a feature in the vector of Olsson and Stolyarchuk, who give no weights: 1 for each.

    It has 18 numbers, all of them features of the stored vector:

    - the bands of the FFT, `band_level_*`: the power of the whole record's FFT in 16 bands, half-octaves from 16 Hz to
      2.9 kHz and one up to 3.8 kHz, in decibel against the mean of all bands, since the microphone's gain is unknown;
    - the crest factor below 200 Hz by equation (1): the peak over the effective value of the record;
    - the same by equation (2): the mean over windows of 1 s while the axis moves.
    """
    return float(name in CREST_FACTORS or name.startswith(BANDS))


REPRESENTATIONS: Mapping[str, Callable[[str], float]] = {"full": full, "paper": paper}


def weights_of(names: tuple[str, ...], representation: str, instead: Mapping[str, float]) -> Floats:
    """Return the weight of every feature in a representation, shape (n,).

    Args:
        instead: weights by the name of a feature, or by how names begin, that replace those of the representation;
            the longer beginning holds, and a whole name before any.

    Raises:
        InvalidRequestError: if a name fits no feature, or no weight is above zero.
    """
    weights = np.array([REPRESENTATIONS[representation](name) for name in names])
    for beginning in sorted(instead, key=lambda each: (each in names, len(each))):
        fitting = [name == beginning if beginning in names else name.startswith(beginning) for name in names]
        if not any(fitting):
            nearest = get_close_matches(beginning, names, n=NAMED, cutoff=0.0)
            raise InvalidRequestError(
                f"weights: no feature is called {beginning!r} or begins so; the nearest names are {', '.join(nearest)}"
            )
        weights[fitting] = instead[beginning]
    if not weights.any():
        raise InvalidRequestError("weights: all are 0; at least one feature must count")
    return weights
