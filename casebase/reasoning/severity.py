"""How large a fault is, from cases of the same axis, label and origin whose size is known.

The logarithm of the size is regressed on the features of the nearest cases: a Gaussian process with a linear and a
local part, its two settings chosen by leave-one-out error, its interval the quantile of the errors with the gearbox
left out (jackknife; Vovk, Gammerman, Shafer, Algorithmic Learning in a Random World, 2005). Such an interval holds for
recordings that could have been among the cases. A simulated case could not have been recorded by a microphone, so
measured recordings are sized by measured cases and simulated ones by simulated cases.
Features count by how much they go with the size (Spearman), so that the housing and the microphone do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.labels import PARAMETERS as PARAMETERS
from casebase.search.case_table import CaseTable
from casebase.search.similarity import Floats, robust_scales
from casebase.store.models import Case
from signals.features import catalogue

FEWEST, NEAREST = 12, 200
FEWEST_GEARBOXES = 3
"""One that is left out leaves two to learn from."""
COVERAGE = 0.9
TOLD_WITHIN = 0.25
"""A size that is farther off in the median decides nothing: a gap of 2 minutes of arc could be one of 3."""
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

    @property
    def at_most(self) -> bool:
        """Whether the fault is not heard, so that only an upper limit is known."""
        return self.low == 0

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


def severity_of(
    session: Session, table: CaseTable, axis: str | None, label: str, values: NDArray[np.floating], origin: str
) -> Severity | None:
    """Estimate the size of a fault; None where the label has no size, or too few cases of the axis have one.

    Cases of another axis say nothing of the size: the same gap sounds otherwise in another gear.

    Args:
        axis: of the recording; nothing is said without one.
        values: features of the recording, shape (n,), NaN where missing.
        origin: of the recording, `measured` or `simulated`.
    """
    if label not in PARAMETERS or axis is None:
        return None
    rows, sizes = sized(session, table, axis, label, origin)
    specimens = np.unique(table.groups[rows], return_inverse=True)[1]
    if rows.size < FEWEST or specimens.max() + 1 < FEWEST_GEARBOXES:
        return None
    return estimate(PARAMETERS[label], table.values[rows], sizes, values, specimens)


def sized(session: Session, table: CaseTable, axis: str, label: str, origin: str) -> tuple[NDArray[np.intp], Floats]:
    """Return the rows of an axis' cases of a label and origin whose size is known, and the sizes [rad]; (rows,) each.

    Empty where there are too few to say anything; the database is then not asked.
    """
    alike = (table.axes == axis) & (table.labels == label) & (table.origins == origin)
    if np.count_nonzero(alike) < FEWEST:
        return np.empty(0, np.intp), np.empty(0)
    statement = select(Case.id, Case.severity).where(
        Case.label == label, Case.origin == origin, Case.severity > 0, Case.state == "confirmed"
    )
    size_of = {case_id: size for case_id, size in session.execute(statement)}  # noqa: C416
    rows = np.array([row for row in np.flatnonzero(alike) if str(table.ids[row]) in size_of], dtype=np.intp)
    return rows, np.array([size_of[str(table.ids[row])] for row in rows], dtype=np.float64)


def estimate(
    parameter: str,
    known: NDArray[np.floating],
    sizes: Floats,
    values: NDArray[np.floating],
    specimens: NDArray[np.intp] | None = None,
) -> Severity | None:
    """Estimate a size from the features of the nearest cases of known size.

    None where nothing can be compared, and where every second left-out case is farther off than TOLD_WITHIN.

    Args:
        known: features of the cases, shape (cases, n).
        sizes: of the cases, shape (cases,), > 0.
        values: features of the recording, shape (n,).
        specimens: the gearbox of each case, shape (cases,); each of its own if None.
    """
    compared = np.array([definition.compared for definition in catalogue().values()])
    usable = compared & np.isfinite(values) & (np.isfinite(known).mean(axis=0) > 0.8)
    if not usable.any():
        return None
    scaling = Scaling.of(known[:, usable], sizes)
    scaled, query = scaling.apply(known[:, usable]), scaling.apply(values[None, usable])
    nearest = np.argsort(_distances(query, scaled)[0])[:NEAREST]
    own = np.arange(len(sizes)) if specimens is None else specimens
    regression = Regression.of(scaled[nearest], sizes[nearest], own[nearest])
    return regression.severity(parameter, query) if regression.score <= np.log(1 + TOLD_WITHIN) else None


@dataclass(frozen=True, eq=False)
class Scaling:
    """Columns brought to one scale and weighted by how much they go with the size; shape (n,) each."""

    center: Floats
    scale: Floats
    weights: Floats

    @classmethod
    def of(cls, known: NDArray[np.floating], sizes: Floats) -> "Scaling":
        """From cases of known size, shape (cases, n)."""
        center, scale = robust_scales(known)
        return cls(center, scale, _relevance(_scaled(known, center, scale), np.log(sizes)))

    def apply(self, values: NDArray[np.floating]) -> Floats:
        """Return values of shape (cases, n), scaled; what is missing counts as usual."""
        return _scaled(values, self.center, self.scale) * self.weights


@dataclass(frozen=True, eq=False)
class Regression:
    """The logarithm of the size over scaled columns.

    Args:
        known: shape (cases, n).
        alpha: weight of each case, shape (cases,).
        mean: of the logarithms.
        typical, length: typical distance of two cases, and reach of the local part over it.
        errors: of the logarithm, each case predicted without its specimen, shape (cases,).
        smallest, largest: size among the cases [rad].
    """

    known: Floats
    alpha: Floats
    mean: float
    typical: float
    length: float
    errors: Floats
    smallest: float
    largest: float

    @classmethod
    def of(cls, known: Floats, sizes: Floats, specimens: NDArray[np.intp] | None = None) -> "Regression":
        """Fit, with the settings whose left-out errors are least in the median.

        Specimens, shape (cases,), say which cases are of the same one and are left out together; each its own if None.
        Source: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), 5.4.2, by blocks.
        """
        target = np.log(sizes)
        mean = float(target.mean())
        apart = _distances(known, known)
        typical = float(np.median(apart[apart > 0])) if (apart > 0).any() else 1.0
        together = np.arange(len(sizes)) if specimens is None else specimens
        blocks = [np.flatnonzero(together == each) for each in np.unique(together)]
        fits = []
        for length in LENGTHS:
            kernel = _kernel(known @ known.T, apart, typical, length)
            for noise in NOISES:
                inverse: Floats = np.asarray(np.linalg.inv(kernel + noise * np.eye(len(target))), dtype=np.float64)
                alpha = inverse @ (target - mean)
                errors = _left_out(inverse, alpha, blocks)
                fits.append(cls(known, alpha, mean, typical, length, errors, float(sizes.min()), float(sizes.max())))
        return min(fits, key=lambda fit: fit.score)

    @property
    def score(self) -> float:
        """Median error of the logarithm of a left-out case."""
        return float(np.median(np.abs(self.errors)))

    def severity(self, parameter: str, query: Floats) -> Severity:
        """Size of one recording, shape (1, n), and the interval that its left-out errors give."""
        row = _kernel(query @ self.known.T, _distances(query, self.known), self.typical, self.length)[0]
        value = float(np.clip(np.exp(self.mean + row @ self.alpha), self.smallest, self.largest))
        reach = float(np.quantile(np.abs(self.errors), min(1.0, COVERAGE * (1 + 1 / self.errors.size))))
        return Severity(parameter, value, value * float(np.exp(-reach)), value * float(np.exp(reach)), self.errors.size)


def _kernel(products: Floats, apart: Floats, typical: float, length: float) -> Floats:
    return np.asarray(products / typical**2 + np.exp(-0.5 * (apart / (length * typical)) ** 2))


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


def _left_out(inverse: Floats, alpha: Floats, blocks: Sequence[NDArray[np.intp]]) -> Floats:
    if len(blocks) == alpha.size:
        return np.asarray(alpha / np.diag(inverse))
    errors = np.empty_like(alpha)
    for block in blocks:
        errors[block] = np.linalg.solve(inverse[np.ix_(block, block)], alpha[block])
    return errors


def _distances(some: Floats, others: Floats) -> Floats:
    """Return the distances between points, shape (some, others)."""
    from scipy.spatial.distance import cdist  # slow to import

    return np.asarray(cdist(some, others))
