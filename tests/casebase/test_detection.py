"""No fault has to be earned: what would not be heard under the noise of a recording is not excluded by it."""

from dataclasses import replace

import numpy as np
import pytest
from casebase.detection import BUMPS, NOISE, WORTH_SAYING_DB, Detection
from hypothesis import given
from hypothesis import strategies as st

from casebase.case_table import CaseTable

NAMES = (NOISE, *BUMPS)
CLASSES = ("normal", "notch", "play")


def table(bump_db: dict[str, tuple[float, ...]], noise_db: float = -15.0) -> CaseTable:
    """Return cases whose own bump has these heights, each of a gearbox of its own; the other bump is noise."""
    labels = [label for label in CLASSES for _ in bump_db[label]]
    heights = [height for label in CLASSES for height in bump_db[label]]
    values = [
        (noise_db, height if label == "notch" else 0.0, height if label == "play" else 0.0)
        for label, height in zip(labels, heights, strict=True)
    ]
    ids = np.array([f"{row:032x}" for row in range(len(labels))])
    measured, nothing = np.array(["measured"] * len(labels)), np.array([""] * len(labels))
    boxes = np.array([f"g{row}" for row in range(len(labels))])
    return CaseTable(
        1, "made", NAMES, ids, np.array(labels), measured, nothing, boxes, ids, np.array(values, np.float32)
    )


def detection(**bump_db: tuple[float, ...]) -> Detection:
    cases = table({"normal": (0.0, 0.0, 0.0), "notch": (10.0,), "play": (10.0,), **bump_db})
    return Detection.of(cases, np.ones(len(cases), bool))


def at(noise_db: float) -> np.ndarray:
    return np.array([noise_db, 0.0, 0.0])


def height_under(height_db: float, more_db: float) -> float:
    """The power of bump and noise over that of the noise, which is so much stronger."""
    bump = 10 ** (height_db / 10) - 1
    return float(10 * np.log10((bump + 10 ** (more_db / 10)) / 10 ** (more_db / 10)))


@given(height_db=st.floats(WORTH_SAYING_DB + 0.1, 40), more_db=st.floats(0, 50))
def test_a_bump_is_missed_where_it_no_longer_stands_out(height_db: float, more_db: float) -> None:
    left = height_under(height_db, more_db)
    if abs(left - WORTH_SAYING_DB) > 1e-2:
        missed = detection(notch=(height_db,)).missed(at(-15.0 + more_db))
        assert missed[1] == (1.0 if left < WORTH_SAYING_DB else 0.0)


def test_without_more_noise_nothing_is_missed() -> None:
    for noise_db in (-100.0, -30.0, -15.0):
        assert detection(notch=(3.1, 5.0, 20.0)).missed(at(noise_db)).tolist() == [0.0, 0.0, 0.0]


def test_under_infinite_noise_all_is_missed() -> None:
    """A sound gear is then no more likely than either fault."""
    found = detection()
    missed = found.missed(at(1e3))
    assert missed.tolist() == [0.0, 1.0, 1.0]
    assert found.earned(np.array([1.0, 0.0, 0.0]), missed) == pytest.approx([1 / 3] * 3)


def test_more_noise_never_lets_more_be_heard() -> None:
    found = detection(notch=(4.0, 8.0, 12.0, 16.0), play=(6.0, 30.0))
    missed = np.array([found.missed(at(noise_db)) for noise_db in np.arange(-20.0, 40.0, 0.5)])
    assert (np.diff(missed, axis=0) >= 0).all()
    assert len(np.unique(missed[:, 1])) == 5


@given(
    shares=st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)).filter(lambda each: sum(each) > 0.01),
    missed=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_shares_sum_to_one_and_only_normal_gives(
    shares: tuple[float, float, float], missed: tuple[float, float]
) -> None:
    before = np.array(shares) / sum(shares)
    after = detection().earned(before, np.array([0.0, *missed]))
    assert after.sum() == pytest.approx(1.0)
    assert after[0] <= before[0] + 1e-12
    assert (after[1:] >= before[1:] - 1e-12).all()


def test_a_gearbox_that_is_held_out_does_not_count() -> None:
    """Of a faint and a clear notch, the faint one is missed; without it none is, without the clear one all are."""
    found = detection(notch=(4.0, 30.0))
    faint, clear = found.groups[1]
    noisy = at(-15.0 + 10)
    assert [found.missed(noisy, but)[1] for but in ("", faint, clear)] == [0.5, 0.0, 1.0]


def test_cases_without_a_vote_and_recordings_that_tell_no_noise_say_nothing() -> None:
    cases = table({"normal": (0.0,), "notch": (4.0, 30.0), "play": (10.0,)})
    voters = np.array([True, False, True, True])
    assert Detection.of(cases, voters).missed(at(0.0))[1] == 0.0
    assert Detection.of(cases, ~voters | (cases.labels != "notch")).missed(at(0.0))[1] == 1.0
    assert detection().missed(at(np.nan)).tolist() == [0.0, 0.0, 0.0]
    other = replace(cases, names=("f0", "f1", "f2"))
    assert Detection.of(other, np.ones(4, bool)).missed(at(1e3)).tolist() == [0.0, 0.0, 0.0]


def test_a_fault_that_no_bump_tells_is_never_called_missed() -> None:
    assert detection(play=(0.0, 1.0, 2.0)).missed(at(1e3)).tolist() == [0.0, 1.0, 0.0]
