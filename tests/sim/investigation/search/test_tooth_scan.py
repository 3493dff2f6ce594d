"""Where a dent is looked for, against the simulation of that dent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import swing
from signals.telemetry import Telemetry
from sim.description.axis import Axis, MechanismEntry
from sim.description.axis_document import read_axis
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.data.validation import examine
from sim.investigation.estimation.estimate import Raw
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import Noise
from sim.investigation.hypotheses.gear_mesh import tooth_damage
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.known_mechanisms import Described
from sim.investigation.model.nominal import chain_of
from sim.investigation.search.tooth_scan import scan

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
    depth, place, width, form = (p.name for p in term.parameters)
    described = {p.name: p.start for p in problem.base()}
    problem.hide(term, {**described, depth: 1e-5, place: angle, width: 1.2 * PITCH, form: 2.0})
    fit = problem.fit(iterations=0)
    best = max(scan(problem, fit.terms, fit.values, {0: TEETH}), key=lambda p: p.gain)
    assert best.flank == flank
    assert abs(math.remainder(best.angle_rad - angle, 2.0 * math.pi)) < 0.15 * PITCH
    assert best.gain == pytest.approx(fit.misfit, rel=0.25)


def test_a_dent_that_was_found_is_the_same_dent_in_the_extended_axis() -> None:
    term = tooth_damage("output", 0, TEETH, -1, 1.0, (), 0.0, 1e-2)
    values = dict(zip((p.name for p in term.parameters), (3e-4, 1.1, 0.05, 6.0), strict=True))
    chain = chain_of(axis(), {})
    entry = MechanismEntry("tooth_damage", "output", dict(term.report(values)))
    (found,) = term.apply(chain, values).links[0].dents
    (stored,) = Described.by(replace(axis(), mechanisms=(entry,))).apply(chain).links[0].dents
    assert stored.half_width_rad == pytest.approx(found.half_width_rad, rel=1e-12)
    assert replace(stored, half_width_rad=found.half_width_rad) == found
