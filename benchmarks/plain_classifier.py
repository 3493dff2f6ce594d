"""The plain way that a diagnosis has to beat: the nearest case of every label, and one logistic for how sure.

The label of the nearest case is named. Of d1, the distance to it, and d2, that to the nearest case of any other label,
it is right with logit p = a + b log(d2 / d1) + c log d1, fitted to cases answered by those of other gearboxes.

Source: Platt, Probabilistic outputs for support vector machines (1999), with his targets: of few answers none is sure.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from casebase.reasoning.priors import prior_weights
from casebase.search.case_table import CaseTable
from casebase.search.retrieval import CaseMatrix, metric_of

SMALLEST, RIDGE = 1e-9, 1e-3
Floats = NDArray[np.float64]


class PlainClassifier:
    """A table of cases, ready to name the label of a recording."""

    def __init__(self, table: CaseTable) -> None:
        self.table = table
        self._matrix = _matrix(table)
        self._coefficients = self._fitted()

    def judge(self, values: NDArray[np.floating]) -> tuple[str, float]:
        """Return the nearest label and how probable it is right; 0 where that cannot be learned."""
        label, terms = _nearest(self._matrix, values)
        return label, 0.0 if self._coefficients is None else float(special.expit(self._coefficients @ terms))

    def _fitted(self) -> Floats | None:
        answers: list[tuple[Floats, bool]] = []
        for gearbox in np.unique(self.table.gearboxes):
            left_out = self.table.gearboxes == gearbox
            if np.unique(self.table.labels[~left_out]).size > 1:
                others = _matrix(self.table.take(~left_out))
                for row in np.flatnonzero(left_out):
                    label, terms = _nearest(others, self.table.values[row])
                    answers.append((terms, label == self.table.labels[row]))
        if not answers:
            return None
        terms, right = np.array([each for each, _ in answers]), np.array([each for _, each in answers])
        target = np.where(right, (right.sum() + 1) / (right.sum() + 2), 1 / ((~right).sum() + 2))

        def loss(coefficients: Floats) -> float:
            logit = terms @ coefficients
            return float((np.logaddexp(0, logit) - target * logit).sum() + RIDGE * (coefficients**2).sum())

        return np.asarray(optimize.minimize(loss, np.zeros(terms.shape[1])).x)


def _matrix(table: CaseTable) -> CaseMatrix:
    return CaseMatrix(table, metric_of(table, prior_weights(table.names)))


def _nearest(matrix: CaseMatrix, values: NDArray[np.floating]) -> tuple[str, Floats]:
    """Return the nearest label and the terms of its logit: 1, log(d2 / d1), log d1."""
    distances = np.maximum(matrix.nearest_by_class(values, 1).distances[:, 0], SMALLEST)
    first, second = np.argsort(distances, kind="stable")[:2]
    nearest, ratio = np.log(distances[first]), np.log(distances[second] / distances[first])
    return matrix.table.classes[first], np.array([1.0, ratio, nearest])
