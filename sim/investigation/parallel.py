"""Work on several threads, results in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")
WORKERS = 2


def each(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """`function` of all items, in order, on all cores: the simulation leaves the interpreter alone."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(function, items))
