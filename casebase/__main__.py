"""Compile what is compiled, so that no first search or table waits for it: `python -m casebase`."""

import os
from pathlib import Path

import numpy as np

from casebase.search.case_table import CaseTable
from casebase.search.retrieval import CaseMatrix
from casebase.search.similarity import Metric
from signals.reading.decimal_text import write_decimals


def search_once() -> None:
    """Search in a library of one case."""
    word = np.array(["x"])
    table = CaseTable(1, "made", ("f0",), word, word, word, word, word, word, np.zeros((1, 1), np.float32))
    CaseMatrix(table, Metric(("f0",), np.zeros(1), np.ones(1), np.ones(1))).search(np.ones(1), 1)


if __name__ == "__main__":
    search_once()
    write_decimals({"x": np.zeros(1)}, Path(os.devnull))
