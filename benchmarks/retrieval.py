"""Exact search for the ten nearest cases, beside NumPy's bare product, scikit-learn, faiss and cbrkit."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks import Row, best_seconds
from casebase.search.case_table import CaseTable
from casebase.search.retrieval import CaseMatrix
from casebase.search.similarity import Metric
from signals.features import catalogue

SIZES = (1_000, 10_000, 100_000)
NEAREST = 10
SLOWEST_PEER = 10_000
BARE = "bare product"
Vectors = NDArray[np.float32]


def made_matrix(values: Vectors) -> CaseMatrix:
    """Return our matrix of these vectors, under a metric that weighs all alike."""
    count, size = values.shape
    names = tuple(f"f{column}" for column in range(size))
    ids, word = np.array([f"{row:032x}" for row in range(count)]), np.resize(["normal", "notch", "play"], count)
    table = CaseTable(1, "made", names, ids, word, word, word, word, ids, values)
    return CaseMatrix(table, Metric(names, np.zeros(size), np.ones(size), np.full(size, 1 / size)))


def scikit_learn(values: Vectors) -> Callable[[Vectors], list[int]]:
    """Return scikit-learn's brute force."""
    from sklearn.neighbors import NearestNeighbors

    model = NearestNeighbors(n_neighbors=NEAREST, algorithm="brute").fit(values)
    return lambda query: model.kneighbors(query[None], return_distance=False)[0].tolist()


def faiss_flat(values: Vectors) -> Callable[[Vectors], list[int]]:
    """Return faiss's exact index."""
    import faiss

    index = faiss.IndexFlatL2(values.shape[1])
    index.add(values)
    return lambda query: index.search(query[None], NEAREST)[1][0].tolist()


def cbrkit_linear(values: Vectors) -> Callable[[Vectors], list[int]]:
    """Return cbrkit's retrieval with the negative squared distance as similarity."""
    import cbrkit

    casebase = dict(enumerate(values))

    def similarity(case: Vectors, query: Vectors) -> float:
        difference = case - query
        return -float(difference @ difference)

    retriever = cbrkit.retrieval.build(similarity, limit=NEAREST)
    return lambda query: list(cbrkit.retrieval.apply(casebase, query, retriever).ranking)


def compared(count: int, size: int) -> list[Row]:
    """Return the rows of one size; raises RuntimeError if anybody finds other cases than the others."""
    generator = np.random.default_rng(count)
    values = generator.normal(size=(count, size)).astype(np.float32)
    query = generator.normal(size=size).astype(np.float32)
    matrix = made_matrix(values)
    finders: dict[str, Callable[[Vectors], list[int]]] = {
        "gearcase": lambda point: [match.row for match in matrix.search(point, NEAREST)],
        "scikit-learn brute force": scikit_learn(values),
        "faiss flat": faiss_flat(values),
    }
    if count <= SLOWEST_PEER:
        finders["cbrkit"] = cbrkit_linear(values)
    found = {name: sorted(find(query)) for name, find in finders.items()}
    if len({tuple(rows) for rows in found.values()}) != 1:
        raise RuntimeError(f"not all found the same cases: {found}")
    calls: dict[str, Callable[[], object]] = {BARE: lambda: values @ query}
    calls |= {name: lambda find=find: find(query) for name, find in finders.items()}
    calls["gearcase, each case named, and why"] = lambda: [
        (match.case_id, match.label, match.distance, match.contributions) for match in matrix.search(query, NEAREST)
    ]
    calls["gearcase, nearest of three classes, as a diagnosis asks"] = lambda: matrix.nearest_by_class(query, NEAREST)
    best = best_seconds(calls, rounds=60 if count < SIZES[-1] else 20)
    return [_row(count, name, seconds, best) for name, seconds in best.items()]


def _row(count: int, name: str, seconds: float, best: dict[str, float]) -> Row:
    note = ""
    if name.startswith("gearcase"):
        note = f"{best['scikit-learn brute force'] / seconds:.1f} x as fast as scikit-learn"
    return Row(f"{count} cases: {name}", seconds, seconds / best[BARE], BARE, note)


def run() -> list[Row]:
    """Measure every size at the real number of features."""
    size = len(catalogue())
    return [row for count in SIZES for row in compared(count, size)]


if __name__ == "__main__":
    from benchmarks import table

    print(table(__doc__, run()))
