"""Compile what is compiled, so that no first search waits for it: `python -m casebase`."""

import numpy as np

from casebase.search.case_table import CaseTable
from casebase.search.retrieval import CaseMatrix
from casebase.search.similarity import Metric


def search_once() -> None:
    """Search in a library of one case."""
    word = np.array(["x"])
    table = CaseTable(1, "made", ("f0",), word, word, word, word, word, word, np.zeros((1, 1), np.float32))
    CaseMatrix(table, Metric(("f0",), np.zeros(1), np.ones(1), np.ones(1))).search(np.ones(1), 1)


if __name__ == "__main__":
    search_once()
