"""Where a dent is looked for, against the simulation of that dent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from casebase.signals.telemetry import Telemetry
from sim.axis import Axis, read_axis
from sim.discrepancy.catalogue import tooth_damage
from sim.discrepancy.condition import examine
from sim.discrepancy.fit import Noise, Problem, Raw
from sim.discrepancy.measurement import Measurement
from sim.discrepancy.scan import scan
from sim.discrepancy.terms import Term
from tests.discrepancy.telemetry_of import swing

INERTIA, LOAD, TEETH, STIFFNESS = 0.01, 0.7, 90, 7e3
PITCH = 2.0 * math.pi / TEETH


def axis() -> Axis:
    stage = {"name": "output", "driver_teeth": 10, "driven_teeth": TEETH, "stiffness_n_m_per_rad": STIFFNESS}
    return read_axis(
        {
            "motor": {"inertia_kg_m2": INERTIA},
            "stages": [{**stage, "damping_n_m_s_per_rad": 3.0}],
            "load": {"inertia_kg_m2": LOAD},
        }
    )


def measured(load_encoder: bool) -> Measurement:
    t, angle, _, acceleration = swing()
    ratio = TEETH / 10
    moment = LOAD * acceleration / ratio
    rng = np.random.default_rng(3)
    channels = {
        "motor_torque_nm": INERTIA * acceleration + moment / ratio + 0.01 * rng.standard_normal(t.size),
        "motor_position_rad": angle + 2e-6 * rng.standard_normal(t.size),
    }
    if load_encoder:
        channels["load_position_rad"] = angle / ratio - moment / STIFFNESS + 2e-7 * rng.standard_normal(t.size)
    return examine(axis(), Telemetry(t, channels)).measurement


class Dented(Problem):
    """A problem whose data are its own simulation with one dent."""

    def hide(self, term: Term, values: Mapping[str, float]) -> None:
        self.hidden = super().raw_residuals((term,), values)

    def raw_residuals(self, terms: Sequence[Term], values: Mapping[str, float], *, weighted: bool = True) -> Raw:
        torque, guide = super().raw_residuals(terms, values, weighted=weighted)
        return torque - self.hidden[0], guide - self.hidden[1]


@pytest.mark.parametrize("load_encoder", [False, True])
@pytest.mark.parametrize("flank", [1, -1])
def test_the_scan_finds_the_tooth_by_all_channels(load_encoder: bool, flank: int) -> None:
    """Torque and load must ask for the same place: with one of them the other way round they cancel."""
    angle = -flank * 20.3 * PITCH  # where the swing turns round, and that flank carries
    problem = Dented(axis(), measured(load_encoder), Noise.flat(0.01, 0.05))
    term = tooth_damage("output", 0, TEETH, flank, angle, (), 0.0, 1e-2)
    depth, place, width = (p.name for p in term.parameters)
    described = {p.name: p.start for p in problem.base()}
    problem.hide(term, {**described, depth: 1e-5, place: angle, width: 2.0 * PITCH})
    fit = problem.fit(iterations=0)
    best = max(scan(problem, fit, {0: TEETH}), key=lambda p: p.gain)
    assert best.flank == flank
    assert abs(math.remainder(best.angle_rad - angle, 2.0 * math.pi)) < 0.15 * PITCH
    assert best.gain == pytest.approx(fit.misfit, rel=0.25)
