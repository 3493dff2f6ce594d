"""How sure an answer may be: never surer for what a recording lacks, and as often right as it says."""

import json
from dataclasses import replace

import numpy as np
import pytest
from casebase.calibration import CIRCUMSTANCES, LACKS, PRIOR, Calibration, Usual, fitted, lacks
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special

from casebase.errors import ArtifactError

NOTHING = np.zeros((1, len(LACKS)))
SHARES = st.floats(0.02, 0.98)
AMOUNTS = st.lists(st.floats(0, 5), min_size=len(LACKS), max_size=len(LACKS))
COEFFICIENTS = st.lists(st.floats(0, 3), min_size=len(LACKS), max_size=len(LACKS))
PERFECT = {
    "cycles_left": 10.0,
    "share_left_out": 0.0,
    "standstill_fall_above_200_hz": 30.0,
    "unrepeated_share_12_200_hz": 0.0,
    "unrepeated_share_above_200_hz": 0.0,
    "louder_after_start": 0.0,
    "low_band_level": Usual().low_db,
    "noise_on_the_way_12_200_hz": Usual().way_db,
}


def probability(calibration: Calibration, share: float, lacking: np.ndarray, baseline: bool) -> float:
    return float(calibration.probability(np.array([share]), lacking.reshape(1, -1), np.array([baseline]))[0])


def lacking(**changed: float) -> np.ndarray:
    """Return what a recording lacks that is perfect but for this."""
    circumstances = {**PERFECT, **changed}
    return lacks(CIRCUMSTANCES, np.array([[circumstances[name] for name in CIRCUMSTANCES]]), Usual())[0]


@given(share=SHARES, baseline=st.booleans())
def test_with_perfect_information_the_probability_is_the_share(share: float, baseline: bool) -> None:
    assert probability(PRIOR, share, NOTHING, baseline) == pytest.approx(share)


def test_a_perfect_recording_lacks_nothing() -> None:
    assert lacking().tolist() == [0.0] * len(LACKS)


@given(share=SHARES, amounts=AMOUNTS, harm=COEFFICIENTS, hiding=COEFFICIENTS, place=st.integers(0, len(LACKS) - 1))
def test_nothing_that_a_recording_lacks_makes_an_answer_surer(
    share: float, amounts: list[float], harm: list[float], hiding: list[float], place: int
) -> None:
    calibration = replace(PRIOR, harm=tuple(harm), hiding=tuple(hiding))
    less = np.array(amounts)
    more = less.copy()
    more[place] += 1.0
    for baseline in (False, True):
        assert probability(calibration, share, more, baseline) <= probability(calibration, share, less, baseline)
    assert probability(calibration, share, less, True) <= probability(calibration, share, less, False) + 1e-12


@pytest.mark.parametrize(
    ("name", "values", "lack"),
    [
        ("cycles_left", (10.0, 3.0, 2.0, 1.0, 0.5, 0.0), "cycles"),
        ("share_left_out", (0.0, 0.1, 0.3, 0.5), "left out"),
        ("standstill_fall_above_200_hz", (30.0, 15.0, 10.0, 5.0, 0.0), "noise"),
        ("unrepeated_share_12_200_hz", (0.0, 0.1, 0.5), "unrepeated below 200 Hz"),
        ("unrepeated_share_above_200_hz", (0.0, 0.1, 0.5), "unrepeated above 200 Hz"),
        ("louder_after_start", (0.0, 1.0, 2.0, 4.0), "gain"),
        ("louder_after_start", (0.0, -1.0, -2.0, -4.0), "gain"),
        ("low_band_level", (-10.0, -30.0, -40.0, -60.0), "colour"),
        ("low_band_level", (-10.0, 10.0, 20.0, 40.0), "colour"),
        ("noise_on_the_way_12_200_hz", (-15.0, 10.0, 30.0), "colour"),
    ],
)
def test_each_lack_grows_with_its_own_circumstance_alone(name: str, values: tuple[float, ...], lack: str) -> None:
    found = np.array([lacking(**{name: value}) for value in values])
    column = LACKS.index(lack)
    assert found[0, column] == 0
    assert (np.diff(found[:, column]) >= 0).all()
    assert found[-1, column] >= 1
    assert not np.delete(found, column, axis=1).any()


def test_closed_forms_of_what_is_lacking() -> None:
    """Half the cycles cost one, a fall of 10 dB less one, two standard deviations beyond the second one."""
    assert lacking(cycles_left=1.5)[0] == pytest.approx(1.0)
    assert lacking(standstill_fall_above_200_hz=5.0)[2] == pytest.approx(1.0)
    assert lacking(low_band_level=Usual().low_db + 4 * Usual().low_spread_db)[6] == pytest.approx(1.0)


def test_what_a_recording_does_not_tell_is_not_held_against_it_twice() -> None:
    assert lacks(("other",), np.ones((3, 1)), Usual()).tolist() == [[0.0] * len(LACKS)] * 3
    assert PRIOR.unlike(("other",), np.ones((3, 1))).tolist() == [0.0] * 3


def test_what_the_library_lacks_itself_is_usual() -> None:
    """Of a library whose recordings are short, short recordings lack nothing."""
    values = np.array([[PERFECT[name] for name in CIRCUMSTANCES]] * 20)
    values[:, CIRCUMSTANCES.index("cycles_left")] = 1.5
    usual = Usual.of(CIRCUMSTANCES, values)
    assert usual.cycles == 1.5
    assert not lacks(CIRCUMSTANCES, values, usual).any()
    assert lacks(CIRCUMSTANCES, values, Usual())[:, 0] == pytest.approx(1.0)


def drawn(count: int, seed: int, truth: Calibration) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    share, baseline = rng.uniform(0.34, 0.99, count), rng.random(count) < 0.4
    amounts = rng.exponential(0.7, (count, len(LACKS))) * (rng.random((count, len(LACKS))) < 0.4)
    right = rng.random(count) < truth.probability(share, amounts, baseline)
    return share, amounts, baseline, right


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10**6), offset=st.floats(-0.5, 0.5), slope=st.floats(0.5, 1.5))
def test_probabilities_come_true(seed: int, offset: float, slope: float) -> None:
    """Learned from 6000 drawn answers, asked of 6000 others: in each tenth, right within the scatter of so many."""
    rng = np.random.default_rng(seed)
    truth = replace(
        PRIOR,
        offset=offset,
        slope=slope,
        harm=tuple(rng.uniform(0, 2, len(LACKS))),
        hiding=tuple(rng.uniform(0, 1, len(LACKS))),
    )
    share, amounts, baseline, right = drawn(6000, seed, truth)
    learned = fitted(share, amounts, baseline, right, np.full(6000, 1 / 6000), Usual())
    assert learned.observations == 6000
    share, amounts, baseline, right = drawn(6000, seed + 1, truth)
    said = learned.probability(share, amounts, baseline)
    for part in np.array_split(np.argsort(said), 10):
        scatter = np.sqrt(np.mean(said[part] * (1 - said[part])) / part.size)
        # four of the binomial, and 0.03 for what the prior draws
        assert np.mean(right[part]) == pytest.approx(np.mean(said[part]), abs=4 * scatter + 0.03)


def test_without_answers_the_prior_stays() -> None:
    """One answer moves it by next to nothing where it says nothing new, and coefficients stay above 0."""
    share = np.full(50, 0.5)
    learned = fitted(share, np.zeros((50, 7)), np.zeros(50, bool), np.arange(50) % 2 == 0, np.full(50, 0.02), Usual())
    assert (learned.harm, learned.hiding) == (pytest.approx(PRIOR.harm), pytest.approx(PRIOR.hiding))
    assert learned.offset == pytest.approx(0.0, abs=1e-3)
    rng = np.random.default_rng(1)
    amounts = rng.exponential(1.0, (500, 7))
    surer = rng.random(500) < special.expit(amounts.sum(axis=1))
    pushed = fitted(np.full(500, 0.5), amounts, np.ones(500, bool), surer, np.full(500, 1 / 500), Usual())
    assert min(*pushed.harm, *pushed.hiding) >= 0
    assert pushed.slope >= 0


def test_documents_come_back_and_others_are_refused() -> None:
    calibration = replace(PRIOR, offset=0.3, harm=(0.5,) * 7, usual=Usual(2.0, 11.0, -8.0, 4.0, -13.0, 5.0))
    document = json.loads(json.dumps(calibration.to_document()))
    assert Calibration.from_document(document) == calibration
    with pytest.raises(ArtifactError, match="other circumstances"):
        Calibration.from_document({**document, "harm": document["harm"][:-1]})
