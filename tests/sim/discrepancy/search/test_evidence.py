"""Evidence of sets of terms: closed forms, what noise makes of it, and drives with and without a hidden cause."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from sim.discrepancy.search.linear_picture import LinearPicture, Start
from sim.discrepancy.search.model_evidence import CLUSTERS, clusters, excess_of, told_by
from sim.torsional.model import Array

ROWS = 80


def drawn(seed: int, spike: float, slab: float) -> tuple[LinearPicture, Array]:
    """Two columns of a model, the first known beforehand by a standard deviation of 0.5, and one start of two jumps."""
    rng = np.random.default_rng(seed)
    columns, left = rng.standard_normal((ROWS, 4)), rng.standard_normal(ROWS)
    term = cast(Any, SimpleNamespace(contact=False, positive=False, parameters=(), brings=()))
    start = Start(term, ({}, {}), (2, 3), np.full(2, spike), np.full(2, slab), np.full(2, 1.0), np.zeros(2))
    precision = np.array([4.0, 1e-6, *(2 * [spike**-2 if spike else 0.0])])
    present = np.array([True, True, spike > 0.0, spike > 0.0])
    fit = cast(Any, SimpleNamespace(residual=left))
    nothing = cast(Any, None)
    picture = LinearPicture(nothing, fit, columns, columns.T @ columns, -columns.T @ left, precision, present, (start,))
    return picture, left


def log_density(picture: LinearPicture, left: Array, deviations: list[float]) -> float:
    """Of rows that are columns, each by a share of that standard deviation, and noise of 1."""
    covariance = np.eye(ROWS) + picture.columns @ np.diag(np.square(deviations)) @ picture.columns.T
    return float(multivariate_normal(np.zeros(ROWS), covariance).logpdf(left))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("spike", "slab"), [(0.02, 0.6), (0.0, 0.6), (0.3, 9.0)])
def test_evidence_is_the_density_of_the_rows_under_spike_or_slab(seed: int, spike: float, slab: float) -> None:
    picture, left = drawn(seed, spike, slab)
    told = picture.posterior(picture.starts).log_evidence - picture.posterior().log_evidence
    new, fault = ([0.5, 1e3, deviation, deviation] for deviation in (spike, slab))
    assert told == pytest.approx(log_density(picture, left, fault) - log_density(picture, left, new), abs=1e-4)


@pytest.mark.parametrize("is_limit", [False, True])
def test_a_cause_in_the_place_of_a_number_of_the_description_is_that_number_with_another_width(is_limit: bool) -> None:
    """A number of which the description knows a half, bent to 0.8, as wide as 3: though it may not be bent further."""
    rng = np.random.default_rng(8)
    own, other = rng.standard_normal((ROWS, 1)), rng.standard_normal((ROWS, 1))
    left, at, known, wide, jump = rng.standard_normal(ROWS) - 0.3 * own[:, 0], 0.8, 0.5, 3.0, 2.0
    columns = np.hstack([own, other, (jump - at) * own])
    term = cast(Any, SimpleNamespace(contact=False, positive=False, parameters=(), brings=()))
    per_jump = 1.0 / (jump - at)
    begun = np.array([at * per_jump])
    instead = () if is_limit else (0,)
    start = Start(
        term, ({},), (2,), np.zeros(1), np.array([wide * per_jump]), np.ones(1), begun, instead, 0.5 * (at / known) ** 2
    )
    slope = -columns.T @ left - np.array([at / known**2, 0.0, 0.0])
    present = np.array([not is_limit, True, False])
    precision = np.array([known**-2, 1.0, 0.0])
    nothing, fit = cast(Any, None), cast(Any, SimpleNamespace(residual=left))
    picture = LinearPicture(nothing, fit, columns, columns.T @ columns, slope, precision, present, (start,))

    def density(deviation: float) -> float:
        covariance = np.eye(ROWS) + deviation**2 * own @ own.T + other @ other.T
        return float(multivariate_normal(np.zeros(ROWS), covariance).logpdf(left - at * own[:, 0]))

    told = picture.posterior([start]).log_evidence - picture.posterior().log_evidence
    if is_limit:
        held = multivariate_normal(np.zeros(ROWS), np.eye(ROWS) + other @ other.T).logpdf(left)
        assert told == pytest.approx(density(wide) - held + 0.5 * (at / known) ** 2, abs=1e-4)
    else:
        assert told == pytest.approx(density(wide) - density(known), abs=1e-4)


def test_shares_are_those_of_ridge_regression() -> None:
    picture, left = drawn(5, 0.0, 0.7)
    ridge = np.diag([4.0, 1e-6, 0.7**-2, 0.7**-2])
    wanted = np.linalg.solve(picture.gram + ridge, -picture.columns.T @ left)
    assert picture.posterior(picture.starts).shares == pytest.approx(wanted, rel=1e-6)


def state(rows: int, seed: int) -> Any:
    """What a motion is at each row: 20 sweeps of speed and angle."""
    time = np.arange(rows) / 100.0
    turn = 2.0 * np.pi * 20.0 * time / time[-1]
    return SimpleNamespace(time_s=time, angle=np.sin(turn), speed=np.cos(turn), load_stride=4)


def test_white_residuals_have_no_excess_and_such_as_repeat_over_the_angle_do() -> None:
    """The mean over kinds of clusters is that of chi square over 40; the largest of three lies within its far tail."""
    m, rng = state(8000, 0), np.random.default_rng(1)
    direction = rng.standard_normal((8000, 1))
    inner = np.linalg.inv(direction.T @ direction)
    for seed in range(20):
        white = np.random.default_rng(100 + seed).standard_normal(8000)
        assert excess_of(m, direction, white, inner, 8000) < chi2.isf(1e-4, CLUSTERS) / CLUSTERS
    slope = m.angle[:, None]
    repeated = 3.0 * np.sin(7.0 * m.angle) + rng.standard_normal(8000)
    assert excess_of(m, slope, repeated, np.linalg.inv(slope.T @ slope), 8000) > 10.0


def test_every_row_of_both_channels_is_in_one_cluster_of_each_kind() -> None:
    m = state(1001, 0)
    rows = 1001 + 251
    for sums in clusters(m, rows, 1001):
        assert sums.shape == (CLUSTERS, rows)
        assert np.asarray(sums.sum(axis=0)) == pytest.approx(np.ones(rows))


def test_as_many_rows_tell_as_there_are_where_all_tell_alike_and_one_where_one_does() -> None:
    assert told_by(np.full(500, -3.0)) == pytest.approx(500.0)
    assert told_by(np.eye(1, 500)[0]) == pytest.approx(1.0)
    assert told_by(np.zeros(500)) == 1.0
