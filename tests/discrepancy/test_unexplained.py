"""A line of fixed frequency is there at all speeds; teeth that nobody described make one at the usual speed alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.discrepancy.nameless import is_fixed, line_of
from sim.discrepancy.unexplained import fixed_line, stands_out

RATE_HZ = 1000.0
ORDER = 16.0
USUAL_RAD_S = 30.0
TIME_S = np.arange(30_000) / RATE_HZ
LINE_HZ = ORDER * USUAL_RAD_S / (2.0 * np.pi)


def _speed(usual: float) -> NDArray[np.float64]:
    """Of every six seconds a share at the usual speed, in pieces, and slower ones between them."""
    part = TIME_S % 6.0 / 6.0
    return np.where(part < usual, USUAL_RAD_S, USUAL_RAD_S * (0.2 + 0.7 * (part - usual) / (1.0 - usual)))


def _noise(seed: int = 3) -> NDArray[np.float64]:
    return np.random.default_rng(seed).standard_normal(TIME_S.size)


def _teeth(speed: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sin(ORDER * np.cumsum(speed) / RATE_HZ)


@pytest.mark.parametrize("usual", [0.2, 0.5])
def test_teeth_at_the_usual_speed_are_no_fixed_line(usual: float) -> None:
    speed = _speed(usual)
    found = fixed_line("motor_torque_nm", _noise() + 2.0 * _teeth(speed), RATE_HZ, speed)
    assert abs(found.numbers.get("frequency_hz", 0.0) - LINE_HZ) > 3.0
    assert not stands_out(found)


@pytest.mark.parametrize("usual", [0.2, 0.5])
def test_a_line_at_all_speeds_is_found_behind_louder_teeth(usual: float) -> None:
    speed = _speed(usual)
    wandering = np.cumsum(_noise(4)) * 0.01  # its phase, about a radian in ten seconds
    line = np.sin(2.0 * np.pi * 41.0 * TIME_S + wandering)
    found = fixed_line("motor_torque_nm", _noise() + 3.0 * _teeth(speed) + line, RATE_HZ, speed)
    assert found.numbers["frequency_hz"] == pytest.approx(41.0, abs=0.2)
    assert stands_out(found)


def test_a_line_is_asked_for_at_other_speeds() -> None:
    speed = _speed(0.5)
    line = np.sin(2.0 * np.pi * LINE_HZ * TIME_S)
    frequency = line_of(_noise() + line, RATE_HZ)
    assert frequency == pytest.approx(LINE_HZ, abs=0.01)
    assert is_fixed(_noise() + line, RATE_HZ, LINE_HZ, speed)
    assert not is_fixed(_noise() + _teeth(speed), RATE_HZ, LINE_HZ, speed)


@pytest.mark.parametrize("seed", range(5))
def test_a_line_of_a_comb_is_the_motions(seed: int) -> None:
    """A motion that repeats every 5 s leaves faint harmonics of 0.2 Hz; a line is one of them, or lies between."""
    faint = sum(0.08 * np.sin(2.0 * np.pi * k / 5.0 * TIME_S + k * k) for k in range(10, 31))
    for frequency, expected in ((3.6, None), (3.7, 3.7)):
        left = _noise(seed) + faint + 0.3 * np.sin(2.0 * np.pi * frequency * TIME_S)
        found = line_of(left, RATE_HZ, 2.5, 5.0)
        assert found == (expected if expected is None else pytest.approx(expected, abs=0.01))
