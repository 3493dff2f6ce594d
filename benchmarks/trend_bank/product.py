"""What the product makes of the life of a gearbox."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from benchmarks.field_bank.sounds import Floats
from benchmarks.trend_bank.lives import RECORDINGS, heard_from, life
from casebase.gearboxes import GearboxRecording as Kept
from casebase.reasoning.trend import FOLLOWED, RECORDINGS_PER_FALSE_ALARM, Trend
from signals.features import EXTRACTOR_VERSION, extract
from signals.recording import Recording

START = datetime(2026, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, eq=False)
class Lived:
    """A life as the product hears it.

    Args:
        features: those that are followed, shape (n, k).
        state: speed [rad/s] and payload [kg m2], shape (n, 2).
        size_rad: of the fault, shape (n,).
        ratio: strikes over everything else, peak over peak, shape (n,).
    """

    features: Floats
    state: Floats
    size_rad: Floats
    ratio: Floats

    @property
    def heard_from_rad(self) -> float:
        """Size from which the strikes are the loudest of the cycle [rad]."""
        return heard_from(self.size_rad, self.ratio)


def lived(label: str, seed: int, folder: Path, count: int = RECORDINGS) -> Lived:
    """Make the recordings of a life and extract their features, or read them where that was done before."""
    file = folder / f"{label}-{seed}-{count}-{EXTRACTOR_VERSION}-{len(FOLLOWED)}.npz"
    if not file.exists():
        columns, state, size, ratio = [], [], [], []
        for one in life(label, seed, count):
            sound = one.recording.sound
            found = extract(Recording(sound.samples.astype(np.float32), float(sound.rate))).features
            columns.append([found[name] for name in FOLLOWED])
            state.append((one.recording.speed_rad_s, one.recording.payload_kg_m2))
            size.append(one.recording.size_rad)
            ratio.append(one.ratio)
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(file, features=columns, state=state, size_rad=size, ratio=ratio)
    with np.load(file) as stored:
        return Lived(*(np.asarray(stored[name], np.float64) for name in ("features", "state", "size_rad", "ratio")))


def trends(one: Lived) -> list[Trend]:
    """Return the trend after each recording but the first."""
    kept = [kept_as(number, one.state[number]) for number in range(len(one.state))]
    return [Trend.of(kept[:count], one.features[:count]) for count in range(2, len(kept) + 1)]


def evidence(one: Lived) -> Floats:
    """Return the evidence for a change after each recording but the first, shape (n - 1,)."""
    return np.array([each.evidence for each in trends(one)])


def asked(one: Lived) -> tuple[int, int] | None:
    """Return the recording, from 0, after which it is first asked what changed at once, and from which on."""
    for number, each in enumerate(trends(one), 1):
        if each.at_once is not None:
            return number, int(each.at_once.recording_id)
    return None


def kept_as(number: int, state: Sequence[float] | Floats) -> Kept:
    """A recording as the library keeps it, one a day."""
    return Kept(str(number), START + timedelta(days=number), "", True, float(state[0]), float(state[1]))


def alarm(found: Floats) -> int | None:
    """Return the number of the recording, from 0, with which the limit is reached first."""
    beyond = np.flatnonzero(found >= RECORDINGS_PER_FALSE_ALARM)
    return int(beyond[0]) + 1 if beyond.size else None
