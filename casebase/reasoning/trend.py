"""Has a gearbox changed? Sequential detection of a change in the features of its own recordings.

One feature over the recordings of a gearbox is a linear function of the state of operation (the regressors) and
Gaussian noise of unknown size. A change is a step upwards from one recording on. For every recording that it could
have begun with, the Bayes factor of that step against no change has a closed form. Their sum is the Shiryaev-Roberts
statistic. Without a change its mean is at most the number of recordings, so by optional stopping the mean number of
recordings until a false alarm is at least the limit that it is held against: the limit is not tuned, it is the number
of recordings that is promised. The mean of the statistics of several features has the same property, however they
depend on each other.

A fault strikes, and grows. A gearbox that was exchanged, or a microphone that was moved, changes the colour of the
sound at once: some bands rise, others fall. So the bands of the spectrum have a statistic of their own, of steps in
either direction, held against ramps. Sound does not tell the two apart: mesh orders stay, and what is new is how
loud each resonance is heard, which place and gearbox both change by as much. Who was there knows.

Sources: Shiryaev, On optimum methods in quickest detection problems, Theory Probab. Appl. 8 (1963); Pollak, Average run
lengths of an optimal method of detecting a change in distribution, Ann. Statist. 15 (1987); Liang et al., Mixtures of g
priors for Bayesian variable selection, JASA 103 (2008), the Bayes factor with nuisance coefficients; Hendriksen,
de Heide and Gruenwald, Optional stopping with Bayes factors, Bayesian Analysis 16 (2021), why it holds for unknown
coefficients and noise; Hampel et al., Robust Statistics (1986), the clipping.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.gearboxes import GearboxRecording, History, Place, of_places
from casebase.recordings import feature_values
from casebase.store.models import Extractor, FeatureRow, StoredRecording
from signals.band import Band
from signals.features import EXTRACTOR_VERSION
from signals.features.levels import LogBandEnergies

Floats = NDArray[np.float64]

IMPACTS = tuple(f"{kind}_{band.label}" for kind in ("notch_bump", "play_bump", "strongest_impulse") for band in Band)
CREST_FACTOR = "crest_factor_low_pass_200_hz_median_of_cycles"
DECIDING = (*IMPACTS, CREST_FACTOR)
"""A fault strikes: impacts that repeat with the motion, impacts anywhere, and the peak over the effective value."""
LEVELS = ("rms", "peak")
"""They follow gain and place of the microphone, too: they are shown, and decide nothing."""
COLOUR = tuple(each.name for each in LogBandEnergies.definitions)
"""The shares of half-octaves in the sound: a change at once of what is heard, or from where."""
FOLLOWED = (*DECIDING, *LEVELS, *COLOUR)
FEWEST = 2

RECORDINGS_PER_FALSE_ALARM = 1000
"""A good gearbox gives one false alarm in so many recordings, or fewer."""
CLIPPED = 3.0
"""Values farther from the median than so many standard deviations count as so far: one odd recording is no change."""
DEVIATION_OVER_MEDIAN = 1.4826
"""Standard deviation over median absolute deviation of a Gaussian distribution."""
SAME = 1e-9
LARGEST_LOGARITHM = 600.0


class Kind(Enum):
    """How a feature changes from some recording on: up at once, at once in either direction, or evenly."""

    RISE = "rise"
    STEP = "step"
    RAMP = "ramp"


@dataclass(frozen=True, eq=False)
class Change:
    """Evidence for a change of one feature.

    Args:
        evidence: Shiryaev-Roberts statistic; without a change its mean is at most the number of recordings.
        began: how probable it is that the change began with each recording, given that there was one; shape (n,).
    """

    evidence: float
    began: Floats


def changes_of(values: NDArray[np.floating], regressors: NDArray[np.floating], kind: Kind = Kind.RISE) -> list[Change]:
    """Weigh for each feature whether it has changed at some recording and stayed so.

    Args:
        values: of k features, in the order in which they were recorded, shape (n, k), finite.
        regressors: state of operation of each recording, shape (n, p); a constant is added.
    """
    count = len(values)
    nothing = np.ones(values.shape)
    if count > FEWEST:
        shown = clipped(np.asarray(values, np.float64))
        basis = column_space(regressors, count)
        residual = shown - basis @ (basis.T @ shown)
        squares = (residual**2).sum(axis=0)
        freedom = count - basis.shape[1]
        told = squares > SAME * np.maximum((shown**2).sum(axis=0), 1e-300)
        if freedom >= FEWEST and told.any():
            nothing[:, told] = bayes_factors(residual[:, told], basis, squares[told], freedom, kind)
    totals = nothing.sum(axis=0)
    return [Change(float(total), column / max(total, 1.0)) for total, column in zip(totals, nothing.T, strict=True)]


def bayes_factors(residual: Floats, basis: Floats, squares: Floats, freedom: int, kind: Kind) -> Floats:
    """Return the Bayes factor of a change from each recording on against none, shape (n, k).

    The change over the noise, at the last recording, has a normal prior of one standard deviation, half of it for a
    rise: no smaller one matters to anybody.

    Args:
        residual: of the regression on the state of operation, shape (n, k).
        basis: orthonormal columns of that regression, shape (n, p).
        squares: sums of the squared residuals, shape (k,).
        freedom: n - p.
    """
    from scipy.special import stdtr  # slow to import

    since = np.arange(len(residual), 0.0, -1.0)[:, None]  # recordings from each one on
    along, within, length = _from_here_on(residual), _from_here_on(basis), since
    if kind is Kind.RAMP:  # from 0 before each recording to 1 at the last one
        along, within = _from_here_on(along) / since, _from_here_on(within) / since
        length = (since + 1.0) * (2.0 * since + 1.0) / (6.0 * since)
    free = np.maximum(length - (within**2).sum(axis=1, keepdims=True), 0.0)
    left = np.maximum(squares - along**2 / (free + 1), SAME * squares)
    both_ways = -0.5 * np.log1p(free) - 0.5 * freedom * np.log(left / squares)
    factors = np.exp(np.minimum(both_ways, LARGEST_LOGARITHM))
    if kind is not Kind.RISE:
        return np.asarray(factors)
    return np.asarray(factors * 2 * stdtr(freedom, along / np.sqrt((free + 1) * left / freedom)))


def _from_here_on(values: Floats) -> Floats:
    """Return the sums over each recording and all later ones, shape (n, k)."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def clipped(values: Floats) -> Floats:
    """Return values with those that are far from the median of their column brought nearer, shape (n,) or (n, k)."""
    middle = np.median(values, axis=0)
    reach = CLIPPED * DEVIATION_OVER_MEDIAN * np.median(np.abs(values - middle), axis=0)
    return np.asarray(np.clip(values, middle - reach, middle + reach))


def column_space(regressors: NDArray[np.floating], count: int) -> Floats:
    """Return orthonormal columns that span a constant and the regressors, shape (n, rank)."""
    constant = np.full((count, 1), 1.0)
    centred = np.asarray(regressors, np.float64).reshape(count, -1)
    centred = centred - centred.mean(axis=0, keepdims=True)
    scale = np.sqrt((centred**2).sum(axis=0))
    kept = centred[:, scale > SAME] / scale[scale > SAME]
    left, singular, _ = np.linalg.svd(np.hstack([constant / np.sqrt(count), kept]), full_matrices=False)
    return np.asarray(left[:, singular > SAME * singular[0]])


@dataclass(frozen=True, eq=False)
class Expected:
    """What a feature is expected to be.

    Args:
        adjusted: the values as they would be in the typical state of operation, shape (n,).
        low, high: between which all but one in `RECORDINGS_PER_FALSE_ALARM` good recordings lie; NaN where too few.
    """

    adjusted: Floats
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Followed:
    """One feature over the recordings of a gearbox.

    Args:
        name: of the feature.
        rows: recordings that have it, shape (n,).
        values: as recorded, shape (n,).
        state: of operation, shape (n, p).
        change: evidence that it has risen; of a band of the spectrum that it has stepped up or down.
        drift: evidence that it changes evenly instead, of a band of the spectrum.
    """

    name: str
    rows: NDArray[np.intp]
    values: Floats
    state: Floats
    change: Change
    drift: float = 0.0

    def expected(self) -> Expected:
        """Return the prediction interval of one more good recording, from those before a change.

        Source: Hahn and Meeker, Statistical Intervals (1991), 4.4.
        """
        from scipy.special import stdtrit  # slow to import

        count = len(self.rows)
        if self.change.evidence >= RECORDINGS_PER_FALSE_ALARM:
            count = max(int(np.argmax(self.change.began)), FEWEST)
        good = self.state[:count]
        if count < FEWEST:
            return Expected(self.values, math.nan, math.nan)
        centred = self.state - good.mean(axis=0)
        columns = np.hstack([np.ones((count, 1)), centred[:count]])
        slopes = np.linalg.lstsq(columns, clipped(self.values[:count]), rcond=SAME)[0][1:]
        adjusted = np.asarray(self.values - centred @ slopes)
        freedom = count - column_space(good, count).shape[1]
        if freedom < FEWEST:
            return Expected(adjusted, math.nan, math.nan)
        kept = clipped(adjusted[:count])
        scatter = math.sqrt(float(((kept - kept.mean()) ** 2).sum()) / freedom * (1 + 1 / count))
        reach = float(stdtrit(freedom, 1 - 0.5 / RECORDINGS_PER_FALSE_ALARM)) * scatter
        return Expected(adjusted, float(kept.mean()) - reach, float(kept.mean()) + reach)


@dataclass(frozen=True, eq=False)
class Trend:
    """What the recordings of a gearbox say of a change, oldest first."""

    recordings: tuple[GearboxRecording, ...]
    followed: tuple[Followed, ...]

    @classmethod
    def of(cls, recordings: Sequence[GearboxRecording], columns: Floats) -> "Trend":
        """Follow the features of `FOLLOWED`, shape (n, k), NaN where missing, over two recordings or more."""
        return cls(tuple(recordings), tuple(_followed(columns, state_of_operation(recordings))))

    @cached_property
    def evidence(self) -> float:
        """Shiryaev-Roberts statistic, mean over the features that decide."""
        return float(np.mean([one.change.evidence for one in self.deciding]))

    @cached_property
    def deciding(self) -> tuple[Followed, ...]:
        """The features whose rise is a sign of a fault, and that at least half of the recordings have."""
        known = [one for one in self.followed if one.name in DECIDING]
        return tuple(one for one in known if 2 * len(one.rows) >= len(self.recordings)) or tuple(known)

    @property
    def changed(self) -> bool:
        """Whether the evidence is beyond the limit."""
        return self.evidence >= RECORDINGS_PER_FALSE_ALARM

    @cached_property
    def colour(self) -> tuple[Followed, ...]:
        """The bands of the spectrum that every recording has."""
        return tuple(one for one in self.followed if one.name in COLOUR and len(one.rows) == len(self.recordings))

    @cached_property
    def colour_evidence(self) -> float:
        """Shiryaev-Roberts statistic of a step in the colour of the sound, mean over its bands."""
        return float(np.mean([one.change.evidence for one in self.colour])) if self.colour else 0.0

    @cached_property
    def at_once(self) -> GearboxRecording | None:
        """The recording from which on another gearbox, or another place, is heard most probably; None where neither is.

        The colour of the sound has stepped, more clearly than it drifts, and more clearly than impacts have risen.
        """
        evidence = self.colour_evidence
        if evidence < max(RECORDINGS_PER_FALSE_ALARM, self.evidence):
            return None
        if evidence < float(np.mean([one.drift for one in self.colour])):
            return None
        clearest = max(self.colour, key=lambda one: one.change.evidence)
        return self.recordings[int(clearest.rows[np.argmax(clearest.change.began)])]

    @property
    def leading(self) -> Followed:
        """The feature with the strongest evidence."""
        return max(self.deciding, key=lambda one: one.change.evidence)

    @property
    def began(self) -> GearboxRecording:
        """The recording with which a change began most probably."""
        leading = self.leading
        return self.recordings[int(leading.rows[np.argmax(leading.change.began)])]


def trend_of(session: Session, history: History) -> Trend | None:
    """Return the trend since the gearbox was put in or repaired, or the microphone moved.

    None with fewer than two recordings to compare, and without the name of the gearbox: they may be of several.
    """
    return trends_of(session, [history])[0]


def trends_of(session: Session, several: Sequence[History]) -> list[Trend | None]:
    """Return the trend of each; see `trend_of`."""
    vectors = _features(session, [(each.axis, each.gearbox) for each in several])
    return [_trend(each, vectors) for each in several]


def _trend(history: History, vectors: Mapping[str, Floats]) -> Trend | None:
    recordings = tuple(one for one in history.comparable if one.usable and one.timed and one.recording_id in vectors)
    if len(recordings) < FEWEST or history.gearbox is None:
        return None
    return Trend.of(recordings, np.array([vectors[one.recording_id] for one in recordings]))


def state_of_operation(recordings: Sequence[GearboxRecording]) -> Floats:
    """Return the logarithms of speed and payload, shape (n, p); what some do not tell has a column of its own."""
    columns: list[list[float]] = []
    for told in ([one.speed_rad_s for one in recordings], [one.payload_kg_m2 for one in recordings]):
        columns.append([math.log(value) if value else 0.0 for value in told])
        columns.append([0.0 if value else 1.0 for value in told])
    return np.array(columns, dtype=np.float64).T


def _followed(columns: Floats, state: Floats) -> list[Followed]:
    """Follow features, shape (n, k); those that the same recordings have are weighed together."""
    finite, coloured = np.isfinite(columns), np.isin(FOLLOWED, COLOUR)
    found: dict[int, Followed] = {}
    for pattern in np.unique(finite, axis=1).T:
        rows, alike = np.flatnonzero(pattern), (finite == pattern[:, None]).all(axis=0)
        here = state[rows]
        places = np.flatnonzero(alike & ~coloured)
        values = columns[np.ix_(rows, places)]
        for place, own, risen in zip(places.tolist(), values.T, changes_of(values, here), strict=True):
            found[place] = Followed(FOLLOWED[place], rows, own, here, risen)
        places = np.flatnonzero(alike & coloured)
        values = columns[np.ix_(rows, places)]
        steps, ramps = changes_of(values, here, Kind.STEP), changes_of(values, here, Kind.RAMP)
        for place, own, step, ramp in zip(places.tolist(), values.T, steps, ramps, strict=True):
            found[place] = Followed(FOLLOWED[place], rows, own, here, step, ramp.evidence)
    return [found[place] for place in range(len(FOLLOWED))]


def _features(session: Session, places: Sequence[Place]) -> dict[str, Floats]:
    """Return the followed features of every recording of some gearboxes by its id, shape (k,), NaN where missing."""
    extractor = session.get(Extractor, EXTRACTOR_VERSION)
    rows = session.execute(
        select(FeatureRow.recording_id, FeatureRow.finite, FeatureRow.missing)
        .join(StoredRecording, StoredRecording.id == FeatureRow.recording_id)
        .where(of_places(places), FeatureRow.extractor_version == EXTRACTOR_VERSION)
    ).all()
    if extractor is None or not rows:
        return {}
    names = [str(name) for name in extractor.names]
    values = feature_values([row.finite for row in rows], [row.missing for row in rows])
    followed = values[:, [names.index(name) for name in FOLLOWED]].astype(np.float64)
    return dict(zip([row.recording_id for row in rows], followed, strict=True))
