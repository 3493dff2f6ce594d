"""A line of fixed frequency is there at all speeds; teeth that nobody described make one at the usual speed alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.investigation.assessment.residual_structure import fixed_line, stands_out
from sim.investigation.search.residual_proposals import is_fixed, line_of

Array = NDArray[np.float64]
RATE_HZ = 1000.0
ORDER = 16.0
USUAL_RAD_S = 30.0
TIME_S = np.arange(30_000) / RATE_HZ
LINE_HZ = ORDER * USUAL_RAD_S / (2.0 * np.pi)
ALL = np.ones(TIME_S.size)


def _speed(usual: float) -> Array:
    """Of every six seconds a share at the usual speed, in pieces, and slower ones between them."""
    part = TIME_S % 6.0 / 6.0
    return np.where(part < usual, USUAL_RAD_S, USUAL_RAD_S * (0.2 + 0.7 * (part - usual) / (1.0 - usual)))


def _dwelling() -> Array:
    """Of every six seconds two and a half in motion, at one speed but for ramps of a tenth, then rest."""
    part = TIME_S % 6.0
    return USUAL_RAD_S * np.clip(np.minimum(part, 2.5 - part) / 0.1, 0.0, 1.0)


def _noise(seed: int = 3) -> Array:
    return np.random.default_rng(seed).standard_normal(TIME_S.size)


def _teeth(speed: Array) -> Array:
    return np.sin(ORDER * np.cumsum(speed) / RATE_HZ)


def _sine(frequency_hz: float) -> Array:
    return np.sin(2.0 * np.pi * frequency_hz * TIME_S)


@pytest.mark.parametrize("usual", [0.2, 0.5])
def test_teeth_at_the_usual_speed_are_no_fixed_line(usual: float) -> None:
    speed = _speed(usual)
    found = fixed_line("motor_torque_nm", _noise() + 2.0 * _teeth(speed), RATE_HZ, speed, ALL)
    assert not any(stands_out(line) for line in found)


@pytest.mark.parametrize("usual", [0.2, 0.5])
def test_a_line_at_all_speeds_is_found_behind_louder_teeth(usual: float) -> None:
    speed = _speed(usual)
    wandering = np.cumsum(_noise(4)) * 0.01  # its phase, about a radian in ten seconds
    line = np.sin(2.0 * np.pi * 41.0 * TIME_S + wandering)
    (found,) = fixed_line("motor_torque_nm", _noise() + 3.0 * _teeth(speed) + line, RATE_HZ, speed, ALL)
    assert found.numbers["frequency_hz"] == pytest.approx(41.0, abs=0.2)
    assert stands_out(found)


@pytest.mark.parametrize("size", [0.75, 1.0, 3.0])
def test_rows_that_do_not_count_are_no_other_speed(size: float) -> None:
    speed = _dwelling()
    counts = (speed > 0.012 * USUAL_RAD_S).astype(float)
    (found,) = fixed_line("motor_torque_nm", counts * (_noise() + size * _sine(17.0)), RATE_HZ, speed, counts)
    assert found.numbers["frequency_hz"] == pytest.approx(17.0, abs=0.2)
    assert stands_out(found)


def test_where_no_row_counts_there_is_no_line() -> None:
    nothing = np.zeros(TIME_S.size)
    assert fixed_line("load_position_rad", nothing, RATE_HZ, _speed(0.5), nothing) == []


def test_a_line_is_asked_for_at_other_speeds() -> None:
    speed = _speed(0.5)
    frequency = line_of(_noise() + _sine(LINE_HZ), RATE_HZ)
    assert frequency == pytest.approx(LINE_HZ, abs=0.01)
    assert is_fixed(_noise() + _sine(LINE_HZ), RATE_HZ, LINE_HZ, speed, ALL)
    assert not is_fixed(_noise() + _teeth(speed), RATE_HZ, LINE_HZ, speed, ALL)
    counts = (TIME_S % 6.0 < 4.0).astype(float)  # most of what is slower does not count
    assert is_fixed(counts * (_noise() + _sine(LINE_HZ)), RATE_HZ, LINE_HZ, speed, counts)
