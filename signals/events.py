"""Events: what happened when, for the eye and for the explanation."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from signals.analysis import Analysis
from signals.band import Band
from signals.half_cycles import HalfCycles

STRONGEST = 200
"""Most impulses that are listed; the strongest."""


class EventKind(StrEnum):
    """What an event in the sound is."""

    IMPULSE = "impulse"
    REVERSAL = "reversal"
    NOTCH = "notch"
    PLAY = "play"


@dataclass(frozen=True)
class Event:
    """Something that happens at one time.

    Args:
        time_s: from the start of the recording [s].
        kind: what it is; notch and play mark where a bump stands out that is typical of them.
        strength_db: height above what noise would reach [dB]; 0 for a reversal.
    """

    time_s: float
    kind: EventKind
    strength_db: float = 0.0


def find_events(analysis: Analysis) -> tuple[Event, ...]:
    """Return reversals, impulses of the lowest band, and the bumps that repeat, in order of time."""
    events = [Event(time, EventKind.REVERSAL) for time in analysis.motion.reversal_times_s]
    times, heights = analysis.impulses(Band.LOW)
    strongest = np.argsort(-heights, kind="stable")[:STRONGEST]
    events += [Event(float(times[i]), EventKind.IMPULSE, float(heights[i])) for i in strongest]
    folded = analysis.folded(Band.LOW)
    if folded is not None:
        events += _repeated(analysis, folded, EventKind.PLAY, folded.both_db, folded.in_zone & ~folded.in_quiet)
        events += _repeated(analysis, folded, EventKind.NOTCH, folded.asymmetry_db, ~folded.in_quiet)
    return tuple(sorted(events, key=lambda event: (event.time_s, event.kind)))


def _repeated(
    analysis: Analysis, folded: HalfCycles, kind: EventKind, height_db: NDArray[np.float64], where: NDArray[np.bool_]
) -> list[Event]:
    """Return one event per stroke at the highest bump, if noise would not reach it."""
    heights = np.where(where & np.isfinite(height_db), height_db, -np.inf)
    place = int(np.argmax(heights))
    if not heights[place] > 0:
        return []
    directions = [
        index
        for index, side in enumerate((folded.forward_db, folded.backward_db))
        if kind is EventKind.PLAY or side[place] >= np.fmax(folded.forward_db, folded.backward_db)[place]
    ]
    return [
        Event(float(time), kind, float(heights[place]))
        for index, time in enumerate(folded.centres_s + folded.offset_s[place])
        if (index + folded.first_direction) % 2 in directions and 0 <= time < analysis.duration_s
    ]
