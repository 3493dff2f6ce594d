"""Several faults at once: would the recording be nearer to a case if that case had a second fault, too?

A library has cases of one fault each. Two faults strike at places of their own, and of two sounds the stronger one is
what is heard; so a case of both is made of two cases, each feature from the one that is farther from normal. Of a
recording whose leading fault is known, it is then voted whether the nearest cases of that fault alone or those with
the second one are nearer: as many of the one as of the other.

Source: Nádas, Nahamoo, Picheny, Speech recognition using noise-adaptive prototypes, IEEE Trans. ASSP 37 (1989), the
maximum of two sounds in decibels for their sum; Zhang and Zhou, ML-KNN, Pattern Recognition 40 (2007), a probability
per label.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from casebase.case_table import CaseTable, Mask
from casebase.novelty import BASELINES, spread_out, superposed
from casebase.similarity import Floats, Metric, robust_scales
from casebase.voting import NEAREST, log_votes

MOST_CASES = 200
"""More cases of a fault than so many, evenly spread, tell nothing more [1]."""
PRESENT = 0.5
"""A second fault is listed from there on: it is then more probable than not."""


@dataclass(frozen=True)
class Fault:
    """A fault that is present, with its probability."""

    label: str
    probability: float

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {"label": self.label, "probability": self.probability}


def faults(
    table: CaseTable,
    voters: Mask,
    metric: Metric,
    sharpness: float,
    values: NDArray[np.floating],
    hypotheses: Sequence[tuple[str, float]],
) -> tuple[Fault, ...]:
    """Return every fault that is present, the leading label first; none where that is of a sound gear.

    Args:
        voters: the cases that vote, shape (cases,).
        values: features of the recording, shape (n,).
        hypotheses: labels with their probabilities, the most probable first.
    """
    if not hypotheses or hypotheses[0][0] in BASELINES:
        return ()
    leading, probability = hypotheses[0]
    found = [Fault(leading, probability)]
    for label, alone in hypotheses[1:]:
        if label in BASELINES:
            continue
        both = alone + probability * _beside(table, voters, metric, sharpness, values, leading, label)
        if both > PRESENT:
            found.append(Fault(label, min(both, probability)))
    return (found[0], *sorted(found[1:], key=lambda fault: -fault.probability))


def _beside(
    table: CaseTable,
    voters: Mask,
    metric: Metric,
    sharpness: float,
    values: NDArray[np.floating],
    first: str,
    second: str,
) -> float:
    """Return how probable a second fault is beside the first; 0 where normal is not known to hold them against."""
    normal = table.values[voters & np.isin(table.labels, BASELINES)]
    if not len(normal):
        return 0.0
    ones, others = (_of(table, voters, label) for label in (first, second))
    if not len(ones) or not len(others):
        return 0.0
    both = superposed(ones, others, robust_scales(normal)[0], metric.scale)
    squares = [_nearest(metric, values, cases) for cases in (ones, both)]
    return float(np.exp(log_votes(np.stack(squares)[None], sharpness)[0, 1]))


def _of(table: CaseTable, voters: Mask, label: str) -> Floats:
    rows = spread_out(np.flatnonzero(voters & (table.labels == label)), MOST_CASES)
    return np.asarray(table.values[rows], np.float64)


def _nearest(metric: Metric, values: NDArray[np.floating], cases: Floats) -> Floats:
    """Return the squared distances to the nearest cases, shape (NEAREST,), infinite where there are fewer."""
    query, known = metric.scaled(values), metric.scaled(cases)
    weights = np.where(np.isfinite(query), metric.weights, 0.0)
    weights = weights / max(float(weights.sum()), 1e-12)
    query = np.nan_to_num(query)
    apart = np.where(np.isfinite(known), (query - np.nan_to_num(known)) ** 2, query**2 + 1)
    squares = np.sort(apart @ weights)[:NEAREST]
    return np.pad(squares, (0, NEAREST - squares.size), constant_values=np.inf)
