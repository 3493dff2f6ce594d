"""What a drive's own law tells of the noise in its torque channel."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from sim.chain.model import Array
from sim.investigation.data.controller_law import DriveLaw, drive_law, known_noise, without_noise
from sim.investigation.data.preprocessing import Measurement, gaussian_kernel, prepare
from sim.investigation.estimation.whitening import Noise

RATE_HZ = 2000.0
INERTIA, COULOMB = 0.01, 0.8


@cache
def driven(expects_friction: bool = True, kind: str = "linear") -> tuple[Array, Array, Array]:
    """Reference, encoder and true torque of a body with friction behind a speed loop with integrator, 20 s.

    The drive expects friction by the sign of the reference; of `kind` "table" also a torque over the motor's angle,
    which no law here can know.
    """
    rows = int(20.0 * RATE_HZ)
    time = np.arange(rows) / RATE_HZ
    reference = 30.0 * np.sin(1.3 * time) + 9.0 * np.sin(3.1 * time + 1.0)
    speed = np.gradient(reference, 1.0 / RATE_HZ)
    acceleration = np.gradient(speed, 1.0 / RATE_HZ)
    angle, torque = np.empty(rows), np.empty(rows)
    where, turns, asked, integral = reference[0], speed[0], 0.0, 0.0
    load = 0.02 * lfilter([0.02], [1.0, -0.98], np.random.default_rng(3).standard_normal(rows))
    table = 0.15 if kind == "table" else 0.0
    for k in range(rows):
        angle[k], torque[k] = where, asked
        behind = speed[k] + 15.0 * (reference[k] - where) - turns
        integral += 12.0 * behind / RATE_HZ
        wanted = 0.9 * INERTIA * acceleration[k] + 0.5 * behind + integral + table * np.sin(3.0 * where)
        wanted += COULOMB * expects_friction * np.tanh(speed[k] / 0.5)
        asked += 0.5 * (wanted - asked)
        turns += (asked - COULOMB * np.tanh(turns / 0.3) - 0.01 * turns + load[k]) / INERTIA / RATE_HZ
        where += turns / RATE_HZ
    return reference, np.round(angle / 5e-5) * 5e-5, torque


def coloured(level: float, seed: int = 1) -> Array:
    rng = np.random.default_rng(seed)
    noise = lfilter([0.05], [1.0, -0.95], rng.standard_normal(int(20.0 * RATE_HZ)))
    return np.asarray(level * noise / noise.std())


def law_of(measured: Array, reference: Array, angle: Array) -> tuple[DriveLaw, Measurement]:
    m = prepare(RATE_HZ, measured, angle, None)
    law = drive_law(m, RATE_HZ, measured, angle, reference)
    assert law
    return law, m


def slow(values: Array, m: Measurement) -> Array:
    """Raw rows as the law sees them."""
    kernel = gaussian_kernel(80.0, RATE_HZ, 0)
    rows = np.round(m.time_s * RATE_HZ).astype(int)
    return np.asarray(np.convolve(values, kernel[::-1], "same")[rows])


@pytest.mark.parametrize("expects_friction", [False, True])
@pytest.mark.parametrize("late_rows", [0, 8])
def test_what_the_axis_does_not_feel_is_told_as_noise(expects_friction: bool, late_rows: int) -> None:
    """Also where the torque channel is late by 4 ms."""
    reference, angle, torque = driven(expects_friction)
    noise = coloured(0.05)
    law, m = law_of(np.roll(torque, late_rows) + noise, reference, angle)
    true = slow(noise, m)
    off = law.noise - true
    assert off[100:].std() < 0.25 * true.std()
    assert without_noise(m, law).torque[100:] == pytest.approx(m.torque[100:] - 0.8 * law.noise[100:])


def test_what_the_law_may_be_wrong_by_covers_what_it_is_wrong_by() -> None:
    """In the ways of `unsure` that say much the error is of unit size."""
    reference, angle, torque = driven()
    squares = []
    for seed in range(4):
        noise = coloured(0.05, seed)
        law, m = law_of(torque + noise, reference, angle)
        ways, size, _ = np.linalg.svd(law.unsure, full_matrices=False)
        known = size > 0.1 * size[0]
        off = ways[:, known].T @ (law.noise - slow(noise, m))
        squares.append(float(np.mean((off / size[known]) ** 2)))
    assert 0.4 < np.mean(squares) < 2.5


def test_hum_stays_in_the_torque() -> None:
    reference, angle, torque = driven()
    hum = 0.03 * np.sin(2.0 * np.pi * 50.01 * np.arange(torque.size) / RATE_HZ)
    law, m = law_of(torque + coloured(0.05) + hum, reference, angle)
    wave = slow(hum, m)
    assert abs(float(law.noise @ wave)) < 0.15 * float(wave @ wave)


def test_only_what_a_model_leaves_as_well_is_taken_away() -> None:
    """What the law misses (here a table over the angle) is felt by the axis, and no model leaves it."""
    for kind, known in (("linear", True), ("table", False)):
        reference, angle, torque = driven(kind=kind)
        noise = coloured(0.02)
        law, m = law_of(torque + noise, reference, angle)
        left = prepare(RATE_HZ, noise, angle, None).torque
        assert (known_noise(law, m, left) is not None) == known


def test_noise_that_is_also_wrong_as_a_whole_is_white_again() -> None:
    """Whitened, w + u g has covariance I; the log of its volume is that of I + g g^T."""
    rng = np.random.default_rng(5)
    unsure = rng.standard_normal((400, 3)) * [0.2, 1.0, 0.05]
    noise = Noise.flat(0.5, 1.0).with_inflated_prior(unsure)
    whole = 0.25 * np.eye(400) + unsure @ unsure.T
    white = np.stack([noise.whiten(column, np.zeros(0)) for column in np.linalg.cholesky(whole).T], axis=1)
    assert white @ white.T == pytest.approx(np.eye(400), abs=1e-3)
    assert noise.log_scale(400, 0) == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-3)
    assert replace(noise).less.size == 3
