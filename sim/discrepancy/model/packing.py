"""From a `Chain` to the flat arrays of `observer_kernel`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.rotational.components.elasto_backlash import NO_GAP
from sim.torsional.model import Array, Chain, Line, Link, Shaft

Packed = tuple[Array | NDArray[np.int64], ...]
LARGEST_PHASE = 1.0  # fastest rate times step, per Runge-Kutta step of order 4


def pack(chain: Chain) -> Packed:
    """Arrays in the order that `observer_kernel.run` takes them."""
    n = len(chain.shafts)
    shafts = np.array([_shaft(shaft) for shaft in chain.shafts])
    links = np.array([_link(link) for link in chain.links]).reshape(n - 1, 14)
    lines, line_first = _lines([link.errors for link in chain.links])
    waves, wave_first = _lines([link.stiffness_waves for link in chain.links])
    ripples, ripple_first = _lines([shaft.ripples for shaft in chain.shafts])
    acts_on = np.repeat(np.arange(n), np.diff(ripple_first)).reshape(-1, 1)
    dents = [
        [(d.shaft, d.angle_rad, d.half_width_rad, d.depth_rad, d.flank, d.form) for d in link.dents]
        for link in chain.links
    ]
    dent_rows, dent_first = _rows(dents, 6)
    return shafts, links, lines, line_first, waves, wave_first, dent_rows, dent_first, np.hstack([ripples, acts_on])


def _shaft(s: Shaft) -> list[float]:
    coulomb = s.coulomb_n_m if s.coulomb_backward_n_m is None else s.coulomb_backward_n_m
    viscous = s.viscous_n_m_s if s.viscous_backward_n_m_s is None else s.viscous_backward_n_m_s
    return [
        s.inertia_kg_m2, s.coulomb_n_m, coulomb, s.viscous_n_m_s, viscous, s.stribeck_n_m, s.stribeck_speed_rad_s,
        s.stribeck_exponent, s.drift_per_s, s.gravity_n_m, s.gravity_phase_rad, s.offset_n_m,
    ]  # fmt: skip


def _link(k: Link) -> list[float]:
    plain = k.gap_rad <= NO_GAP and not any(dent.depth_rad for dent in k.dents)
    first = k.efficiency[0] / (1.0 + k.loss_fraction)
    second = k.efficiency[1] * (1.0 - k.loss_fraction)
    lossy = (first, second, *k.bearing_n_m) != (1.0, 1.0, 0.0, 0.0)
    return [
        1.0 / k.ratio, k.stiffness_n_m_per_rad, k.damping_n_m_s_per_rad, 0.5 * k.gap_rad, float(not plain),
        first, second, *k.bearing_n_m, 0.0, float(lossy), k.cubic_per_rad2, k.hysteresis_n_m, k.hysteresis_rad,
    ]  # fmt: skip


def _lines(groups: Sequence[tuple[Line, ...]]) -> tuple[Array, NDArray[np.int64]]:
    return _rows([[(e.shaft, e.order, e.amplitude, e.phase_rad) for e in group if e.amplitude] for group in groups], 4)


def _rows(groups: Sequence[Sequence[tuple[float, ...]]], width: int) -> tuple[Array, NDArray[np.int64]]:
    rows = [row for group in groups for row in group]
    counts = np.cumsum([0, *(len(group) for group in groups)])
    return np.array(rows, dtype=np.float64).reshape(-1, width), counts.astype(np.int64)


def substeps(chain: Chain, rate_hz: float, guide: Array) -> int:
    """Steps per sample for which the fastest mode times the step stays below `LARGEST_PHASE`."""
    rates = [0.0]
    for k, link in enumerate(chain.links):
        after = chain.shafts[k + 1].inertia_kg_m2
        onward = chain.links[k + 1] if k + 1 < len(chain.links) else None
        stiffness = link.stiffness_n_m_per_rad + link.hysteresis_n_m / link.hysteresis_rad
        damping = link.damping_n_m_s_per_rad + chain.shafts[k + 1].viscous_n_m_s
        if onward is None:
            stiffness += guide[0]
            damping += guide[1]
        else:
            stiffness += onward.stiffness_n_m_per_rad / onward.ratio**2
            damping += onward.damping_n_m_s_per_rad / onward.ratio**2
        rates += [math.sqrt(stiffness / after), damping / after]
    return max(1, math.ceil(max(rates) / (rate_hz * LARGEST_PHASE)))


def steady_twist(chain: Chain, motion: Array, acceleration: float, known: float = 0.0) -> tuple[Array, Array]:
    """Angles and speeds (shafts - 1,) of driven shafts that follow the motor, every spring in balance with its load.

    `motion`: angle and speed of the motor; `acceleration`: its acceleration [rad/s2]; `known`: torque that the load is
    known to ask for besides [N m].
    """
    n = len(chain.shafts)
    ratios = np.cumprod([1.0, *(link.ratio for link in chain.links)])
    speed = motion[1] / ratios
    way = float(np.sign(motion[1]))
    angle = motion[0] / ratios
    load = known
    twist = np.zeros(n)
    for k in range(n - 1, 0, -1):
        shaft, link = chain.shafts[k], chain.links[k - 1]
        load += shaft.coulomb_n_m * way + shaft.viscous_n_m_s * speed[k] - shaft.offset_n_m
        load += shaft.gravity_n_m * math.sin(angle[k] + shaft.gravity_phase_rad)
        load += shaft.inertia_kg_m2 * acceleration / ratios[k]
        twist[k] = load / link.stiffness_n_m_per_rad + 0.5 * link.gap_rad * float(np.sign(load))
        twist[k] += sum(e.amplitude * math.sin(e.order * angle[e.shaft] + e.phase_rad) for e in link.errors)
        load /= link.ratio
    for k in range(1, n):
        angle[k] = angle[k - 1] / chain.links[k - 1].ratio - twist[k]
    return angle[1:], speed[1:]


def lag_of(chain: Chain) -> Array:
    """How far each driven shaft is ahead where a torque on the load moves it ahead by 1, shape (shafts - 1,)."""
    ahead, out = 0.0, []
    after = math.prod(link.ratio for link in chain.links)
    for link in chain.links:
        after /= link.ratio
        ahead = ahead / link.ratio + 1.0 / (after * link.stiffness_n_m_per_rad)
        out.append(ahead)
    return np.array(out) / ahead
