"""Causes that one evidence lets in, on axes whose law is closed."""

from __future__ import annotations

import numpy as np
import pytest

from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.discrepancy.investigation import Criterion, investigate
from tests.sim.discrepancy.telemetry_of import one_body, swing

INERTIA, COULOMB, VISCOUS = 0.02, 0.5, 0.01


def axis(coulomb: float = COULOMB, viscous: float = VISCOUS) -> Axis:
    friction = {"coulomb_friction_n_m": coulomb, "viscous_friction_n_m_s_per_rad": viscous}
    motor = {"inertia_kg_m2": INERTIA, **friction}
    return read_axis({"name": "body", "motor": motor, "load": {"inertia_kg_m2": 0.0}})


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_comes_in_where_the_description_is_right(seed: int) -> None:
    found = investigate(axis(), one_body(INERTIA, COULOMB, VISCOUS, seed), criterion=Criterion.EVIDENCE)
    assert (found.verdict, found.findings) == ("nothing_missing", ())


def test_both_frictions_that_a_description_leaves_out_are_named_with_their_sizes() -> None:
    result = investigate(axis(0.0, 0.0), one_body(INERTIA, COULOMB, VISCOUS, 3), criterion=Criterion.EVIDENCE)
    sizes = {f.mechanism: f.parameters[0].value for f in result.findings}
    assert sizes == {
        "coulomb_friction": pytest.approx(COULOMB, rel=0.05),
        "viscous_friction": pytest.approx(VISCOUS, rel=0.05),
    }
    assert min(f.probability for f in result.findings) > 0.9


def test_a_weight_is_named_and_neither_an_offset_nor_an_asymmetry_beside_it() -> None:
    _, angle, *_ = swing()
    telemetry = one_body(INERTIA, COULOMB, VISCOUS, 4, extra=0.3 * np.sin(angle + 0.7))
    (finding,) = investigate(axis(), telemetry, criterion=Criterion.EVIDENCE).findings
    assert finding.mechanism in ("gravity_imbalance", "torque_ripple")  # of one body once per turn
    assert finding.parameters[0].value == pytest.approx(0.3, rel=0.05)


def test_a_curve_over_the_speed_that_has_no_name_gets_none() -> None:
    """Friction with a bump at 40 % of the speed, a quarter of all friction: no law of the catalogue."""
    _, _, speed, _ = swing()
    bump = 0.6 * COULOMB * np.exp(-(((np.abs(speed) - 24.0) / 5.0) ** 2)) * np.sign(speed)
    result = investigate(axis(), one_body(INERTIA, COULOMB, VISCOUS, 5, extra=bump), criterion=Criterion.EVIDENCE)
    assert result.verdict == "unnamed"
    assert not [f for f in result.findings if f.probability >= 0.5]
