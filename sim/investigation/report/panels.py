"""One plot as numbers: what the page draws with a script and the report as an image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.chain.model import Array

DIGITS = 4
MEASURED, FLOOR = "measured", "noise floor"
DESCRIBED, EXTENDED = "description, calibrated", "with what was found"
RIGID = "rigid body, as described"
AS_DESCRIBED = "as described, without it"
SOUND = "sound"
SHOWS = (
    "“Measured” is the measured torque less all that the model has besides this finding. Where “with what was found” "
    "lies on it, the finding explains it."
)
STYLES = {DESCRIBED: 1, RIGID: 1, AS_DESCRIBED: 1, EXTENDED: 2, MEASURED: 5, FLOOR: 6, SOUND: 7}
"""Colour and stroke of a thing, by number, in every panel of page and report; others are 1 to 4 as they come."""


def style_of(name: str, place: int) -> int:
    """Return the number of a line's colour and stroke; `place`: how many stand before it in its panel.

    >>> style_of(MEASURED, 0), style_of(DESCRIBED, 1), style_of("around one end", 0)
    (5, 1, 1)
    """
    return STYLES.get(name, place % 4 + 1)


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
