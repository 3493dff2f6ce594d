"""From a `Chain` to the flat arrays of `observer_kernel`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.chain.model import CLOCK, Array, Chain, Line
from sim.chain.rows import dent_rows, line_rows, link_row, shaft_row
from sim.laws import ROW

Packed = tuple[Array | NDArray[np.int64], ...]
LARGEST_PHASE = 1.0  # fastest rate times step, per Runge-Kutta step of order 4


def pack(chain: Chain, begin_s: float = 0.0) -> Packed:
    """Arrays in the order that `observer_kernel.run` takes them, its first row `begin_s` after that of the record."""
    n = len(chain.shafts)
    shafts = np.array([shaft_row(shaft) for shaft in chain.shafts])
    links = np.array([link_row(link) for link in chain.links]).reshape(n - 1, 14)
    lines, line_first = _rows([line_rows(link.errors) for link in chain.links])
    dents, dent_first = _rows([dent_rows(link.dents) for link in chain.links])
    ripples, _ = _rows(
        [line_rows([_since(line, begin_s) for line in shaft.ripples], k) for k, shaft in enumerate(chain.shafts)]
    )
    return shafts, links, lines, line_first, dents.ravel(), ROW * dent_first, ripples


def _since(line: Line, begin_s: float) -> Line:
    return replace(line, phase_rad=line.phase_rad + line.order * begin_s) if line.shaft == CLOCK else line


def _rows(groups: Sequence[Sequence[tuple[float, ...]]]) -> tuple[Array, NDArray[np.int64]]:
    rows = [row for group in groups for row in group]
    counts = np.cumsum([0, *(len(group) for group in groups)])
    return np.array(rows, dtype=np.float64).reshape(-1, ROW), counts.astype(np.int64)


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


def lag_of(chain: Chain) -> Array:
    """How far each driven shaft is ahead where a torque on the load moves it ahead by 1, shape (shafts - 1,)."""
    ahead, out = 0.0, []
    after = math.prod(link.ratio for link in chain.links)
    for link in chain.links:
        after /= link.ratio
        ahead = ahead / link.ratio + 1.0 / (after * link.stiffness_n_m_per_rad)
        out.append(ahead)
    return np.array(out) / ahead
