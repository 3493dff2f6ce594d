"""Calibration: how often the most voted label is right, given how clear the vote is and how well one could hear.

The probability of the leading label is logistic in its log-odds and in what the recording lacks,

    logit p = offset + slope * logit(share) - sum_i (harm_i + hiding_i [leading label is a baseline]) lack_i,

slope, harm and hiding not below 0: nothing that a recording lacks makes an answer surer. What hides a fault makes the
answer "normal" doubtful, what adds sounds makes a fault doubtful; so the two have coefficients of their own. Learned
from the library's recordings and disturbed copies of them, each judged by the cases of other gearboxes; drawn to a
prior as strongly as so many observations of it would.

Source: Platt, Probabilistic outputs for support vector machines (1999), with what a recording lacks beside the score.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from casebase.errors import ArtifactError
from casebase.similarity import Floats

LACKS = (
    "cycles",
    "left out",
    "noise",
    "unrepeated below 200 Hz",
    "unrepeated above 200 Hz",
    "gain",
    "colour",
)
"""What a recording may lack, in the order of the coefficients."""
CIRCUMSTANCES = (
    "cycles_left",
    "share_left_out",
    "standstill_fall_above_200_hz",
    "unrepeated_share_12_200_hz",
    "unrepeated_share_above_200_hz",
    "louder_after_start",
    "low_band_level",
    "noise_on_the_way_12_200_hz",
)
"""The features they are read from."""
ENOUGH_CYCLES, FEWEST_CYCLES = 3.0, 0.25
QUIET_FALL_DB = 15.0
SMALLEST_SPREAD_DB = 3.0
"""Levels of two microphones at one gear differ by so much [dB]."""
SMALLEST_GAIN_DB = 0.3
"""Levels of two strokes of one machine, averaged over some, differ by so much [dB]."""
UNLIKE_FROM, MOST_UNLIKE = 2.0, 8.0
"""The colour of a sound is unlike the library's from two standard deviations on, and ten say all [1]."""
CLEAREST = 4.0
"""Log-odds beyond this say no more."""
WEIGHT_OF_PRIOR = 0.02


@dataclass(frozen=True)
class Usual:
    """What the recordings of the library have; what they all lack was in their evaluation already.

    Args:
        cycles, fall_db: what nine of ten have, at most ENOUGH_CYCLES and QUIET_FALL_DB.
        low_db, low_spread_db: level of the low band against 250 to 500 Hz, and how it scatters.
        way_db, way_spread_db: level of the low band on the way against all that is above, and how it scatters.
        louder_db, louder_spread_db: how much louder a start is than what follows, and how it scatters.
    """

    cycles: float = ENOUGH_CYCLES
    fall_db: float = QUIET_FALL_DB
    low_db: float = -10.0
    low_spread_db: float = 10.0
    way_db: float = -15.0
    way_spread_db: float = 10.0
    louder_db: float = 0.0
    louder_spread_db: float = 0.5

    @classmethod
    def of(cls, names: Sequence[str], values: NDArray[np.floating]) -> "Usual":
        """Take it from features of the library, shape (cases, n)."""
        if any(name not in names for name in CIRCUMSTANCES) or not len(values):
            return cls()
        known = {name: values[:, names.index(name)].astype(np.float64) for name in CIRCUMSTANCES}
        return cls(
            float(np.clip(np.quantile(known["cycles_left"], 0.1), FEWEST_CYCLES, ENOUGH_CYCLES)),
            float(np.clip(np.quantile(known["standstill_fall_above_200_hz"], 0.1), 0.0, QUIET_FALL_DB)),
            *_spread(known["low_band_level"]),
            *_spread(known["noise_on_the_way_12_200_hz"]),
            *_spread(known["louder_after_start"], SMALLEST_GAIN_DB),
        )

    def unlike(self, low_band_db: Floats, way_db: Floats) -> Floats:
        """Return by how many standard deviations the colour of sounds is unlike the library's, shape (recordings,)."""
        low = np.abs(low_band_db - self.low_db) / self.low_spread_db
        return np.asarray(np.maximum(low, np.abs(way_db - self.way_db) / self.way_spread_db))


def _spread(levels: Floats, smallest_db: float = SMALLEST_SPREAD_DB) -> tuple[float, float]:
    """Return the median and the robust standard deviation, at least the smallest [dB]."""
    middle = float(np.median(levels))
    return middle, max(smallest_db, 1.4826 * float(np.median(np.abs(levels - middle))))


@dataclass(frozen=True)
class Calibration:
    """Coefficients; see the module.

    Args:
        harm, hiding: one per entry of LACKS.
        usual: what the library's recordings have.
        observations: how many answers this was learned from; 0 for the prior.
    """

    offset: float
    slope: float
    harm: tuple[float, ...]
    hiding: tuple[float, ...]
    usual: Usual
    observations: int = 0

    def lacks(self, names: Sequence[str], values: NDArray[np.floating]) -> Floats:
        """Return what recordings lack, shape (recordings, len(LACKS)), from features of shape (recordings, n)."""
        return lacks(names, values, self.usual)

    def unlike(self, names: Sequence[str], values: NDArray[np.floating]) -> Floats:
        """Return how unlike the library's the colour of recordings is, shape (recordings,); see `Usual.unlike`."""
        if any(name not in names for name in CIRCUMSTANCES):
            return np.zeros(len(values))
        low, way = (np.asarray(values[:, names.index(name)], np.float64) for name in CIRCUMSTANCES[-2:])
        return self.usual.unlike(low, way)

    def probability(self, share: Floats, lacking: Floats, baseline: NDArray[np.bool_]) -> Floats:
        """Return how probable the leading label is, shape (recordings,).

        Args:
            share: its share of the votes.
            lacking: see `lacks`.
            baseline: whether the leading label is that of a gear without a fault.
        """
        clear = np.clip(special.logit(np.clip(share, 1e-9, 1 - 1e-9)), -CLEAREST, CLEAREST)
        harm = lacking @ np.array(self.harm) + baseline * (lacking @ np.array(self.hiding))
        return np.asarray(special.expit(self.offset + self.slope * clear - harm))

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {
            "offset": self.offset,
            "slope": self.slope,
            "harm": list(self.harm),
            "hiding": list(self.hiding),
            "usual": asdict(self.usual),
            "observations": self.observations,
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Calibration":
        """Read it back; raises ArtifactError if it is for other circumstances."""
        if len(document["harm"]) != len(LACKS) or len(document["hiding"]) != len(LACKS):
            raise ArtifactError("the calibration is for other circumstances; learn it again")
        return cls(
            document["offset"],
            document["slope"],
            tuple(document["harm"]),
            tuple(document["hiding"]),
            Usual(**document["usual"]),
            document["observations"],
        )


PRIOR = Calibration(0.0, 1.0, (1.0,) * len(LACKS), (1.0,) * len(LACKS), Usual())
"""Before anything is learned: a lack of the usual strength takes 2.7 from the odds, of a normal gear twice that."""


def lacks(names: Sequence[str], values: NDArray[np.floating], usual: Usual) -> Floats:
    """Return what recordings lack, 0 for nothing and about 1 for what is usual in the field."""
    if any(name not in names for name in CIRCUMSTANCES):
        return np.zeros((len(values), len(LACKS)))
    cycles, left_out, fall_db, low, high, louder_db, low_band_db, way_db = (
        np.nan_to_num(np.asarray(values[:, names.index(name)], np.float64)) for name in CIRCUMSTANCES
    )
    unlike = usual.unlike(low_band_db, way_db)
    return np.stack(
        [
            np.clip(np.log2(usual.cycles / np.maximum(cycles, FEWEST_CYCLES)), 0, None),
            left_out / 0.2,
            np.clip(usual.fall_db - fall_db, 0, None) / 10,
            low / 0.2,
            high / 0.2,
            np.clip(np.abs(louder_db - usual.louder_db) / usual.louder_spread_db - UNLIKE_FROM, 0, MOST_UNLIKE) / 2,
            np.clip(unlike - UNLIKE_FROM, 0, MOST_UNLIKE) / 2,
        ],
        axis=1,
    )


def fitted(
    share: Floats,
    lacking: Floats,
    baseline: NDArray[np.bool_],
    right: NDArray[np.bool_],
    weights: Floats,
    usual: Usual,
) -> Calibration:
    """Learn from answers that were given to held-out recordings and their copies.

    Args:
        share, lacking, baseline: as in `Calibration.probability`.
        right: whether the leading label was the true one.
        weights: how much each answer counts, sum 1.
    """
    from scipy.optimize import minimize  # slow to import

    clear = np.clip(special.logit(np.clip(share, 1e-9, 1 - 1e-9)), -CLEAREST, CLEAREST)
    columns = np.column_stack([np.ones_like(clear), clear, -lacking, -lacking * baseline[:, None]])
    prior = np.array([PRIOR.offset, PRIOR.slope, *PRIOR.harm, *PRIOR.hiding])

    def loss(parameters: Floats) -> tuple[float, Floats]:
        score = columns @ parameters
        pull = special.expit(score) - right
        away = parameters - prior
        value = float(weights @ (np.logaddexp(0, score) - right * score)) + WEIGHT_OF_PRIOR / 2 * float(away @ away)
        return value, columns.T @ (weights * pull) + WEIGHT_OF_PRIOR * away

    bounds = [(None, None)] + [(0.0, None)] * (prior.size - 1)
    found = minimize(loss, prior, jac=True, method="L-BFGS-B", bounds=bounds).x.tolist()
    count = len(LACKS)
    harm, hiding = tuple(found[2 : 2 + count]), tuple(found[2 + count :])
    return Calibration(found[0], found[1], harm, hiding, usual, right.size)
