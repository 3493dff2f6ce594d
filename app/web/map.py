"""The library as a map: cases by the first two principal components of their scaled features."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.web.svg import Point
from app.web.templating import percent
from casebase.case_table import CaseTable
from casebase.signals.features import catalogue

Floats = NDArray[np.float64]
SHOWN, FEWEST, FARTHEST = 1500, 3, 8.0


@dataclass(frozen=True)
class Projection:
    """Places of the cases, shape (cases, 2), and how another recording is put among them."""

    table: CaseTable
    names: tuple[str, ...]
    middle: Floats
    spread: Floats
    centre: Floats
    axes: Floats
    places: Floats
    shares: tuple[float, float]

    @property
    def titles(self) -> tuple[str, str]:
        """What stands at the two axes."""
        first, second = (
            f"component {k + 1} [1], {percent(share)} of the spread" for k, share in enumerate(self.shares)
        )
        return first, second

    def points(self, root: str) -> list[Point]:
        """Return at most SHOWN of the cases, evenly taken."""
        step = -(-len(self.table) // SHOWN)
        return [self._point(row, root) for row in range(0, len(self.table), step)]

    def place(self, features: Mapping[str, float | None]) -> Point:
        """Return where a recording lies."""
        vector = np.array([features.get(name) for name in self.names], dtype=np.float64)
        x, y = (_scaled(vector, self.middle, self.spread) - self.centre) @ self.axes.T
        return Point(float(x), float(y), "query", "measured", "", "the recording asked for")

    def _point(self, row: int, root: str) -> Point:
        table = self.table
        label, origin = str(table.labels[row]), str(table.origins[row])
        text = f"{label}, {origin}, gearbox {table.gearboxes[row] or 'not given'}"
        x, y = self.places[row]
        return Point(float(x), float(y), label, origin, f"{root}/cases/{table.ids[row]}", text)


def projected(table: CaseTable) -> Projection | None:
    """Return the map of a library, None with fewer than three cases.

    Features are scaled by median and median absolute deviation; a missing value counts as the median.
    """
    if len(table) < FEWEST:
        return None
    known = catalogue()
    compared = np.array([name not in known or known[name].compared for name in table.names])
    values = table.values.astype(np.float64)
    middle = np.nan_to_num(np.nanmedian(values, axis=0))
    spread = np.nan_to_num(np.nanmedian(np.abs(values - middle), axis=0))
    used = compared & (spread > 0)
    names = tuple(name for name, kept in zip(table.names, used, strict=True) if kept)
    middle, spread = middle[used], spread[used]
    scaled = _scaled(values[:, used], middle, spread)
    centre = scaled.mean(axis=0)
    strength, axes = np.linalg.eigh(np.cov(scaled - centre, rowvar=False))
    first = axes[:, ::-1][:, :2].T
    shares = strength[::-1][:2] / strength.sum()
    places = (scaled - centre) @ first.T
    return Projection(table, names, middle, spread, centre, first, places, (float(shares[0]), float(shares[1])))


def _scaled(values: Floats, middle: Floats, spread: Floats) -> Floats:
    return np.clip(np.nan_to_num((values - middle) / spread), -FARTHEST, FARTHEST)
