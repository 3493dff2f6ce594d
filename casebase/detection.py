"""Detection: which of the known faults would not have been heard in a recording as noisy as this one.

"No fault" has to be earned. The bump of a fault stands above the noise of its own recording by so much; in a recording
with d dB more noise against the sound of the machine the same bump stands out by

    10 lg(1 + (10^(h/10) - 1) / 10^(d/10)) dB.

The cases of a class whose bump would no longer stand out are what this recording cannot tell from a sound gear. Noise
counts as more where nine of ten recordings of the library have less: with less, the library itself was told apart.

Source: Kay, Fundamentals of Statistical Signal Processing, volume II, Detection Theory (1998), probability of a miss.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from casebase.case_table import CaseTable, Mask
from casebase.novelty import BASELINES
from casebase.similarity import Floats

NOISE = "noise_on_the_way_12_200_hz"
BUMPS = ("notch_bump_12_200_hz", "play_bump_12_200_hz")
WORTH_SAYING_DB = 3.0
"""A lower bump is what noise makes [dB]."""


def left_db(height_db: Floats, noise_db: Floats, here_db: float) -> Floats:
    """Return by how much bumps would still stand out in another recording, shape (cases,) [dB].

    Args:
        height_db: by how much they stand out, shape (cases,) [dB].
        noise_db: noise that each was heard in, shape (cases,) [dB].
        here_db: noise of the other recording; less than where they were heard does not raise them [dB].
    """
    more = 10 ** (np.maximum(here_db - noise_db, 0.0) / 10)
    return np.asarray(10 * np.log10(1 + np.maximum(10 ** (height_db / 10) - 1, 0.0) / more))


@dataclass(frozen=True, eq=False)
class Detection:
    """What every case of a fault would stand out by.

    Args:
        classes: all labels, in the order of the answer.
        noise: column of the noise among the features; None if these features do not speak of it.
        usual: noise that nine of ten recordings stay below [dB].
        heights: per class, heights of the bump that tells it, shape (cases,) [dB]; empty where no bump does.
        noises: noise that each was heard in, shape (cases,) [dB].
        groups: the gearbox of each.
    """

    classes: tuple[str, ...]
    noise: int | None
    usual: float
    heights: tuple[Floats, ...]
    noises: tuple[Floats, ...]
    groups: tuple[NDArray[np.str_], ...]

    @classmethod
    def of(cls, table: CaseTable, voters: Mask) -> "Detection":
        """Take the cases that vote."""
        names = table.names
        if NOISE not in names or any(bump not in names for bump in BUMPS):
            empty = tuple(np.empty(0) for _ in table.classes)
            return cls(table.classes, None, 0.0, empty, empty, tuple(np.empty(0, np.str_) for _ in table.classes))
        noise = names.index(NOISE)
        heights, noises, groups = [], [], []
        for label in table.classes:
            rows = np.flatnonzero(voters & (table.labels == label)) if label not in BASELINES else np.empty(0, np.intp)
            bumps = np.array([table.values[rows, names.index(bump)] for bump in BUMPS], np.float64)
            told = [bool(each.size and np.nanmedian(each) > WORTH_SAYING_DB) for each in np.nan_to_num(bumps)]
            height = np.max(bumps[told], axis=0) if any(told) else np.empty(0)
            known = np.isfinite(height)
            heights.append(height[known])
            noises.append(table.values[rows, noise].astype(np.float64)[: height.size][known])
            groups.append(table.groups[rows][: height.size][known])
        usual = float(np.quantile(table.values[voters, noise], 0.9)) if voters.any() else 0.0
        return cls(table.classes, noise, usual, tuple(heights), tuple(noises), tuple(groups))

    def missed(self, values: NDArray[np.floating], but: str = "") -> Floats:
        """Return the share of each class's cases that would not have been heard, shape (classes,).

        Args:
            values: features of the recording, shape (n,).
            but: a gearbox whose cases do not count, for it is held out.
        """
        found = np.zeros(len(self.classes))
        if self.noise is None or not np.isfinite(values[self.noise]):
            return found
        for index, (height, noise, group) in enumerate(zip(self.heights, self.noises, self.groups, strict=True)):
            counts = group != but
            if not counts.any():
                continue
            left = left_db(height[counts], np.maximum(noise[counts], self.usual), float(values[self.noise]))
            heard = height[counts] > WORTH_SAYING_DB
            found[index] = float(np.mean(left[heard] < WORTH_SAYING_DB)) if heard.any() else 0.0
        return found

    def earned(self, shares: Floats, missed: Floats) -> Floats:
        """Return shares of the votes with what was missed given to the faults that may hide, shape (classes,).

        A fault that is missed with probability m leaves the same recording as a sound gear: of the share of the
        baseline, m / (1 + sum of m) is its own (Bayes, faults and sound gears equally frequent).
        """
        sound = np.array([label in BASELINES for label in self.classes])
        baseline = float(shares[sound].sum())
        total = 1 + float(missed.sum())
        return np.asarray(np.where(sound, shares / total, shares + baseline * missed / total))
