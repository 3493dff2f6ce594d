"""How large a fault is, from simulated cases of the same label, whose size is known.

The logarithm of the size is regressed on the features of the nearest simulated cases: a Gaussian process with a
linear and a local part, its two settings chosen by leave-one-out error, its interval the quantile of leave-one-out
errors (jackknife; Vovk, Gammerman, Shafer, Algorithmic Learning in a Random World, 2005).
Features count by how much they go with the size (Spearman), so that the housing and the microphone do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.case_table import CaseTable
from casebase.models import Case
from casebase.signals.features import catalogue
from casebase.similarity import Floats, robust_scales

PARAMETERS = {"play": "gap_rad", "notch": "depth_rad"}
"""What the size of a label is called in the contract."""
FEWEST, NEAREST = 12, 200
COVERAGE = 0.9
LENGTHS = (0.5, 1.0, 2.0)
NOISES = (0.03, 0.1, 0.3, 1.0)
LARGEST = 4.0  # scaled features are clipped here: beyond, an outlier would decide alone


@dataclass(frozen=True)
class Severity:
    """Size of a fault [rad] with an interval that holds it in nine of ten cases, and from how many cases."""

    parameter: str
    value: float
    low: float
    high: float
    cases: int

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {
            "parameter": self.parameter,
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "unit": "rad",
            "cases": self.cases,
            "coverage": COVERAGE,
        }


def severity_of(session: Session, table: CaseTable, label: str, values: NDArray[np.floating]) -> Severity | None:
    """Estimate the size of a fault; None where the label has no size or too few simulated cases have one.

    Args:
        values: features of the recording, shape (n,), NaN where missing.
    """
    if label not in PARAMETERS:
        return None
    statement = select(Case.id, Case.severity).where(
        Case.label == label, Case.origin == "simulated", Case.severity.is_not(None), Case.state == "confirmed"
    )
    size_of = {case_id: size for case_id, size in session.execute(statement)}  # noqa: C416
    rows = np.array([row for row, key in enumerate(table.ids) if str(key) in size_of], dtype=np.intp)
    if rows.size < FEWEST:
        return None
    sizes = np.array([size_of[str(table.ids[row])] for row in rows], dtype=np.float64)
    return estimate(PARAMETERS[label], table.values[rows], sizes, values)


def estimate(
    parameter: str,
    known: NDArray[np.floating],
    sizes: Floats,
    values: NDArray[np.floating],
    specimens: NDArray[np.intp] | None = None,
) -> Severity | None:
    """Estimate a size from cases of known size.

    Args:
        known: features of the cases, shape (cases, n).
        sizes: of the cases, shape (cases,), > 0.
        values: features of the recording, shape (n,).
        specimens: which cases are of the same specimen and are left out together, shape (cases,); each its own if None.
    """
    compared = np.array([definition.compared for definition in catalogue().values()])
    usable = compared & np.isfinite(values) & (np.isfinite(known).mean(axis=0) > 0.8)
    if not usable.any():
        return None
    center, scale = robust_scales(known[:, usable])
    scaled = _scaled(known[:, usable], center, scale)
    query = _scaled(values[None, usable], center, scale)
    logarithm = np.log(sizes)
    weights = _relevance(scaled, logarithm)
    scaled, query = scaled * weights, query * weights
    nearest = np.argsort(_distances(query, scaled)[0])[:NEAREST]
    together = np.arange(len(sizes)) if specimens is None else specimens
    log_value, errors = _regress(scaled[nearest], logarithm[nearest], query, together[nearest])
    reach = float(np.quantile(np.abs(errors), min(1.0, COVERAGE * (1 + 1 / errors.size))))
    value = float(np.clip(np.exp(log_value), sizes.min(), sizes.max()))
    return Severity(parameter, value, value * float(np.exp(-reach)), value * float(np.exp(reach)), int(nearest.size))


def _scaled(values: NDArray[np.floating], center: Floats, scale: Floats) -> Floats:
    return np.asarray(np.clip(np.nan_to_num((values - center) / scale), -LARGEST, LARGEST), dtype=np.float64)


def _relevance(scaled: Floats, target: Floats) -> Floats:
    """Return |rank correlation| with the target per column, less what chance gives."""
    from scipy.stats import rankdata  # half a second to import

    ranks = rankdata(scaled, axis=0)
    ranks -= ranks.mean(axis=0)
    wanted = rankdata(target)
    wanted -= wanted.mean()
    norm = np.sqrt((ranks**2).sum(axis=0) * float((wanted**2).sum()))
    correlation = np.abs(ranks.T @ wanted) / np.maximum(norm, 1e-12)
    relevance = np.maximum(correlation - 1 / np.sqrt(len(target)), 0.0)
    return np.asarray(relevance / max(float(relevance.max()), 1e-12) + 0.02)


def _regress(known: Floats, target: Floats, query: Floats, specimens: NDArray[np.intp]) -> tuple[float, Floats]:
    """Return the prediction for the query, shape (1, n), and the errors of the known, shape (cases,), each predicted
    without its specimen (Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), 5.4.2, by blocks)."""
    mean = float(target.mean())
    apart, to_query = _distances(known, known), _distances(query, known)[0]
    typical = float(np.median(apart[apart > 0])) if (apart > 0).any() else 1.0
    blocks = [np.flatnonzero(specimens == each) for each in np.unique(specimens)]
    best: tuple[float, float, Floats] | None = None
    for length in LENGTHS:
        linear = known @ known.T / typical**2
        kernel = linear + np.exp(-0.5 * (apart / (length * typical)) ** 2)
        row = query[0] @ known.T / typical**2 + np.exp(-0.5 * (to_query / (length * typical)) ** 2)
        for noise in NOISES:
            inverse = np.linalg.inv(kernel + noise * np.eye(len(target)))
            alpha = inverse @ (target - mean)
            errors = _left_out(inverse, alpha, blocks)
            score = float(np.median(np.abs(errors)))
            if best is None or score < best[0]:
                best = (score, mean + float(row @ alpha), errors)
    assert best is not None
    return best[1], best[2]


def _left_out(inverse: Floats, alpha: Floats, blocks: Sequence[NDArray[np.intp]]) -> Floats:
    if len(blocks) == alpha.size:
        return np.asarray(alpha / np.diag(inverse))
    errors = np.empty_like(alpha)
    for block in blocks:
        errors[block] = np.linalg.solve(inverse[np.ix_(block, block)], alpha[block])
    return errors


def _distances(some: Floats, others: Floats) -> Floats:
    """Return the distances between points, shape (some, others)."""
    return np.asarray(np.sqrt(((some[:, None] - others) ** 2).sum(axis=-1)))
