"""What an investigation knows of mechanisms beforehand."""

from __future__ import annotations

import pytest

from sim.mechanisms import MECHANISMS
from sim.mechanisms.mechanism import Law


@pytest.mark.parametrize("law", Law)
def test_a_law_is_that_of_several_mechanisms_and_leaves_less_than_it_gains(law: Law) -> None:
    assert sum(law in kind.traits.laws for kind in MECHANISMS.values()) > 1
    assert 0.0 < law.share < 1.0
