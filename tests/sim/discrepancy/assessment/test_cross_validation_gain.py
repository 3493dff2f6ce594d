"""What a model leaves on rows that its fit has not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.description.axis_document import read_axis
from sim.discrepancy.assessment import cross_validation_gain
from sim.discrepancy.assessment.cross_validation_gain import gains, without
from sim.discrepancy.estimation.estimate import Fit, Refits
from sim.discrepancy.investigation import investigate
from sim.discrepancy.model.parameters import Parameter
from tests.sim.discrepancy.telemetry_of import one_body

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


def test_what_the_record_begins_with_stays_where_its_first_rows_are_left_out() -> None:
    rng = np.random.default_rng(3)
    columns = np.stack([np.exp(-np.arange(ROWS) / 50.0), np.ones(ROWS)], axis=1)
    measured = columns @ np.array([5.0, 1.0]) + rng.standard_normal(ROWS)
    best = np.linalg.lstsq(columns, measured, rcond=None)[0]
    residual = columns @ best - measured
    parameters = (Parameter("start_rad", 0.0, 1.0), Parameter("level", 0.0, 1.0))
    values = {"start_rad": float(best[0]), "level": float(best[1])}
    fit = Fit((), parameters, values, residual, columns, float(residual @ residual), ROWS)
    left_out = np.arange(ROWS) < ROWS // 4
    there = without(fit, Refits.of(fit, ("start_rad",)), left_out)
    assert there["start_rad"] == values["start_rad"]
    assert there["level"] == pytest.approx(float(measured[~left_out].mean()), abs=1e-3)
    free = without(fit, Refits.of(fit), left_out)
    assert abs(free["start_rad"] - 5.0) > 10.0 * fit.deviation({"start_rad": 1.0})  # of which the others know nothing


def test_what_other_rows_say_of_the_known_torque_may_mislead_and_is_left_then(monkeypatch: pytest.MonkeyPatch) -> None:
    """Viscous friction of a joint was not said: with it unseen rows were told better, and worse once corrected."""
    data = one_body(0.3, 1.0, 0.02, 5)
    data = replace(data, channels={**data.channels, "known_torque_nm": np.zeros(data.rows)})
    doubts = 0.05 * np.sin(np.arange(data.rows) / 300.0)[:, None]
    motor = {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0}
    axis = read_axis({"name": "joint", "motor": motor, "load": {"inertia_kg_m2": 0.0}})
    selection = investigate(axis, data, known_doubts=doubts).selection
    assert selection is not None
    problem, fit = selection.problem, selection.fit
    assert [t.mechanism for t in fit.terms] == ["viscous_friction"]

    def left(corrections: float) -> float:
        says = corrections * np.cos(np.arange(problem.measurement.samples))
        monkeypatch.setattr(cross_validation_gain, "by_doubts", lambda *_: says)
        return gains(problem, selection.base, fit, fit.terms)[0].rms_after

    assert left(1.0) == left(0.0)
