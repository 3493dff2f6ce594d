"""How evidence becomes a probability."""

from __future__ import annotations

import numpy as np
import pytest

from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.assessment.posterior import Evidence, is_close, probability
from sim.investigation.search.held_out_blocks import paired


def test_a_name_loses_to_no_name_what_its_model_leaves() -> None:
    left = [probability(Evidence(0.1, (), left)) for left in (0.0, 0.3, 1.0, 7.0)]
    assert left == sorted(left, reverse=True)
    assert left[0] > 0.8
    assert left[2] < 0.5


def test_rivals_that_predict_as_well_share_the_probability() -> None:
    assert probability(Evidence(100.0, (0.0,), 0.0)) == pytest.approx(0.5, abs=0.01)
    assert probability(Evidence(100.0, (-6.0,), 0.0)) < 0.05
    assert is_close(0.0)
    assert not is_close(6.0)


def test_no_evidence_gives_more_than_what_was_ever_checked() -> None:
    assert probability(Evidence(1e6, (12.0,), 0.0)) == WEIGHTS.cap < 0.97


def test_blocks_say_by_their_scatter_not_by_their_sum() -> None:
    rng = np.random.default_rng(3)
    drop = rng.standard_normal(15)
    assert abs(paired(drop)) < 3.0
    assert paired(1e6 * drop) == pytest.approx(paired(100.0 * drop))
    assert paired(drop + 5.0) > 6.0
    assert abs(paired(np.full(14, 0.2))) < 3.0
    assert paired(np.zeros(15)) == 0.0
