"""Starts within their limits, steps along them, lines of one phase."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.signal import lfilter, lsim
from scipy.stats import chi2

from benchmarks.harness.telemetry_of import RATE_HZ, one_body
from benchmarks.harness.telemetry_of import swing as motion
from signals.telemetry import Telemetry
from sim.chain.model import Chain, Shaft
from sim.description.axis_document import read_axis
from sim.investigation.data.preprocessing import Measurement, prepare
from sim.investigation.data.validation import examine
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import calibrate, with_slow_noise
from sim.investigation.estimation.whitening import Noise
from sim.investigation.hypotheses.catalogue import terms_of
from sim.investigation.hypotheses.hypothesis import Key
from sim.investigation.investigate import investigate
from sim.investigation.model.effects import swing
from sim.investigation.search.residual_proposals import line_of
from sim.investigation.search.score_test import least_squares_within
from sim.investigation.search.search import select_hidden
from sim.mechanisms.mechanism import LEAST_GAIN


def test_of_two_columns_that_are_alike_none_is_negative_where_it_may_not_be() -> None:
    rng = np.random.default_rng(1)
    first = rng.standard_normal(500)
    columns = np.stack([first, first + 1e-3 * rng.standard_normal(500)], axis=1)
    goal = 0.7 * first + 0.1 * rng.standard_normal(500)
    share = least_squares_within(columns.T @ columns, columns.T @ goal, np.zeros(2))
    exact = lsq_linear(columns, goal, (0.0, np.inf)).x
    assert share.min() >= 0.0
    assert share.sum() == pytest.approx(exact.sum(), rel=1e-3)


def test_a_line_is_one_sine_of_constant_phase_and_no_burst_of_its_frequency() -> None:
    time = np.arange(30_000) / 1000.0
    noise = np.random.default_rng(3).standard_normal(time.size)
    sine = 0.1 * np.sin(2 * np.pi * 6.31 * time)
    assert line_of(noise, 1000.0) is None
    assert line_of(noise + sine, 1000.0) == pytest.approx(6.31, abs=0.01)
    broken = 0.1 * np.sin(2 * np.pi * 6.31 * time + np.random.default_rng(4).uniform(0, 2 * np.pi, 30).repeat(1000))
    assert line_of(noise + 3.0 * broken, 1000.0) is None


def test_a_part_on_a_spring_adds_its_mass_below_its_frequency_and_nothing_far_above() -> None:
    """At standstill of the spring the swinging part moves with the load; far above its resonance it stands still."""
    rate_hz, time = 1000.0, np.arange(40_000) / 1000.0
    for frequency_hz, followed in ((0.2, 0.0), (60.0, -1.0)):
        w = 2.0 * np.pi * frequency_hz
        still = np.zeros(time.size)
        speed = np.cos(w * time) / w
        m = Measurement(rate_hz, time, *[still] * 8, speed, still, speed, still, still)
        asked = swing(m, 2.0, 0.25, 6.0, 0.02)[20_000:]
        acceleration = -np.sin(w * time)[20_000:]
        assert asked @ acceleration / (acceleration @ acceleration) == pytest.approx(0.5 * followed, abs=0.01)


AXIS = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.003, "coulomb_friction_n_m": 0.3},
        "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": 1e4}],
        "load": {"inertia_kg_m2": 2.0},
    }
)
MOVED = prepare(RATE_HZ, motion()[3] * 0.03, motion()[1], motion()[1] / 8.0)
ALL = terms_of(AXIS, MOVED, Chain((Shaft(0.003, 0.3, 0.0),)))
TERMS = {t.mechanism: t for t in ALL}


@pytest.mark.parametrize("mechanism", sorted(name for name in TERMS if TERMS[name].traits.least_gain < LEAST_GAIN))
def test_noise_alone_promises_what_is_asked_for_less_than_once_in_five_hundred_axes(mechanism: str) -> None:
    """The squares that k numbers take away from white noise are chi-squared with k degrees of freedom."""
    numbers = 1 if mechanism.endswith(("coulomb_friction", "viscous_friction")) else len(TERMS[mechanism].parameters)
    assert chi2.sf(TERMS[mechanism].traits.least_gain, numbers) < 0.002


@pytest.mark.parametrize("weight_n_m", [0.0, 0.02])
def test_a_small_cause_under_slow_noise_is_found_once_noise_is_taken_from_its_own_fit(weight_n_m: float) -> None:
    """Weight of two fifths of the noise, which is as slow as the motion."""
    time, angle, speed, acceleration = motion(24.0)
    rng = np.random.default_rng(1)
    pole = math.exp(-2.0 * math.pi * 2.0 / RATE_HZ)
    slow = lfilter([math.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(time.size + 3000))[3000:]
    noise = 0.05 * slow + 0.03 * rng.standard_normal(time.size)
    torque = 0.01 * acceleration + np.tanh(speed / 0.01) + 0.02 * speed + weight_n_m * np.sin(angle + 0.3) + noise
    rubs = {"coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"motor": {"inertia_kg_m2": 0.01, **rubs}, "load": {"inertia_kg_m2": 1e-9}})
    channels = {"motor_torque_nm": torque, "motor_position_rad": angle + 1e-6 * rng.standard_normal(time.size)}
    measured = examine(axis, Telemetry(time, channels)).measurement
    problem, fit = with_slow_noise(*calibrate(Problem(axis, measured, Noise.flat(0.1, 1.0))))
    _, entry = select_hidden(problem, fit, {})
    if not weight_n_m:
        assert not entry.new
        return
    (best,) = entry.new
    assert [t.key for t in entry.fit.terms] == [best.term.key] == [Key("gravity_imbalance", "load")]
    assert entry.brought[best.term.key] > best.gain  # noise taken without it had held some of it
    assert best.term.report(entry.fit.values)["torque_n_m"] == pytest.approx(weight_n_m, rel=0.3)


def test_what_good_gears_err_twice_per_tooth_comes_in_and_is_not_spoken_of() -> None:
    """The description's own model has it once per tooth. A load on a spring whose other end moves as the teeth do."""
    ratio, inertia, stiffness, damping, new_rad = 3.0, 2.0, 1e4, 20.0, 3e-5
    teeth = {"driver_teeth": 10, "driven_teeth": 30, "transmission_error_rad": new_rad}
    stage = {"name": "output", **teeth, "stiffness_n_m_per_rad": stiffness, "damping_n_m_s_per_rad": damping}
    rubs = {"coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"motor": {"inertia_kg_m2": 0.01, **rubs}, "stages": [stage], "load": {"inertia_kg_m2": inertia}})
    time, angle, *_ = motion()
    drawn = angle / ratio - 0.6 * new_rad * np.sin(60.0 * angle / ratio + 0.4)
    load = lsim(([damping, stiffness], [inertia, damping, stiffness]), drawn, time)[1]
    plain = one_body(0.01, 1.0, 0.02, seed=1)
    twist = drawn - load
    bears = (stiffness * twist + damping * np.gradient(twist) * RATE_HZ) / ratio
    seen = load + 2e-6 * np.random.default_rng(2).standard_normal(time.size)
    torque = plain.channels["motor_torque_nm"] + bears
    said = investigate(
        axis, replace(plain, channels={**plain.channels, "motor_torque_nm": torque, "load_position_rad": seen})
    )
    assert said.verdict == "nothing_missing"
    assert said.selection is not None
    (twice,) = [t for t in said.selection.fit.terms if t.location == "output"]
    assert not twice.named
    sine, cosine = (said.selection.fit.values[p.name] for p in twice.parameters)
    assert math.hypot(sine, cosine) == pytest.approx(0.6 * new_rad, rel=0.2)
