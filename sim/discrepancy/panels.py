"""One plot as numbers: what the page draws with a script and the report as an image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.chain_model import Array

DIGITS = 4
FLOOR = "noise floor"


@dataclass(frozen=True)
class Panel:
    """Lines over one x, each of shape (n,), NaN where there is nothing; `noise` is a band of y and `band` its name.

    Panels with the same `cursor` are read together.
    """

    title: str
    x_label: str
    y_label: str
    cursor: str
    x: Array
    lines: tuple[tuple[str, Array], ...]
    noise: tuple[float, float] | None = None
    markers: tuple[tuple[float, str], ...] = ()
    band: str = FLOOR

    @property
    def has_floor(self) -> bool:
        """Whether it says what noise alone would be, as a band or as a line."""
        return self.noise is not None or any(name == FLOOR for name, _ in self.lines)

    def document(self) -> dict[str, object]:
        """JSON; what is not finite is null."""
        return {
            "title": self.title,
            "x_label": self.x_label,
            "y_label": self.y_label,
            "cursor": self.cursor,
            "x": _numbers(self.x),
            "lines": [{"name": name, "y": _numbers(y)} for name, y in self.lines],
            "noise": None if self.noise is None else _numbers(np.array(self.noise)),
            "band": self.band,
            "markers": [{"x": x, "text": text} for x, text in self.markers],
        }


def _numbers(values: Array) -> list[float | None]:
    return [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in values.tolist()]
