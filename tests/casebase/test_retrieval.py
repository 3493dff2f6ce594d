"""Retrieve: the same cases as plain arithmetic finds, whatever changes underneath."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from casebase.library import CaseLibrary
from casebase.search.case_table import CaseTable, load_table
from casebase.search.retrieval import CaseMatrix
from casebase.search.similarity import LIMIT, Metric
from tests.casebase.made import VERSION, add_case, store


def table_of(values: NDArray[np.float64], labels: list[str] | None = None) -> CaseTable:
    """Return a table of these features, ids ascending."""
    count, size = values.shape
    ids = np.array([f"{row:032x}" for row in range(count)])
    empty = np.array([""] * count)
    kinds = np.array(labels or ["normal"] * count)
    origins = np.array(["measured"] * count)
    names = tuple(f"f{column}" for column in range(size))
    return CaseTable(1, "made", names, ids, kinds, origins, empty, empty, ids, values.astype(np.float32))


def metric_of(size: int, weights: NDArray[np.float64] | None = None) -> Metric:
    """Return a metric of unit scales."""
    names = tuple(f"f{column}" for column in range(size))
    even = np.full(size, 1 / size)
    return Metric(names, np.zeros(size), np.ones(size), even if weights is None else weights / weights.sum())


def test_contributions_add_up_to_the_distance_exactly() -> None:
    generator = np.random.default_rng(5)
    values = generator.normal(size=(300, 40))
    values[generator.random(values.shape) < 0.1] = np.nan
    matrix = CaseMatrix(table_of(values), metric_of(40, generator.random(40)))
    for match in matrix.search(generator.normal(size=40), 50):
        assert match.distance == pytest.approx(math.fsum(match.contributions.values()), rel=1e-12)
        assert min(match.contributions.values()) >= 0


def test_nearest_of_every_class_are_those_of_a_search_among_it() -> None:
    generator = np.random.default_rng(8)
    values, query = generator.normal(size=(400, 12)), generator.normal(size=12)
    values[generator.random(values.shape) < 0.1] = np.nan
    query[3] = math.nan
    table = table_of(values, generator.choice(["normal", "notch", "play"], 400).tolist())
    matrix = CaseMatrix(table, metric_of(12, generator.random(12)))
    near = matrix.nearest_by_class(query, 9)
    for label, rows in zip(table.classes, near.rows, strict=True):
        alone = matrix.search(query, 9, where=table.labels == label)
        assert rows.tolist() == [match.row for match in alone]
    assert [match.row for match in near.overall(9)] == [match.row for match in matrix.search(query, 9)]
    others = matrix.search(query, 1, where=table.labels != "play")
    assert [near.other_than("play")] != [None]
    assert near.other_than("play").row == others[0].row  # type: ignore[union-attr]
    assert near.of("none such") is None


def test_filter_comes_before_top_k() -> None:
    values = np.arange(2000.0)[:, None] / 1000
    table = table_of(values)
    where = np.zeros(2000, dtype=bool)
    where[[5, 1500, 1900]] = True
    found = CaseMatrix(table, metric_of(1)).search(np.zeros(1), 3, where=where)
    assert [match.row for match in found] == [5, 1500, 1900]
    assert CaseMatrix(table, metric_of(1)).search(np.zeros(1), 3, where=~where | True)[0].row == 0
    assert CaseMatrix(table, metric_of(1)).search(np.zeros(1), 3, where=np.zeros(2000, bool)) == ()


def test_close_cases_far_from_the_origin_are_told_apart() -> None:
    offsets = np.linspace(0, 1e-3, 1500)[:, None]
    table = table_of(LIMIT - 1 - offsets)
    query = np.array([LIMIT - 1.0])
    found = CaseMatrix(table, metric_of(1)).search(query, 3)
    truth = np.abs(table.values[:, 0].astype(np.float64) - query[0])
    np.testing.assert_allclose([m.distance for m in found], np.sort(truth)[:3], atol=1e-7)


def test_table_follows_every_change(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        cases = [
            add_case(library, session, [seed, math.nan if seed == 2 else 1.0], "notch", seed=seed) for seed in range(4)
        ]
    with library.reading() as session:
        first = load_table(session, VERSION)
        assert load_table(session, VERSION, first) is first
    np.testing.assert_array_equal(first.values, np.array([[0, 1], [1, 1], [2, np.nan], [3, 1]], np.float32))
    with library.transaction("test") as session:
        library.revise.retire(session, cases[0].id)
        library.revise.case(session, cases[1].id, {"label": "play"})
        library.revise.case(session, cases[2].id, {"quarantine_reason": "far from every measured notch"})
        add_case(library, session, [9.0, 9.0], "normal", seed=9)
    with library.reading() as session:
        second = load_table(session, VERSION, first)
        fresh = load_table(session, VERSION)
    assert second.labels.tolist() == ["play", "notch", "normal"]
    for name in ("ids", "labels", "values", "samples", "gearboxes"):
        np.testing.assert_array_equal(getattr(second, name), getattr(fresh, name))


def test_versions_of_the_extractor_never_mix(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        add_case(library, session, [1.0], "notch", seed=1)
        other = store(library, session, [1.0, 2.0, 3.0], seed=2, version="next")
        store(library, session, [5.0, 6.0, 7.0], seed=1, version="next")
    with library.reading() as session:
        assert load_table(session, VERSION).values.tolist() == [[1.0]]
        table = load_table(session, "next")
        assert table.values.tolist() == [[5.0, 6.0, 7.0]]
        assert [each.extractor_version for each in library.retrieve.recording(session, other.id).features] == ["next"]


def plain_distances(table: CaseTable, metric: Metric, query: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances feature by feature, in float64 between points in float32, in the order of the features."""
    present = np.isfinite(query)
    weights = np.where(present, metric.weights, 0.0)
    roots = np.sqrt(weights)
    missing = np.isnan(table.values)
    point = np.where(present, metric.scaled(query) * roots, 0.0).astype(np.float32).astype(np.float64)
    cases = np.where(missing, 0.0, metric.scaled(table.values) * roots).astype(np.float32).astype(np.float64)
    total = np.zeros(len(table))
    for j in range(query.size):
        total += np.where(missing[:, j], weights[j], 0.0)
    for j in np.flatnonzero(roots > 0):
        total += (cases[:, j] - point[j]) ** 2
    return np.asarray(np.sqrt(total * (1 / float(weights.sum()))))


@given(seed=st.integers(0, 2**32 - 1), gaps=st.sampled_from([0.0, 0.1]), count=st.integers(1, 700))
@settings(max_examples=40, deadline=None)
def test_distances_are_those_of_plain_arithmetic(seed: int, gaps: float, count: int) -> None:
    generator = np.random.default_rng(seed)
    values, query = generator.normal(scale=4.0, size=(count, 9)), generator.normal(size=9)
    values[generator.random(values.shape) < gaps] = np.nan
    query[generator.integers(1, 9)] = np.nan if gaps else 0.0
    table, metric = table_of(values), metric_of(9, generator.integers(0, 3, 9) + (np.arange(9) == 0.0))
    distances = plain_distances(table, metric, query)
    found = CaseMatrix(table, metric).search(query, 20)
    np.testing.assert_allclose([match.distance for match in found], np.sort(distances)[:20], rtol=1e-12)
    np.testing.assert_allclose(distances[[match.row for match in found]], np.sort(distances)[:20], rtol=1e-12)


def test_queries_together_find_no_kin_and_what_each_finds_alone() -> None:
    generator = np.random.default_rng(6)
    values = generator.normal(size=(700, 8))
    values[generator.random(values.shape) < 0.05] = np.nan
    table, metric = table_of(values), metric_of(8, generator.random(8))
    matrix = CaseMatrix(table, metric)
    boxes, sounds = generator.integers(0, 9, 700), generator.integers(0, 300, 700)
    groups = generator.integers(-1, 3, 700).astype(np.int16)
    asked = np.arange(40)
    kin = [(boxes, boxes[asked]), (sounds, sounds[asked])]
    rows, distances = matrix.nearest_strangers(table.values[asked], groups, 3, 4, kin)
    for query in asked:
        strangers = (boxes != boxes[query]) & (sounds != sounds[query])
        for group in range(3):
            alone = matrix.search(table.values[query], 4, where=strangers & (groups == group))
            assert rows[query, group].tolist() == [match.row for match in alone]
            assert distances[query, group].tolist() == [match.distance for match in alone]
