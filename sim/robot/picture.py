"""A picture of the arm: its joints numbered, marked by shape and colour for what was found, their names beside it."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from sim.mechanisms.catalogue import is_in_every_axis

Array = NDArray[np.float64]

SAYS = {
    "nothing_missing": "nothing was found",
    "named": "something was found",
    "unnamed": "something without a name",
    "unusable": "its torque says nothing",
}
WIDTH, ARM, LINE, EDGE = 480.0, 240.0, 34.0, 22.0  # of the picture [px]; names stand to the right of the arm
LONGEST = 22  # characters of a name
SHAPES = {
    "nothing_missing": '<circle r="12"/>',
    "named": '<path d="M0-16L15 11H-15Z"/>',
    "unnamed": '<path d="M0-15L15 0L0 15L-15 0Z"/>',
}
STYLE = """.arm{font:17px system-ui,sans-serif;max-width:34rem}.arm text{fill:currentColor}
.arm .number{font-size:13px;font-weight:600;text-anchor:middle}
.arm .links{fill:none;stroke:var(--edge);stroke-width:9;stroke-linejoin:round;stroke-linecap:round}
.arm .joint>:first-child{fill:var(--paper);stroke:var(--first);stroke-width:2.5}
.arm .named>:first-child{stroke:var(--second)}.arm .unnamed>:first-child{stroke:var(--third)}"""
"""Of the report; the sheet of the pages has the same in their colours."""


def seen(points: Array) -> Array:
    """Points in space, shape (n, 3), as seen from 30 degrees to the side and 20 above, shape (n, 2)."""
    side, above = np.radians(30.0), np.radians(20.0)
    x, y, z = points.T
    depth = x * np.cos(side) + y * np.sin(side)
    return np.stack([-x * np.sin(side) + y * np.cos(side), z * np.cos(above) - depth * np.sin(above)], axis=1)


def picture(robot: str, places: Sequence[Sequence[float]], joints: Sequence[tuple[str, str]]) -> str:
    """The arm as inline SVG.

    `places`: base, joints and flange as seen, shape (joints + 2, 2) [m]; `joints`: name and verdict of each.
    """
    flat = np.array(places)
    flat = (flat - flat.min(axis=0)) / max(float(np.ptp(flat, axis=0).max()), 1e-9) * (ARM - 2 * EDGE)
    tall = max(float(np.ptp(flat[:, 1])) + 2 * EDGE, LINE * len(joints) + EDGE)
    across = EDGE + flat[:, 0] + (ARM - 2 * EDGE - float(np.ptp(flat[:, 0]))) / 2
    down = tall / 2 + float(np.ptp(flat[:, 1])) / 2 - flat[:, 1]
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, down, strict=True))
    own = list(zip(across[1:-1], down[1:-1], strict=True))
    first = (tall - LINE * (len(joints) - 1)) / 2
    marks = []
    for k, ((name, verdict), (x, y)) in enumerate(zip(joints, own, strict=True), start=1):
        row = first + LINE * (k - 1)
        short = name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…"
        marks.append(_mark(k, verdict, x, y, 0.8))
        marks.append(_mark(k, verdict, ARM + 16, row))
        marks.append(f'<text x="{ARM + 38:.0f}" y="{row + 5:.1f}">{html.escape(short)}</text>')
    title = html.escape(f"The arm of {robot} with its joints")
    return (
        f'<svg class="arm" viewBox="0 0 {WIDTH:.0f} {tall:.0f}" role="img" aria-label="{title}">'
        f'<polyline class="links" points="{way}"/>{"".join(marks)}</svg>'
    )


def legend() -> str:
    """What the shapes mean."""
    return (
        "Circle: nothing was found, or friction alone, which every joint has. Triangle: something else was found. "
        "Diamond: something is left without a name."
    )


def marked(verdict: str, mechanisms: Iterable[str], *, rest: bool) -> str:
    """Return the verdict by which a joint is marked: friction alone, which every joint has, is no mark.

    `rest`: whether something is left that no mechanism explains.

    >>> marked("named", ["viscous_friction"], rest=False), marked("named", ["backlash"], rest=True)
    ('nothing_missing', 'named')
    """
    if verdict != "named" or not all(map(is_in_every_axis, mechanisms)):
        return verdict
    return "unnamed" if rest else "nothing_missing"


def _mark(number: int, verdict: str, x: float, y: float, size: float = 1.0) -> str:
    shape = SHAPES.get(verdict, SHAPES["unnamed"])
    kind = verdict if verdict in SHAPES else "unnamed"
    return (
        f'<g class="joint {kind}" transform="translate({x:.1f} {y:.1f}) scale({size})">{shape}'
        f'<text class="number" y="{6 if kind == "named" else 4}">{number}</text></g>'
    )
