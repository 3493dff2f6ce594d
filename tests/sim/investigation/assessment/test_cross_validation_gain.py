"""What a model leaves on rows that its fit has not seen."""

from __future__ import annotations

import numpy as np
import pytest

from sim.investigation.assessment.held_out_gain import without
from sim.investigation.estimation.estimate import Fit, Refits
from sim.investigation.model.parameters import Parameter

ROWS = 4000


def bounded(seed: int) -> tuple[Fit, np.ndarray, np.ndarray]:
    """Least squares of two columns that have nearly all in common, the second no less than 0, where it would be."""
    rng = np.random.default_rng(seed)
    first = rng.standard_normal(ROWS)
    columns = np.stack([first, first + 0.05 * rng.standard_normal(ROWS)], axis=1)
    measured = columns @ np.array([2.0, -3.0]) + rng.standard_normal(ROWS)
    best = float(first @ measured / (first @ first))
    parameters = (Parameter("first", 0.0, 1.0), Parameter("second", 0.0, 1.0, low=0.0))
    residual = best * first - measured
    fit = Fit((), parameters, {"first": best, "second": 0.0}, residual, columns, float(residual @ residual), ROWS)
    return fit, columns, measured


def test_without_nothing_left_out_nothing_moves() -> None:
    fit, _, _ = bounded(1)
    assert without(fit, Refits.of(fit), np.zeros(ROWS, dtype=bool)) == pytest.approx(fit.values)


def test_numbers_are_those_of_the_other_rows_with_what_is_at_a_limit_still_there() -> None:
    for quarter in range(4):
        fit, columns, measured = bounded(2)
        left_out = np.arange(ROWS) // (ROWS // 4) == quarter
        first = columns[~left_out, 0]
        there = without(fit, Refits.of(fit), left_out)
        assert there["first"] == pytest.approx(float(first @ measured[~left_out] / (first @ first)), rel=1e-6)
        assert there["second"] == 0.0
