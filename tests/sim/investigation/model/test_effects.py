"""What a description says is missing no more, and acts where it says."""

from __future__ import annotations

import pytest

from sim.chain.model import Chain, Link, Shaft
from sim.investigation.model.effects import lopsided

CHAIN = Chain((Shaft(0.01, 0.3, 2e-3), Shaft(2.0, 5.0, 4.0)), (Link(50.0, 1e5, 20.0),))


@pytest.mark.parametrize("location", ["motor", None])
def test_friction_that_differs_by_direction_differs_by_as_much_at_the_motor_wherever_it_acts(
    location: str | None,
) -> None:
    motor, load = lopsided(CHAIN, location, 0.04, 3e-4).shafts
    backward = [s.coulomb_n_m if s.coulomb_backward_n_m is None else s.coulomb_backward_n_m for s in (motor, load)]
    viscous = [s.viscous_n_m_s if s.viscous_backward_n_m_s is None else s.viscous_backward_n_m_s for s in (motor, load)]
    assert motor.coulomb_n_m - backward[0] + (load.coulomb_n_m - backward[1]) / 50.0 == pytest.approx(0.08)
    assert motor.viscous_n_m_s - viscous[0] + (load.viscous_n_m_s - viscous[1]) / 2500.0 == pytest.approx(6e-4)
    assert (load.coulomb_n_m == backward[1]) == (location == "motor")


def test_what_differs_by_direction_everywhere_is_the_same_share_of_either_friction() -> None:
    motor, load = lopsided(CHAIN, None, 0.04, 0.0).shafts
    assert motor.coulomb_n_m / 0.3 == pytest.approx(load.coulomb_n_m / 5.0)
    assert motor.coulomb_n_m / 0.3 == pytest.approx(1.0 + 0.04 / (0.3 + 5.0 / 50.0))


def test_without_any_friction_the_motor_has_all_of_what_differs() -> None:
    bare = Chain((Shaft(0.01), Shaft(2.0)), CHAIN.links)
    motor, load = lopsided(bare, None, 0.04, 0.0).shafts
    assert (motor.coulomb_n_m, motor.coulomb_backward_n_m, load.coulomb_n_m) == (0.04, -0.04, 0.0)
