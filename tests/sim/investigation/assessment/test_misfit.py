"""Misfit is what noise does not explain, however loud the noise and wherever in time it is loud."""

from __future__ import annotations

import numpy as np
import pytest

from sim.investigation.assessment.misfit import NOISE, adequacy, left_over_noise, widened
from sim.investigation.results import Estimate, Gain

RATE_HZ, ROWS = 500.0, 15_000
COUNTS = np.ones(ROWS)


@pytest.mark.parametrize("seed", range(3))
def test_noise_in_bursts_is_no_misfit(seed: int) -> None:
    noise = np.random.default_rng(seed).standard_normal(ROWS)
    noise[4_000:6_000] *= 5.0
    assert left_over_noise(noise, COUNTS, RATE_HZ) < NOISE


@pytest.mark.parametrize("seed", range(3))
def test_torque_that_is_off_for_a_while_is_misfit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    torque = 30.0 * np.sin(2.0 * np.pi * rng.uniform(0.3, 1.0) * np.arange(ROWS) / RATE_HZ)
    off = 0.1 * torque * (np.arange(ROWS) > 9_000)
    assert left_over_noise(rng.standard_normal(ROWS) + off, COUNTS, RATE_HZ) > NOISE


def test_misfit_does_not_depend_on_the_unit() -> None:
    left = np.random.default_rng(1).standard_normal(ROWS).cumsum()
    assert left_over_noise(left, COUNTS, RATE_HZ) == pytest.approx(left_over_noise(1e3 * left, COUNTS, RATE_HZ))


def test_a_model_that_explains_as_much_as_it_leaves_is_half_adequate() -> None:
    gain = (Gain("motor_torque_nm", "N m", np.sqrt(2.0), 1.0, True, 5.0),)
    assert adequacy((0.0,), gain, whole=False) == 1.0
    assert adequacy((1.0,), gain, whole=False) == pytest.approx(0.5)
    size, angle = Estimate("torque_n_m", 2.0, "N m", 1.9, 2.1), Estimate("angle_rad", 2.0, "rad", 1.9, 2.1)
    wide, same = widened((size, angle), 0.5)
    assert (wide.low, wide.high) == (pytest.approx(0.0), pytest.approx(4.0))
    assert same == angle
