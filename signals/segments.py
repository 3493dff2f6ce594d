"""Segments: which part of a recording is the machine in motion, and what lies before, between and after.

People start the recorder before the robot, stop it after, and let the robot wait in between. The sound of an axis in
motion has a plateau; at a reversal it falls for some tenths of a second. Quiet that touches an edge of the recording is
no reversal, and quiet that lasts several times as long as the others is a pause. What is analysed is the longest piece
of motion between them; the rest is left out and said.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from signals.motion import HOP_HZ, SHORTEST_DIP_S, SMOOTH_HOPS, Span, quiet_runs


@dataclass(frozen=True)
class SegmentLimits:
    """How a recording is divided.

    Args:
        range_db: levels further below the loudest tenth are all the same silence [dB].
        plateau_db: the plateau is the median of what is at most so far below the loudest tenth [dB].
        least_fall_db, least_fall: quiet is what falls so far [dB], and so many times the scatter of the loudness
            [1], below the plateau; noise hardly ever does.
        shortest_edge_s: quiet of less at the start or the end is left as it is: it may be half of a reversal
            [s].
        silence_db: quiet at an edge that is so far below the usual standstill is the recorder's, however short
            [dB].
        pause_times: a standstill so many times as long as the usual one is a pause [1].
        shortest_pause_s: a standstill of less is no pause [s].
        margin_s: left out beside silence, for it may end with a click of the recorder [s].
        rounds: so often what is left is divided again [1].
    """

    range_db: float = 60.0
    plateau_db: float = 8.0
    least_fall_db: float = 2.0
    least_fall: float = 4.0
    shortest_edge_s: float = 0.15
    silence_db: float = 6.0
    pause_times: float = 4.0
    shortest_pause_s: float = 1.5
    margin_s: float = 0.05
    rounds: int = 3


LIMITS = SegmentLimits()


@dataclass(frozen=True)
class Segments:
    """How a recording is divided.

    Args:
        machine: the longest piece of motion; the whole recording where nothing is to be left out.
        silences: quiet at the start and the end.
        pauses: quiet in between that is too long for a reversal.
        others: pieces of motion that are not analysed, for a pause lies between.
    """

    machine: Span
    silences: tuple[Span, ...] = ()
    pauses: tuple[Span, ...] = ()
    others: tuple[Span, ...] = ()


@dataclass(frozen=True)
class _Quiet:
    """Quiet runs by hops, start inclusive and end exclusive; the smoothed level, and that of usual standstills [dB]."""

    runs: tuple[tuple[int, int], ...]
    level_db: NDArray[np.float64]
    floor_db: float

    @property
    def size(self) -> int:
        return self.level_db.size

    def is_silence(self, run: tuple[int, int]) -> bool:
        """Whether it is so much quieter than standstills that nothing was recorded."""
        level_db = float(np.median(self.level_db[run[0] : run[1]]))
        return run[1] - run[0] >= LIMITS.shortest_edge_s * HOP_HZ and level_db < self.floor_db - LIMITS.silence_db

    def at_edges(self) -> list[tuple[int, int]]:
        return [run for run in self.runs if run[0] == 0 or run[1] == self.size]

    def inside(self) -> list[tuple[int, int]]:
        return [run for run in self.runs if run[0] > 0 and run[1] < self.size]


def find_segments(level_db: NDArray[np.float32]) -> Segments:
    """Divide a recording by its loudness, `HOP_HZ` values per second, shape (n,) [dB]."""
    whole = (0, level_db.size)
    silences: list[tuple[int, int]] = []
    pauses: list[tuple[int, int]] = []
    others: list[tuple[int, int]] = []
    piece = whole
    for _ in range(LIMITS.rounds):
        left_out = _divided(level_db[piece[0] : piece[1]], piece[0])
        if left_out is None:
            break
        edges, between, pieces = left_out
        silences += edges
        pauses += between
        piece = max(pieces, key=lambda each: each[1] - each[0])
        others += [each for each in pieces if each != piece]
    margin = round(LIMITS.margin_s * HOP_HZ)
    start = piece[0] + (margin if piece[0] > 0 else 0)
    end = piece[1] - (margin if piece[1] < level_db.size else 0)
    if end - start < 2 * margin:
        start, end = whole
    return Segments(_span((start, end)), *(tuple(map(_span, sorted(each))) for each in (silences, pauses, others)))


def _span(run: tuple[int, int]) -> Span:
    return Span(run[0] / HOP_HZ, run[1] / HOP_HZ)


Runs = list[tuple[int, int]]


def _divided(level_db: NDArray[np.float32], offset: int) -> tuple[Runs, Runs, Runs] | None:
    """Return silences at the edges, pauses, and the pieces between; None if there is nothing to leave out."""
    quiet = _quiet(level_db)
    if quiet is None:
        return None
    lengths = np.array([end - start for start, end in quiet.inside()])
    usual = float(np.median(lengths)) if lengths.size > 1 else float("nan")
    shortest = LIMITS.shortest_edge_s * HOP_HZ if np.isnan(usual) else max(LIMITS.shortest_edge_s * HOP_HZ, 1.2 * usual)
    edges = [run for run in quiet.at_edges() if run[1] - run[0] >= shortest or quiet.is_silence(run)]
    least = LIMITS.shortest_pause_s * HOP_HZ
    least = least if np.isnan(usual) else max(least, LIMITS.pause_times * float(np.min(lengths)), 2 * usual)
    pauses = [run for run in quiet.inside() if run[1] - run[0] >= least]
    if not edges and not pauses:
        return None
    bounds = sorted(edges + pauses)
    starts = [0, *(end for _, end in bounds)]
    ends = [*(start for start, _ in bounds), level_db.size]
    pieces = [(a + offset, b + offset) for a, b in zip(starts, ends, strict=True) if b > a]
    if not pieces:
        return None
    return [(a + offset, b + offset) for a, b in edges], [(a + offset, b + offset) for a, b in pauses], pieces


def _quiet(level_db: NDArray[np.float32]) -> _Quiet | None:
    """Return where it is quiet: below the middle between the plateau and the usual floor of the quiet times."""
    if level_db.size <= 4 * SMOOTH_HOPS:
        return None
    loud = float(np.percentile(level_db, 90))
    smooth = ndimage.uniform_filter1d(np.maximum(level_db, loud - LIMITS.range_db).astype(np.float64), SMOOTH_HOPS)
    top = float(np.percentile(smooth, 90))
    plateau = float(np.median(smooth[smooth >= top - LIMITS.plateau_db]))
    steps = np.abs(np.diff(smooth[::SMOOTH_HOPS]))
    scatter = 1.4826 * float(np.median(steps)) / np.sqrt(2)
    runs = quiet_runs(smooth < plateau - max(LIMITS.least_fall_db, LIMITS.least_fall * scatter))
    inside = [run for run in runs if run[0] > 0 and run[1] < smooth.size and _long(run)]
    told = inside or [run for run in runs if _long(run)]
    if not told:
        return None
    floor = float(np.median([np.percentile(smooth[a:b], 20) for a, b in told]))
    return _Quiet(tuple(run for run in quiet_runs(smooth < (plateau + floor) / 2) if _long(run)), smooth, floor)


def _long(run: tuple[int, int]) -> bool:
    return run[1] - run[0] >= SHORTEST_DIP_S * HOP_HZ
