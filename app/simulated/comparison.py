"""What the simulated sound of an axis gets wrong: how far, in which features, from which cause, and what mending gains.

Measured recordings of a label are held against those that `generate` would simulate. A cause is not read off a table:
one part of the sound model at a time is replaced by what half of the gearboxes says (their motion, the microphone
fitted to their normal recordings, the factor that brings the simulated nearest to them), the same draws are simulated
again, and the distance to the other half is taken before and after. What helps in both halves, by more than twice its
error, is a cause.

Distance: energy distance of standardised features (Szekely and Rizzo 2004), no recording paired with itself, so that it
is about 0 where nothing differs; p-value by permuting whole gearboxes, for recordings of one are alike, after Holm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from app.recordings.intake import mesh_orders, shaft_orders
from app.simulated.generation import in_parallel, simulate_case
from signals.condition import OperatingCondition
from signals.features import FEATURES, catalogue, extract
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone
from sim.acoustics.transfer_path_fit import NormalRecording, fit_sound
from sim.description.axis import Axis, Motion
from sim.errors import ParameterError, near_match
from sim.experiment.design_of_experiments import Planned, moved, path_rms, plan, scaled
from sim.mechanisms import MECHANISMS

Floats = NDArray[np.float64]
NormalRecordings = Mapping[str, Sequence[NormalRecording]]
Change = Callable[[Planned, np.random.Generator], Planned]
FACTORS = (0.25, 0.5, 2.0, 4.0)
"""Steps of a factor that nobody can read off a recording: halves and doubles."""

PERMUTATIONS = 999
LONGEST_S = 20.0
SHOWN_FEATURES = 3


@dataclass(frozen=True)
class FeatureGap:
    """A feature: means, and the difference in standard deviations of measured and simulated together."""

    feature: str
    measured: float
    simulated: float
    difference: float


@dataclass(frozen=True)
class Gain:
    """Share of a distance that goes, judged on either half of the gearboxes, and the standard error of the mean."""

    halves: tuple[float, float]
    error: float

    @property
    def mean(self) -> float:
        """Of both halves."""
        return sum(self.halves) / 2

    @property
    def helps(self) -> bool:
        """Whether it is above 0 in both halves, and by more than two standard errors."""
        return min(self.halves) > 0 and self.mean > 2 * self.error


@dataclass(frozen=True)
class FamilyGap:
    """A family of features: its energy distance per root of its number of features, p-value, and who lies farthest.

    `cause` is what brings the family nearest, among what brings it nearer in both halves; `gain` the share of its
    distance that then goes, on gearboxes that were not looked at. None where nothing does, or nothing is apart.
    """

    family: str
    features: int
    distance: float
    p_value: float
    farthest: tuple[FeatureGap, ...]
    cause: str | None
    gain: float | None


@dataclass(frozen=True)
class Extension:
    """A part of the sound model replaced: which share of the whole distance goes.

    `taken` says what was taken from the half that was looked at.
    """

    cause: str
    gain: Gain
    taken: tuple[str, str]


@dataclass(frozen=True)
class Comparison:
    """Measured against simulated recordings of one label of an axis.

    `together` is the gain of all causes that help, be it one family, at once; `not_tried` need what is missing.
    """

    axis: str
    label: str
    measured: int
    gearboxes: int
    simulated: int
    distance: float
    p_value: float
    families: tuple[FamilyGap, ...]
    extensions: tuple[Extension, ...]
    together: Gain | None
    not_tried: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Half:
    """Half of the gearboxes: recordings of the label, and those of normal ones that microphones are fitted to."""

    axis: Axis
    recordings: tuple[NormalRecording, ...]
    normal: NormalRecordings

    @cached_property
    def microphones(self) -> tuple[Microphone, ...]:
        """One fitted to each gearbox that has a normal recording."""
        return tuple(fit_sound(self.axis, heard).microphone for heard in self.normal.values())

    def motion(self, planned: Planned, random: np.random.Generator) -> Planned:
        """Moved and loaded as in one of the recordings."""
        heard = self.recordings[int(random.integers(len(self.recordings)))]
        drawn = planned.scenario.axis.motion
        ramp, dwell = min(drawn.acceleration_time_s, 0.2 * heard.period_s), min(drawn.dwell_s, 0.05 * heard.period_s)
        return moved(planned, Motion(heard.period_s, heard.speed_rad_s, ramp, dwell), heard.payload_kg_m2)

    def microphone_band(self, planned: Planned, random: np.random.Generator) -> Planned:
        """As heard through one of the housings; rubbing and room noise keep their shares."""
        own = planned.scenario.microphone
        path = replace(own, modes=self._fitted(random).modes)
        share = _ambient_share(own)
        return _with(planned, scaled(path, ambient_share=share, ambient_slope=own.ambient_slope, level=_level(own)))

    def rubbing(self, planned: Planned, random: np.random.Generator) -> Planned:
        """With the rubbing of one of the gearboxes."""
        return _with(planned, replace(planned.scenario.microphone, rubbing_n_m=self._fitted(random).rubbing_n_m))

    def room_noise(self, planned: Planned, random: np.random.Generator) -> Planned:
        """With the noise that is heard at standstill beside one of the gearboxes."""
        own, fitted = planned.scenario.microphone, self._fitted(random)
        noise = _ambient_share(fitted) * own.rubbing_n_m * path_rms(own)
        return _with(planned, replace(own, ambient_n_m=noise, ambient_slope=fitted.ambient_slope))

    def _fitted(self, random: np.random.Generator) -> Microphone:
        return self.microphones[int(random.integers(len(self.microphones)))]


def _with(planned: Planned, microphone: Microphone) -> Planned:
    return replace(planned, scenario=replace(planned.scenario, microphone=microphone))


def _ambient_share(microphone: Microphone) -> float:
    return microphone.ambient_n_m / max(microphone.rubbing_n_m * path_rms(microphone), 1e-12)


def _level(microphone: Microphone) -> float:
    return microphone.gain * microphone.rubbing_n_m * path_rms(microphone)


def _specimen(name: str, factor: float) -> Change:
    def change(planned: Planned, _: np.random.Generator) -> Planned:
        specimen = planned.scenario.specimen
        other = replace(specimen, **{name: getattr(specimen, name) * factor})
        return replace(planned, scenario=replace(planned.scenario, specimen=other))

    return change


def _size(factor: float) -> Change:
    def change(planned: Planned, _: np.random.Generator) -> Planned:
        entry, axis = planned.mechanism, planned.scenario.axis
        assert entry is not None
        kind = MECHANISMS[entry.name]
        limits = next(each for each in kind.parameters if each.name == kind.size)
        size = min(max(entry.parameters[kind.size] * factor, limits.low), limits.high)
        other = replace(entry, parameters={**entry.parameters, kind.size: size})
        changed = replace(axis, mechanisms=(*axis.mechanisms[:-1], other))
        return replace(planned, scenario=replace(planned.scenario, axis=changed), size=size)

    return change


CAUSES: Mapping[str, str] = {
    "motion": "speed, payload and period of recordings instead of drawn ones",
    "microphone band": "housing modes fitted to normal recordings instead of usual ones",
    "rubbing": "broadband noise of the moving gear as fitted to normal recordings",
    "room noise": "what is heard at standstill, level and slope",
    "transmission error": "error of every tooth and run-out, by a factor",
    "sharpness of impacts": "damping of the tooth contacts, by a factor",
    "size of the fault": "gap or depth, by a factor",
}
"""Parts of the sound model that are replaced one at a time, in the order in which they are replaced together."""


FITTED = ("microphone band", "rubbing", "room noise")
"""Those that are taken from microphones fitted to normal recordings."""


def _changes(cause: str, half: Half) -> dict[str, Change]:
    """What is tried for a cause, by what it takes from the half; several where the nearest is taken."""
    of = f"of {len(half.recordings)} recordings"
    fitted = f"of {len(half.normal)} gearboxes"
    one: dict[str, dict[str, Change]] = {
        "motion": {of: half.motion},
        "microphone band": {fitted: half.microphone_band},
        "rubbing": {fitted: half.rubbing},
        "room noise": {fitted: half.room_noise},
    }
    by_factor: dict[str, Callable[[float], Change]] = {
        "transmission error": lambda factor: _specimen("error", factor),
        "sharpness of impacts": lambda factor: _specimen("damping", factor),
        "size of the fault": _size,
    }
    return one.get(cause) or {f"times {factor:g}": by_factor[cause](factor) for factor in FACTORS}


def compare(
    axis: Axis,
    label: str,
    recordings: NormalRecordings,
    normal: NormalRecordings,
    *,
    count: int,
    seed: int = 0,
    processes: int = 1,
    causes: Sequence[str] = (),
    advance: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Compare the recordings of a label, by gearbox, with so many simulated ones; `causes` are tried, or all.

    Raises:
        ParameterError: for an unknown cause, and where fewer than two gearboxes have a recording, so that nothing could
            be held out.
    """
    for cause in causes:
        if cause not in CAUSES:
            raise ParameterError(f"cause: {cause!r} is not known{near_match(cause, CAUSES)}")
    halves, groups = _halves(axis, label, recordings, normal)
    tried, not_tried = _tried(label, halves, causes or tuple(CAUSES))
    duration_s = min(
        LONGEST_S, float(np.median([h.samples.size for half in halves for h in half.recordings])) / SAMPLE_RATE_HZ
    )
    planned = plan(axis, {label: count}, seed, duration_s=duration_s)

    def simulated(*changes: Change) -> Floats:
        """Features of the draws with these changes, each time with the same chance, shape (draws, features)."""
        randoms = [np.random.default_rng([seed, number]) for number in range(len(planned))]
        changed = planned
        for change in changes:
            changed = [change(each, random) for each, random in zip(changed, randoms, strict=True)]
        return np.array(list(in_parallel(vector_of, changed, processes, 1)), dtype=np.float64)

    advance("taking features of the measured recordings")
    measured = [np.array([_heard_vector(axis, heard) for heard in half.recordings]) for half in halves]
    advance("simulating as drawn")
    base = simulated()
    space = Space.of(np.concatenate(measured), base)
    found: dict[str, tuple[Nearest, Nearest]] = {}
    for cause in tried:
        advance(f"simulating with another {cause}")
        found[cause] = _nearest(cause, halves, measured, space, simulated)
    vectors = {cause: [each.vectors for each in nearest] for cause, nearest in found.items()}
    extensions = [
        Extension(cause, _gain(space, measured, base, vectors[cause]), (one.taken, other.taken))
        for cause, (one, other) in found.items()
    ]
    families = _families(space, measured, groups, base, vectors)
    mending = {family.cause for family in families} | {each.cause for each in extensions if each.gain.helps}
    helping = [cause for cause in tried if cause in mending]
    together = next((each.gain for each in extensions if [each.cause] == helping), None)
    if len(helping) > 1:
        advance("simulating with all that helps")
        both = [simulated(*(found[cause][half].change for cause in helping)) for half in (0, 1)]
        together = _gain(space, measured, base, both)
    everything = np.concatenate(measured)
    distance, p_value = space.test(everything, groups, base)
    return Comparison(
        axis=axis.name,
        label=label,
        measured=len(everything),
        gearboxes=len(recordings),
        simulated=count,
        distance=distance,
        p_value=p_value,
        families=families,
        extensions=tuple(sorted(extensions, key=lambda each: -each.gain.mean)),
        together=together,
        not_tried=not_tried,
    )


def _halves(
    axis: Axis, label: str, recordings: NormalRecordings, normal: NormalRecordings
) -> tuple[list[Half], list[str]]:
    """Every other gearbox to look at and the rest to judge by, and whose each recording is; raises ParameterError."""
    if len(recordings) < 2:
        raise ParameterError(
            f"axis {axis.name!r}: {len(recordings)} gearboxes have a measured recording of two cycles or more labelled "
            f"{label!r}; two are needed, one half to look at and one to judge by"
        )
    names = sorted(recordings)
    folds = [names[0::2], names[1::2]]
    halves = [
        Half(
            axis,
            tuple(heard for name in fold for heard in recordings[name]),
            {name: normal[name] for name in fold if name in normal},
        )
        for fold in folds
    ]
    return halves, [name for fold in folds for name in fold for _ in recordings[name]]


class Nearest(NamedTuple):
    """What of a cause brings the simulated nearest to a half: how it is called, the change, features with it."""

    taken: str
    change: Change
    vectors: Floats


def _nearest(
    cause: str,
    halves: Sequence[Half],
    measured: Sequence[Floats],
    space: Space,
    simulated: Callable[[Change], Floats],
) -> tuple[Nearest, Nearest]:
    """For each half."""
    common: dict[str, Nearest] = {}  # a factor is the same change in both halves
    best = []
    for half, own in zip(halves, measured, strict=True):
        options = []
        for taken, change in _changes(cause, half).items():
            option = common[taken] if taken in common else Nearest(taken, change, simulated(change))
            common |= {taken: option} if taken.startswith("times") else {}
            options.append(option)
        best.append(min(options, key=lambda option: space.distance(own, option.vectors)))
    return best[0], best[1]


def _tried(label: str, halves: Sequence[Half], asked: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Causes that can be tried, and those that cannot with the reason."""
    without = {} if label != "normal" else {"size of the fault": "there is none"}
    if not all(half.normal for half in halves):
        without |= dict.fromkeys(FITTED, "needs normal recordings in both halves of the gearboxes")
    reasons = tuple(f"{cause}: {without[cause]}" for cause in asked if cause in without and cause in FITTED)
    return [cause for cause in CAUSES if cause in asked and cause not in without], reasons


def vector_of(planned: Planned) -> NDArray[np.float32]:
    """Features of a case as `generate` would make it, shape (features,)."""
    return simulate_case(planned).extraction.features.values


def _heard_vector(axis: Axis, heard: NormalRecording) -> NDArray[np.float32]:
    condition = OperatingCondition(
        speed_rad_s=heard.speed_rad_s,
        payload_kg_m2=heard.payload_kg_m2,
        shaft_orders=shaft_orders(axis),
        mesh_orders=mesh_orders(axis),
    )
    return extract(Recording(heard.samples, SAMPLE_RATE_HZ), condition).features.values


def _gain(
    space: Space, measured: Sequence[Floats], base: Floats, extended: Sequence[Floats], family: str | None = None
) -> Gain:
    """What goes of the distance to the other half with what was taken from a half.

    The draws are the same before and after; leaving out one at a time tells the error (jackknife, Efron 1982).
    """

    def shares(kept: NDArray[np.bool_]) -> tuple[float, float]:
        out = []
        for taken, judged in ((0, 1), (1, 0)):
            before = space.distance(measured[judged], base[kept], family)
            after = space.distance(measured[judged], extended[taken][kept], family)
            out.append((before - after) / before if before > 0 else 0.0)
        return out[0], out[1]

    draws = len(base)
    without = np.array([sum(shares(np.arange(draws) != out)) / 2 for out in range(draws)])
    return Gain(shares(np.ones(draws, dtype=np.bool_)), float(math.sqrt(draws - 1) * without.std()))


def _families(
    space: Space,
    measured: Sequence[Floats],
    groups: Sequence[str],
    base: Floats,
    found: Mapping[str, Sequence[Floats]],
) -> tuple[FamilyGap, ...]:
    everything = np.concatenate(measured)
    tests = {family: space.test(everything, groups, base, family) for family in space.families}
    p_values = dict(zip(tests, holm(np.array([p_value for _, p_value in tests.values()])).tolist(), strict=True))
    out = []
    for family, (distance, _) in tests.items():
        gains = {cause: _gain(space, measured, base, vectors, family) for cause, vectors in found.items()}
        helping = {cause: gain.mean for cause, gain in gains.items() if gain.helps}
        cause = max(helping, key=lambda name: helping[name]) if helping and p_values[family] < 0.05 else None
        out.append(
            FamilyGap(
                family,
                int(space.columns(family).sum()),
                distance,
                p_values[family],
                space.farthest(everything, base, family),
                cause,
                None if cause is None else helping[cause],
            )
        )
    return tuple(sorted(out, key=lambda each: (each.p_value, -each.distance)))


def holm(p_values: Floats) -> Floats:
    """P-values adjusted for how many are asked (Holm 1979), shape (n,).

    >>> holm(np.array([0.04, 0.01, 0.9]))
    array([0.08, 0.03, 0.9 ])
    """
    order = np.argsort(p_values)
    raised = np.maximum.accumulate(p_values[order] * np.arange(order.size, 0, -1))
    return np.asarray(np.minimum(raised, 1.0)[np.argsort(order)])


@dataclass(frozen=True, eq=False)
class Space:
    """Compared features, standardised once by measured and simulated as drawn, so that distances can be held together.

    Args:
        usable: features known in every recording that differ at all, shape (features,).
        mean, spread: of all recordings, each gearbox's origin counting the same, shape (features,).
    """

    usable: NDArray[np.bool_]
    mean: Floats
    spread: Floats

    @classmethod
    def of(cls, measured: Floats, simulated: Floats) -> Space:
        """Make it of feature vectors, shape (recordings, features)."""
        compared = np.array([definition.compared for definition in catalogue().values()])
        known = np.isfinite(measured).all(axis=0) & np.isfinite(simulated).all(axis=0)
        mean = (measured.mean(axis=0) + simulated.mean(axis=0)) / 2
        spread = np.sqrt((measured.var(axis=0) + simulated.var(axis=0)) / 2)
        return cls(compared & known & (spread > 1e-9), mean, spread)

    @property
    def families(self) -> list[str]:
        """Families of which something can be compared."""
        return [family for family in _family_names() if self.columns(family).any()]

    def columns(self, family: str | None) -> NDArray[np.bool_]:
        """Usable features of a family, or all."""
        return self.usable if family is None else self.usable & (_families_of_features() == family)

    def scaled(self, values: Floats, family: str | None = None) -> Floats:
        """Usable features in spreads; what cannot be computed of a changed recording counts as the mean."""
        chosen = self.columns(family)
        return np.nan_to_num((values[:, chosen] - self.mean[chosen]) / self.spread[chosen])

    def distance(self, measured: Floats, simulated: Floats, family: str | None = None) -> float:
        """Energy distance of two sets of vectors, per root of the number of features."""
        one, other = self.scaled(measured, family), self.scaled(simulated, family)
        both = np.concatenate([one, other])
        first = (np.arange(len(both)) < len(one))[None]
        return float(_energies(cdist(both, both), first)[0]) / math.sqrt(one.shape[1])

    def test(
        self, measured: Floats, groups: Sequence[str], simulated: Floats, family: str | None = None
    ) -> tuple[float, float]:
        """Distance, and its p-value where whole gearboxes are permuted; a simulated recording is one of its own."""
        both = np.concatenate([self.scaled(measured, family), self.scaled(simulated, family)])
        apart = cdist(both, both) / math.sqrt(both.shape[1])
        names = sorted(set(groups))
        of = np.array([names.index(name) for name in groups] + [len(names) + i for i in range(len(simulated))])
        as_is = np.arange(of.max() + 1) < len(names)
        drawn = np.random.default_rng(0).permuted(np.tile(as_is, (PERMUTATIONS, 1)), axis=1)
        distance, *others = _energies(apart, np.concatenate([as_is[None], drawn])[:, of])
        return float(distance), float(np.mean([True, *(other >= distance for other in others)]))

    def farthest(self, measured: Floats, simulated: Floats, family: str) -> tuple[FeatureGap, ...]:
        """Features of a family whose means lie farthest apart."""
        a, b = measured.mean(axis=0), simulated.mean(axis=0)
        chosen = np.flatnonzero(self.columns(family))
        order = chosen[np.argsort(-np.abs((b - a)[chosen] / self.spread[chosen]))][:SHOWN_FEATURES]
        names = list(catalogue())
        return tuple(
            FeatureGap(names[i], float(a[i]), float(b[i]), float((b[i] - a[i]) / self.spread[i])) for i in order
        )


def _energies(apart: Floats, first: NDArray[np.bool_]) -> Floats:
    """Energy distances without bias (no recording is paired with itself) for several divisions of the recordings.

    Args:
        apart: distance of every pair, shape (n, n).
        first: who belongs to the first set, shape (divisions, n).
    """
    one = first.astype(np.float64)
    to_first = one @ apart
    within, between = (to_first * one).sum(axis=1), (to_first * (1 - one)).sum(axis=1)
    others = apart.sum() - within - 2 * between
    n = one.sum(axis=1)
    m = one.shape[1] - n
    pairs = (np.maximum(k * (k - 1), 1) for k in (n, m))
    return np.asarray(2 * between / (n * m) - within / next(pairs) - others / next(pairs))


def _family_names() -> list[str]:
    return [type(family).__module__.rsplit(".", 1)[-1].replace("_", " ") for family in FEATURES]


def _families_of_features() -> NDArray[np.str_]:
    names = zip(_family_names(), FEATURES, strict=True)
    return np.array([name for name, family in names for _ in family.definitions])
