"""The simulator's own measurements have no noise: nothing else than what was simulated may be found in them."""

import json

import numpy as np
import pytest

from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.virtual_measurement import measure
from sim.investigation.estimation.whitening import floor_filter
from sim.investigation.investigate import investigate
from sim.mechanisms import MECHANISMS
from sim.mechanisms.catalogue import with_mechanism
from tests.sim.axes import WRIST

AXIS = read_axis(WRIST)
DURATION_S = 12.0


def worn(mechanism: str, place: str, **numbers: float) -> Axis:
    return with_mechanism(AXIS, MECHANISMS[mechanism](place, numbers))


def test_an_axis_that_is_as_described_has_nothing_missing() -> None:
    result = investigate(AXIS, measure(AXIS, DURATION_S).telemetry)
    assert (result.verdict, result.findings, result.unexplained) == ("nothing_missing", (), None)


@pytest.mark.parametrize(
    ("mechanism", "place", "name", "size"),
    [
        pytest.param("load_dependent_loss", "output", "fraction", 0.04, marks=pytest.mark.slow),
        ("torque_offset", "motor", "torque_n_m", 0.2),
    ],
)
def test_what_was_simulated_is_named_with_its_size(mechanism: str, place: str, name: str, size: float) -> None:
    """A loss acts before the spring here, where a load encoder does not see it."""
    result = investigate(AXIS, measure(worn(mechanism, place, **{name: size}), DURATION_S).telemetry)
    assert [(f.mechanism, f.location) for f in result.findings] == [(mechanism, place)]
    assert {p.name: p.value for p in result.findings[0].parameters}[name] == pytest.approx(size, rel=0.05)


def test_play_is_named_with_its_size_and_once_described_it_is_not_found_again() -> None:
    telemetry = measure(worn("backlash", "output", gap_rad=1e-3), DURATION_S).telemetry
    result = investigate(AXIS, telemetry)
    assert [(f.mechanism, f.location) for f in result.findings] == [("backlash", "output")]
    assert result.findings[0].parameters[0].value == pytest.approx(1e-3, rel=0.05)
    extended = json.loads(json.dumps(result.document()["extended_axis"]))
    assert investigate(read_axis(extended), telemetry).verdict == "nothing_missing"


def test_noise_is_never_taken_for_less_than_the_least_and_otherwise_as_it_is() -> None:
    noise = np.random.default_rng(1).standard_normal(60_000)
    weight = np.ones(noise.size)
    plain, floored = (floor_filter(noise, weight, 1000, 400, least=least) for least in (0.0, 0.5))
    assert (plain == floored).all()
    silent = floor_filter(1e-6 * noise, weight, 1000, 400, least=0.5)
    assert silent[0] == pytest.approx(2.0)
    assert np.abs(silent[1:]).max() < 1e-9
