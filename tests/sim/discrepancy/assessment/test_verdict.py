"""How sure a name is beside what has none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.description.axis_document import read_axis
from sim.discrepancy.assessment.cross_validation_gain import gains
from sim.discrepancy.assessment.verdict import (
    beside_doubts,
    finding_of,
    is_shaken_otherwise,
    likelier_than_new,
    said_alone,
    terms_said,
)
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.hypotheses.sensors import offset
from sim.discrepancy.hypotheses.traits import ERROR_OVER_ANGLE, OVER_SPEED
from sim.discrepancy.investigation import investigate
from sim.discrepancy.results import SAID, Estimate, Finding
from sim.mechanisms import CoulombFriction, GravityImbalance, StructuralResonance
from tests.sim.discrepancy.telemetry_of import one_body, swing


def term(mechanism: str, location: str | None, *, named: bool = True) -> Term:
    return Term(mechanism, location, (), (), lambda values: {}, named=named)


def test_what_shakes_the_load_is_unsure_beside_torque_at_the_load_that_has_no_name() -> None:
    swinging, weight = term(StructuralResonance.name, "load"), term(GravityImbalance.name, "load")
    unknown = term(OVER_SPEED, "load", named=False)
    assert is_shaken_otherwise(swinging, (swinging, unknown))
    assert is_shaken_otherwise(weight, (weight, unknown))
    assert not is_shaken_otherwise(swinging, (swinging, weight))


def test_it_is_not_beside_what_acts_elsewhere_or_is_in_every_axis() -> None:
    swinging, friction = term(StructuralResonance.name, "load"), term(CoulombFriction.name, None)
    at_motor, error = (term(OVER_SPEED, "motor", named=False), term(ERROR_OVER_ANGLE, "load", named=False))
    assert not is_shaken_otherwise(swinging, (swinging, friction, at_motor, error))
    assert not is_shaken_otherwise(friction, (friction, term(OVER_SPEED, "load", named=False)))


def test_of_a_doubted_torque_what_may_be_as_new_is_no_missing_mechanism() -> None:
    as_new = Finding(GravityImbalance.name, "load", 0.4, (), (), "", as_new_too=True)
    weak = Finding(CoulombFriction.name, "motor", 0.4, (), (), "")
    assert beside_doubts((as_new, weak), doubted=True) == (weak,)
    assert beside_doubts((as_new, weak), doubted=False) == (as_new, weak)


def test_of_a_doubted_torque_a_size_is_as_sure_as_it_is_many_deviations_from_none() -> None:
    axis = read_axis({"motor": {"inertia_kg_m2": 1.0}, "load": {"inertia_kg_m2": 0.0}})

    def sure(deviations: float, gain: float = math.inf, usual: float = 0.0) -> float:
        size = Estimate("torque_n_m", deviations, "N m", deviations - 1.645, deviations + 1.645)
        return likelier_than_new(axis, term(GravityImbalance.name, "load"), [size], gain, {"torque_n_m": usual})

    assert sure(0.0) < sure(2.0) < 0.1
    assert sure(3.0) < 0.5 < sure(4.0) < 0.9
    assert sure(6.0) > 0.99
    assert sure(6.0, usual=3.0) == pytest.approx(sure(3.0))
    assert sure(6.0, 9.0) == sure(3.0)  # of squares that count slow noise it gains three deviations


def test_what_stood_against_a_name_that_is_not_said_is_not_left_behind() -> None:
    """Friction unlike in both directions, and an offset that takes half of it back: without the offset the other is as
    large as it is, and unseen rows are predicted by that."""
    _, _, speed, _ = swing()
    axis = read_axis({
        "name": "bench", "load": {"inertia_kg_m2": 0.0},
        "motor": {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
    })  # fmt: skip
    result = investigate(axis, one_body(0.3, 1.0, 0.02, 7, extra=0.006 * np.abs(speed)))
    selection = result.selection
    assert selection is not None
    (asymmetry,) = selection.found
    (found,) = result.findings
    back = offset(1.0)
    torque = next(
        p.name
        for p in asymmetry.parameters
        if asymmetry.report({**selection.fit.values, p.name: 9.0}).get("torque_n_m") == 9.0
    )
    values = {**selection.fit.values, torque: selection.fit.values[torque] + 0.5, back.parameters[0].name: -0.5}
    both = replace(selection, fit=selection.problem.fit((*selection.fit.terms, back), values, iterations=0))
    doubted = Finding(back.mechanism, back.location, 0.1, (), (), "")
    findings, fit = said_alone(both, (finding_of(both, asymmetry), doubted))
    assert [(t.mechanism, f.probability >= SAID) for t, f in zip((asymmetry, back), findings, strict=True)] == [
        (asymmetry.mechanism, True), (back.mechanism, False),
    ]  # fmt: skip
    for said, plain in zip(findings[0].parameters, found.parameters, strict=True):
        assert said.value == pytest.approx(plain.value, abs=0.1 * (plain.high - plain.low))

    def left(of: Fit) -> float:
        return gains(selection.problem, selection.base, of, terms_said(of, findings))[0].rms_after

    assert left(fit) < 1.1 * left(selection.fit) < 0.5 * left(both.fit)
