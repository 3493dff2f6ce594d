"""How sure a name is beside what has none."""

from __future__ import annotations

import math

from sim.description.axis_document import read_axis
from sim.discrepancy.assessment.verdict import beside_doubts, is_shaken_otherwise, likelier_than_new
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.hypotheses.traits import ERROR_OVER_ANGLE, OVER_SPEED
from sim.discrepancy.results import Estimate, Finding
from sim.mechanisms import CoulombFriction, GravityImbalance, StructuralResonance


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

    def sure(deviations: float, gain: float = math.inf) -> float:
        size = Estimate("torque_n_m", deviations, "N m", deviations - 1.645, deviations + 1.645)
        return likelier_than_new(axis, term(GravityImbalance.name, "load"), [size], gain)

    assert sure(0.0) < sure(2.0) < 0.1
    assert sure(3.0) < 0.5 < sure(4.0) < 0.9
    assert sure(6.0) > 0.99
    assert sure(6.0, 9.0) == sure(3.0)  # of squares that count slow noise it gains three deviations
