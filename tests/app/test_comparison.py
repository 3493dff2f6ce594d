"""What the simulated sound gets wrong: distances that are 0 where nothing differs, causes found by replacing them."""

from dataclasses import replace

import numpy as np
import pytest

from app.simulated.comparison import CAUSES, Space, _families, compare
from signals.features import catalogue
from sim.acoustics.transfer_path_fit import NormalRecording, scenario_like
from sim.errors import ParameterError
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.virtual_measurement import DEFAULT_MICROPHONE

NAMES = list(catalogue())
BAND = [k for k, name in enumerate(NAMES) if name.startswith("band_level")]


def _vectors(random: np.random.Generator, count: int) -> np.ndarray:
    return random.standard_normal((count, len(NAMES)))


def test_the_distance_of_two_samples_of_one_kind_is_zero_on_average() -> None:
    random, width = np.random.default_rng(0), len(NAMES)
    space = Space(np.ones(width, dtype=np.bool_), np.zeros(width), np.ones(width))
    found = [space.distance(_vectors(random, 8), _vectors(random, 12)) for _ in range(40)]
    assert abs(np.mean(found)) < 3 * np.std(found) / np.sqrt(len(found))


def test_recordings_of_one_gearbox_do_not_count_as_many() -> None:
    """Gearboxes differ, recordings of one hardly: of one kind, one test in twenty may find a difference."""
    random = np.random.default_rng(1)
    found = []
    for _ in range(20):
        boxes = _vectors(random, 4).repeat(6, axis=0)
        measured, simulated = boxes + 0.1 * _vectors(random, 24), _vectors(random, 12)
        groups = [f"g{number}" for number in range(4) for _ in range(6)]
        found.append(Space.of(measured, simulated).test(measured, groups, simulated, "bands")[1])
    assert np.mean(np.array(found) < 0.05) <= 0.15
    assert np.median(found) > 0.2


def test_the_family_that_differs_is_named_with_the_cause_that_mends_it() -> None:
    random = np.random.default_rng(3)
    simulated, mended = _vectors(random, 16), _vectors(random, 16)
    halves = [_vectors(random, 6), _vectors(random, 6)]
    for half in halves:
        half[:, BAND] += 3.0
    mended[:, BAND] += 2.5
    groups = [f"g{number}" for number in range(12)]
    space = Space.of(np.concatenate(halves), simulated)
    found = {"microphone band": [mended, mended], "rubbing": [simulated, simulated]}
    first, *others = _families(space, halves, groups, simulated, found)
    assert (first.family, first.cause, first.p_value < 0.05) == ("bands", "microphone band", True)
    assert first.gain is not None
    assert first.gain > 0.5
    assert first.farthest[0].difference < -2.0
    assert first.farthest[0].feature.startswith("band_level")
    assert {each.cause for each in others} == {None}


def test_recordings_that_move_as_none_of_the_simulated_do_have_motion_for_a_cause() -> None:
    heard = NormalRecording(np.zeros(32_000, np.float32), 2.9, 40.0, 1.5)
    recordings = {}
    for seed in range(2):
        scenario = scenario_like(PAPER_AXIS, heard, DEFAULT_MICROPHONE, seed)
        recordings[f"g{seed}"] = [replace(heard, samples=scenario.perform())]
    found = compare(PAPER_AXIS, "normal", recordings, {}, count=4, causes=("motion", "rubbing"))
    (motion,) = found.extensions
    assert motion.cause == "motion"
    assert min(motion.gain.halves) > 0
    assert found.together in (motion.gain, None)
    assert (found.measured, found.gearboxes, found.simulated) == (2, 2, 4)
    assert found.not_tried[0].startswith("rubbing: needs normal recordings")


def test_what_cannot_be_compared_is_refused_with_what_is_needed() -> None:
    heard = NormalRecording(np.zeros(32_000, np.float32), 2.9, 40.0, 1.5)
    with pytest.raises(ParameterError, match="two are needed"):
        compare(PAPER_AXIS, "play", {"g0": [heard]}, {}, count=4)
    with pytest.raises(ParameterError, match="motion"):
        compare(PAPER_AXIS, "play", {}, {}, count=4, causes=("motoin",))
    assert "motion" in CAUSES
