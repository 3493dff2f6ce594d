"""Similarity: a weighted distance over robustly scaled features, whose parts add up to it.

With center m, scale s and weights w of sum 1, the distance of a query q to a case x is

    d = sqrt(sum_j w_j (z(q)_j - z(x)_j)^2),    z(x)_j = clip((x_j - m_j) / s_j, -LIMIT, LIMIT)

so that 1 is what one spread in every feature would give. A feature that the query does not have is left out and the
weights are brought to sum 1 again. A feature that the case does not have contributes what is to be expected of it:
w_j (z(q)_j^2 + 1), the distance to the middle of the library plus its spread.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from casebase.errors import ArtifactError

LIMIT = 10.0
"""Scaled values are clipped here, so that one broken feature cannot outweigh all others."""
SMALLEST_SCALE = 1e-6
NORMAL_CONSISTENT = 1.4826
"""Median absolute deviation of a normal distribution times this is its standard deviation."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Metric:
    """What a distance is: center, scale and weight of every feature, shape (n,) each; the weights sum to 1."""

    names: tuple[str, ...]
    center: Floats
    scale: Floats
    weights: Floats

    def __post_init__(self) -> None:
        sizes = {len(self.names), self.center.size, self.scale.size, self.weights.size}
        if len(sizes) != 1:
            raise ArtifactError(f"a metric needs center, scale and weight for each of {len(self.names)} features")
        above_zero = self.weights.sum() > 0 or not self.names  # an empty library knows no features yet
        if not (np.all(self.scale > 0) and np.all(self.weights >= 0) and above_zero):
            raise ArtifactError("scales must be positive and weights not negative, some above zero")

    def scaled(self, values: NDArray[np.floating]) -> Floats:
        """Return scaled and clipped values, shape (..., n); NaN stays NaN."""
        return np.clip((np.asarray(values, np.float64) - self.center) / self.scale, -LIMIT, LIMIT)

    def with_weights(self, weights: Floats) -> "Metric":
        """Return the same scales with other weights."""
        return Metric(self.names, self.center, self.scale, weights / weights.sum())


def robust_scales(values: NDArray[np.floating]) -> tuple[Floats, Floats]:
    """Return median and normal-consistent median absolute deviation per column, NaN left out.

    A column that is constant or missing in more than half gets the standard deviation, and 1 if that is zero too.

    Args:
        values: shape (cases, n).

    Source: Rousseeuw and Croux, Alternatives to the Median Absolute Deviation, JASA 88 (1993).
    """
    values = np.asarray(values, dtype=np.float64)
    known = np.isfinite(values).any(axis=0)
    (center,) = column_quantiles(values, (0.5,))
    deviations = values - center
    scale = NORMAL_CONSISTENT * column_quantiles(np.abs(deviations), (0.5,))[0]
    smallest = SMALLEST_SCALE * np.maximum(1.0, np.abs(np.where(known, center, 0.0)))
    flat = known & ~(scale > smallest)
    if flat.any():
        scale[flat] = np.nanstd(values[:, flat], axis=0)
    return np.where(known, center, 0.0), np.where(known & (scale > smallest), scale, 1.0)


def column_quantiles(values: NDArray[np.floating], shares: tuple[float, ...]) -> Floats:
    """Return quantiles of every column by linear interpolation, NaN left out (and NaN of nothing), shape (shares, n).

    As `numpy.nanquantile`, which takes a hundred times as long on the small tables that are usual here.
    """
    if not len(values):
        return np.full((len(shares), values.shape[1]), np.nan)
    ordered = np.sort(values, axis=0)
    last = np.isfinite(values).sum(axis=0) - 1
    columns = np.arange(values.shape[1])
    quantiles = np.empty((len(shares), values.shape[1]))
    for index, share in enumerate(shares):
        place = np.maximum(share * last, 0.0)
        below = np.floor(place).astype(np.intp)
        low, high = ordered[below, columns], ordered[np.minimum(below + 1, np.maximum(last, 0)), columns]
        quantiles[index] = low + (place - below) * (high - low)
    return quantiles


def pooled_scales(values: NDArray[np.floating], labels: NDArray[np.str_]) -> tuple[Floats, Floats]:
    """Return the median over all and the spread within labels, which is what a difference is to be held against.

    Where no label has two cases it is the spread over all.

    Args:
        values: shape (cases, n).
        labels: shape (cases,).
    """
    center, overall = robust_scales(values)
    names, sizes = np.unique(labels, return_counts=True)
    repeated = [np.asarray(values[labels == name], np.float64) for name in names[sizes > 1]]
    if not repeated:
        return center, overall
    return center, robust_scales(np.concatenate([each - robust_scales(each)[0] for each in repeated]))[1]
