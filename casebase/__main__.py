"""Compile what is compiled, so that no first search waits for it: `python -m casebase`."""

from casebase.search.retrieval import search_once

search_once()
