"""The smallest fault that would be heard in a recording: what "no fault" cannot exclude.

Of cases of known size it is known by how much their bump stands out. In a recording with more noise it stands out by
less (`left_db`). Whether it would still be heard is logistic in the logarithm of the size; the limit is the
size that nine of ten times would be heard. It holds for the axis of the cases, and for no other; and simulated cases
say nothing of what a microphone hears, so the cases are of the origin of the recording.

Source: Kay, Fundamentals of Statistical Signal Processing, volume II, Detection Theory (1998); Gelman and others, A
weakly informative default prior for logistic regression, Annals of Applied Statistics 2 (2008), the bounded slope.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import special
from sqlalchemy.orm import Session

from casebase.reasoning.severity import FEWEST, PARAMETERS, sized
from casebase.search.case_table import CaseTable
from casebase.search.similarity import Floats

HEARD = 0.9
NOISE = "noise_on_the_way_12_200_hz"
BUMP_OF = {"notch": "notch_bump_12_200_hz", "play": "play_bump_12_200_hz"}
WORTH_SAYING_DB = 3.0
"""A lower bump is what noise makes [dB]."""
WEIGHT_OF_PRIOR = 0.1
"""Slope of the logistic is drawn to 0 as by a normal prior of standard deviation sqrt(10) per e-fold of the size."""

Limits = Mapping[str, Mapping[str, float] | None]
NO_LIMITS: Limits = dict.fromkeys(PARAMETERS)


def left_db(height_db: Floats, noise_db: Floats, here_db: float) -> Floats:
    """Return by how much bumps would still stand out in another recording, shape (cases,) [dB].

    With d dB more noise a bump of h dB stands out by 10 lg(1 + (10^(h/10) - 1) / 10^(d/10)).

    Args:
        height_db: by how much they stand out, shape (cases,) [dB].
        noise_db: noise that each was recorded in, shape (cases,) [dB].
        here_db: noise of the other recording; less than where they were recorded does not raise them [dB].
    """
    more = 10 ** (np.maximum(here_db - noise_db, 0.0) / 10)
    return np.asarray(10 * np.log10(1 + np.maximum(10 ** (height_db / 10) - 1, 0.0) / more))


def detection_limits(
    session: Session, table: CaseTable, axis: str | None, values: NDArray[np.floating], origin: str
) -> Limits:
    """Return, per label that has a size, the smallest one that would be heard [rad]; None where that cannot be said.

    Args:
        axis: of the recording; without one, or without cases of it whose size is known, nothing is said.
        values: features of the recording, shape (n,).
        origin: of the recording, `measured` or `simulated`.
    """
    return {label: _limit(session, table, axis, values, label, origin) for label in PARAMETERS}


def _limit(
    session: Session, table: CaseTable, axis: str | None, values: NDArray[np.floating], label: str, origin: str
) -> dict[str, float] | None:
    names = table.names
    if axis is None or NOISE not in names or BUMP_OF[label] not in names:
        return None
    here = float(values[names.index(NOISE)])
    rows, sizes = sized(session, table, axis, label, origin)
    if rows.size < FEWEST or not np.isfinite(here) or not np.isfinite(values[names.index(BUMP_OF[label])]):
        return None
    height, noise = (table.values[rows, names.index(name)].astype(np.float64) for name in (BUMP_OF[label], NOISE))
    known = np.isfinite(height) & np.isfinite(noise)
    if known.sum() < FEWEST:
        return None
    heard = left_db(height[known], noise[known], here) > WORTH_SAYING_DB
    size = smallest_heard(sizes[known], heard)
    return None if size is None else {PARAMETERS[label]: size}


def smallest_heard(sizes: Floats, heard: NDArray[np.bool_]) -> float | None:
    """Return the size that is heard nine times in ten; None if the largest is not, the smallest if all are.

    Args:
        sizes: shape (cases,), > 0.
        heard: shape (cases,).
    """
    if heard.all():
        return float(sizes.min())
    from scipy.optimize import minimize  # slow to import

    logarithm = np.log(sizes)
    middle = float(logarithm.mean())
    columns = np.column_stack([np.ones_like(logarithm), logarithm - middle])

    def loss(parameters: Floats) -> tuple[float, Floats]:
        score = columns @ parameters
        pull = special.expit(score) - heard
        value = float(np.sum(np.logaddexp(0, score) - heard * score)) + WEIGHT_OF_PRIOR / 2 * parameters[1] ** 2
        return value, columns.T @ pull + np.array([0.0, WEIGHT_OF_PRIOR * parameters[1]])

    offset, slope = minimize(loss, np.zeros(2), jac=True, method="L-BFGS-B", bounds=[(-50, 50), (0, None)]).x
    if slope <= 0:
        return None
    limit = float(np.exp(middle + (special.logit(HEARD) - offset) / slope))
    return max(limit, float(sizes.min())) if limit <= sizes.max() else None
