"""Is it the sound of a moving axis at all? Where all cases move, a recording that does not is none of them.

The sound of a gear grows with speed and dips at every reversal. What tells faults apart is measured against those
reversals, so a sound that has none, such as a hiss, would be held against the cases by what is left: the colour of
the sound, in which nothing is missing from normal. Its features would then say that nothing stands out, and be right.
"""

import numpy as np
from numpy.typing import NDArray

from casebase.signals.motion import SMALLEST_DEPTH_EVEN

FALL, FOLDED, CYCLES = "loudness_fall_over_scatter", "notch_bump_12_200_hz", "cycles_left"
NEARLY_ALL = 0.95


def moving(names: tuple[str, ...], values: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which recordings follow a motion: reversals with a period, given or heard, where the loudness falls.

    Args:
        values: features, shape (recordings, n).

    Returns:
        Shape (recordings,); false for all if these features do not speak of motion.
    """
    if not {FALL, FOLDED, CYCLES} <= set(names):
        return np.zeros(len(values), dtype=np.bool_)
    fall, folded, cycles = (values[:, names.index(name)] for name in (FALL, FOLDED, CYCLES))
    return np.asarray(np.isfinite(folded) & (fall >= SMALLEST_DEPTH_EVEN) & (cycles > 0))


def all_move(names: tuple[str, ...], values: NDArray[np.floating]) -> bool:
    """Return whether nearly all cases follow a motion, so that a recording that does not is none of their kind."""
    return bool(len(values) and moving(names, values).mean() >= NEARLY_ALL)
