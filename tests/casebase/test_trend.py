"""A change is told with the promised rate of false alarms, whatever gain, offset and state of operation."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from numpy.typing import NDArray

from casebase.gearboxes import GearboxRecording, histories
from casebase.library import CaseLibrary
from casebase.reasoning.trend import (
    COLOUR,
    DECIDING,
    FOLLOWED,
    IMPACTS,
    RECORDINGS_PER_FALSE_ALARM,
    Change,
    Trend,
    changes_of,
    trend_of,
)
from tests.casebase.kept import keep

Floats = NDArray[np.float64]
START = datetime(2026, 1, 1, tzinfo=UTC)


def change_of(values: Floats, regressors: Floats) -> Change:
    """Of one feature."""
    return changes_of(values[:, None], regressors)[0]


def operation(rng: np.random.Generator, count: int) -> Floats:
    """Speed and payload, logarithms."""
    return np.log(rng.uniform((1.5, 20.0), (3.0, 50.0), (count, 2)))


def test_a_good_gearbox_gives_no_more_false_alarms_than_promised() -> None:
    """By the maximal inequality a good one gives one within n recordings with a probability of n over the limit."""
    rng, gearboxes, recordings = np.random.default_rng(1), 500, 40
    state = operation(rng, recordings)
    values = 5 + state @ [[2.0], [-1.0]] + 0.7 * rng.standard_normal((recordings, gearboxes))
    highest = np.zeros(gearboxes)
    for n in range(3, recordings + 1):
        evidence = [change.evidence for change in changes_of(values[:n], state[:n])]
        highest = np.maximum(highest, evidence)
    assert np.mean(highest >= RECORDINGS_PER_FALSE_ALARM) <= recordings / RECORDINGS_PER_FALSE_ALARM
    assert np.mean(highest >= 100) <= recordings / 100


def test_no_change_has_the_number_of_recordings_as_evidence_on_average() -> None:
    rng = np.random.default_rng(2)
    found = [change.evidence for change in changes_of(rng.standard_normal((12, 20_000)), np.empty((12, 0)))]
    assert np.mean(found) == pytest.approx(12, rel=0.15)  # a mean with a heavy tail, of clipped values


def test_a_rise_is_told_and_so_is_when_it_began() -> None:
    rng = np.random.default_rng(3)
    state = operation(rng, 40)
    values = state @ [2.0, -1.0] + rng.standard_normal(40)
    values[25:] += 3.0
    found = change_of(values, state)
    assert found.evidence >= RECORDINGS_PER_FALSE_ALARM
    assert abs(int(np.argmax(found.began)) - 25) <= 1
    assert found.began.sum() == pytest.approx(1.0)


def test_gain_offset_and_units_of_the_state_of_operation_do_not_matter() -> None:
    rng = np.random.default_rng(6)
    state, values = operation(rng, 20), rng.standard_normal(20) + np.linspace(0, 3, 20)
    one, other = change_of(values, state), change_of(-40 + 7 * values, state @ [[3.0, 0.0], [1.0, -2.0]] + 5)
    assert other.evidence == pytest.approx(one.evidence)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CaseLibrary]:
    opened = CaseLibrary.open(tmp_path_factory.mktemp("trend") / "data")
    yield opened
    opened.close()


def followed(library: CaseLibrary, gearbox: str, rises: float, order: Floats | None = None) -> Trend:
    """Trend of a gearbox whose strikes at the reversal rise from the 15th of 30 recordings on."""
    rng = np.random.default_rng(7)
    with library.transaction("test") as session:
        days = np.arange(30) if order is None else order
        rows = [{name: float(rng.standard_normal()) for name in DECIDING} for _ in range(30)]
        for day in days:
            told = dict(rows[int(day)])
            told["play_bump_12_200_hz"] += rises * (day >= 15)
            told[DECIDING[-1]] -= 0.5 * rises * (day >= 15)  # the crest factor falls meanwhile
            keep(session, "axis", gearbox, START + timedelta(days=int(day)), told)
        trend = trend_of(session, histories(session, "axis", gearbox)[-1])
    assert trend is not None
    return trend


def test_recordings_without_the_name_of_a_gearbox_make_no_trend(library: CaseLibrary) -> None:
    """They may be of several."""
    with library.transaction("test") as session:
        for number in range(3):
            keep(session, "axis", None, START + timedelta(days=number), {})
        assert trend_of(session, histories(session, "axis", None)[-1]) is None


def test_strikes_that_rise_are_told_though_the_crest_factor_falls(library: CaseLibrary) -> None:
    good, worn = followed(library, "good", 0.0), followed(library, "worn", 3.0)
    assert not good.changed
    assert worn.changed
    assert worn.leading.name == "play_bump_12_200_hz"
    assert worn.began.at == START + timedelta(days=15)
    expected = worn.leading.expected()
    assert expected.low < expected.adjusted[:15].min()
    assert expected.adjusted[15:].mean() > expected.adjusted[:15].max()


def test_a_feature_that_no_recording_has_does_not_count() -> None:
    """A motion without reversals has no impacts at a reversal."""
    rng = np.random.default_rng(9)
    columns = rng.standard_normal((20, len(FOLLOWED)))
    columns[10:, FOLLOWED.index("strongest_impulse_12_200_hz")] += 3
    heard = [
        GearboxRecording(str(number), START + timedelta(days=number), "", True, None, None) for number in range(20)
    ]
    all_known = Trend.of(heard, columns)
    columns[:, [FOLLOWED.index(name) for name in IMPACTS if "bump" in name]] = np.nan
    some_known = Trend.of(heard, columns)
    assert len(some_known.deciding) == len(all_known.deciding) - 6
    assert some_known.evidence > all_known.evidence


def test_the_time_of_recording_counts_and_not_that_of_upload(library: CaseLibrary) -> None:
    shuffled = followed(library, "shuffled", 3.0, np.random.default_rng(8).permutation(30))
    in_order = followed(library, "in order", 3.0)
    assert shuffled.evidence == pytest.approx(in_order.evidence)
    assert shuffled.began.at == in_order.began.at


def heard_colour(course: Floats) -> Trend:
    """Trend whose bands of the spectrum follow a course, up and down in turn, and whose impacts stay as they were."""
    count, rng = len(course), np.random.default_rng(10)
    columns = rng.standard_normal((count, len(FOLLOWED)))
    for number, name in enumerate(COLOUR):
        columns[:, FOLLOWED.index(name)] += course * (-1) ** number
    heard = [
        GearboxRecording(str(number), START + timedelta(days=number), "", True, None, None) for number in range(count)
    ]
    return Trend.of(heard, columns)


def test_a_colour_that_steps_is_a_change_at_once_and_says_when() -> None:
    stepped = heard_colour(3.0 * (np.arange(40) >= 25))
    assert stepped.at_once is not None
    assert stepped.at_once.at == START + timedelta(days=25)
    assert not stepped.changed


def test_a_colour_that_drifts_or_stays_is_none() -> None:
    drifts = heard_colour(np.linspace(0.0, 6.0, 40))
    assert drifts.colour_evidence >= RECORDINGS_PER_FALSE_ALARM
    assert drifts.at_once is None
    assert heard_colour(np.zeros(40)).at_once is None


def test_impacts_that_rise_more_clearly_are_a_fault_and_no_exchange() -> None:
    rng = np.random.default_rng(11)
    columns = rng.standard_normal((40, len(FOLLOWED)))
    columns[25:, [FOLLOWED.index(name) for name in IMPACTS]] += 6.0
    columns[25:, [FOLLOWED.index(name) for name in COLOUR]] += 2.0
    heard = [
        GearboxRecording(str(number), START + timedelta(days=number), "", True, None, None) for number in range(40)
    ]
    worn = Trend.of(heard, columns)
    assert worn.changed
    assert worn.at_once is None


def test_the_colour_of_good_gearboxes_gives_no_more_questions_than_promised() -> None:
    """Of 150 gearboxes of 40 recordings six may be asked about, by the maximal inequality; with 4 sigma above, 14."""
    rng = np.random.default_rng(12)
    heard = [
        GearboxRecording(str(number), START + timedelta(days=number), "", True, None, None) for number in range(40)
    ]
    asked = sum(
        any(Trend.of(heard[:count], columns[:count]).at_once is not None for count in range(5, 41, 5))
        for columns in rng.standard_normal((150, 40, len(FOLLOWED)))
    )
    assert asked <= 14
