"""The sound of a place: fitted to the normal recordings in the library, tested, kept as a versioned artifact."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.simulated.comparison import holm
from app.simulated.generation import condition_of, sound_kind
from casebase.description import condition_of as stored_condition
from casebase.library import CaseLibrary
from casebase.store.artifacts import add_artifact
from casebase.store.models import Artifact, Case, StoredRecording
from signals.features import catalogue, extract
from signals.reading.decode import read_recording
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.acoustics.transfer_path_fit import FittedSound, NormalRecording, fit_sound, scenario_like
from sim.description.axis import Axis
from sim.errors import ParameterError

Floats = NDArray[np.float64]
PER_RECORDING = 4  # simulated twins of every measured normal recording
PERMUTATIONS = 999
LEVEL = 0.05


@dataclass(frozen=True)
class Unmatched:
    """A feature by which simulated normal recordings can be told from measured ones.

    `difference` is that of the means in standard deviations, `p_value` of a Kolmogorov-Smirnov test, after Holm.
    """

    feature: str
    measured: float
    simulated: float
    difference: float
    p_value: float


@dataclass(frozen=True)
class TwoSampleTest:
    """Whether simulated normal recordings can be told from measured ones, over all compared features together.

    Energy distance of standardised features (Szekely and Rizzo 2004) with a permutation test: `p_value` below 0.05
    means that they can be told apart. `told_apart` is the share that a classifier by the nearest neighbour gets right,
    as many of either kind, each case left out (Lopez-Paz and Oquab 2017): 0.5 is chance.
    """

    distance: float
    p_value: float
    told_apart: float
    measured: int
    simulated: int
    unmatched: tuple[Unmatched, ...]


@dataclass(frozen=True)
class FittedPlace:
    """What was fitted for an axis: one sound per gearbox, or recording of an unnamed one, and the test of all."""

    axis: str
    sounds: Mapping[str, FittedSound]
    test: TwoSampleTest

    def to_document(self) -> dict[str, object]:
        """As JSON, for the artifact; `microphones` is what generation reads."""
        return {
            "axis": self.axis,
            "fitted_to": list(self.sounds),
            "microphones": [asdict(sound.microphone) for sound in self.sounds.values()],
            "misfit_db": {name: sound.misfit_db for name, sound in self.sounds.items()},
            "line_over_noise": {name: list(sound.line_over_noise) for name, sound in self.sounds.items()},
            "not_fitted": [
                "transmission error: one microphone hears its product with the sensitivity; the description's is used",
                "rubbing rises with the first power of speed",
            ],
            "test": asdict(self.test),
        }


def measured_recordings(
    library: CaseLibrary, session: Session, axis: Axis, label: str = "normal"
) -> dict[str, list[NormalRecording]]:
    """Measured recordings of a label of an axis by gearbox, each by itself where it has none; none without motion."""
    statement = select(StoredRecording).join(Case, Case.recording_id == StoredRecording.id)
    statement = statement.where(
        Case.label == label,
        Case.origin == "measured",
        Case.state == "confirmed",
        Case.quarantine_reason.is_(None),
        StoredRecording.axis == axis.name,
        StoredRecording.erased_at.is_(None),
    )
    found: dict[str, list[NormalRecording]] = {}
    for row in session.scalars(statement.order_by(StoredRecording.id)):
        recording = read_recording(library.retrieve.audio_path(row), channel=row.channel)
        heard = _heard(axis, row, recording.resampled(SAMPLE_RATE_HZ))
        if heard is not None:
            found.setdefault(row.gearbox or f"recording {row.id}", []).append(heard)
    return found


def _heard(axis: Axis, row: StoredRecording, recording: Recording) -> NormalRecording | None:
    condition = stored_condition(row.description)
    period = condition.motion_period_s or extract(recording, condition).motion.period_s
    if not period or recording.duration_s < 2 * period:
        return None
    return NormalRecording(
        recording.samples,
        row.speed_rad_s or axis.motion.load_speed_rad_s,
        row.payload_kg_m2 or axis.load.inertia_kg_m2,
        period,
    )


def fit_place(
    axis: Axis, recordings: Mapping[str, Sequence[NormalRecording]], advance: Callable[[str], None]
) -> FittedPlace:
    """Fit every gearbox, simulate twins of its recordings and test whether they can be told apart.

    Raises ParameterError where there is no recording to fit to.
    """
    if not recordings:
        raise ParameterError(
            f"axis {axis.name!r}: has no measured normal recording of two cycles or more; add some with label normal"
        )
    sounds = {}
    for gearbox, heard in recordings.items():
        advance(f"fitting {gearbox}")
        sounds[gearbox] = fit_sound(axis, heard)
    measured, simulated = [], []
    for gearbox, heard in recordings.items():
        advance(f"simulating {gearbox}")
        for number, one in enumerate(heard):
            for twin in range(PER_RECORDING):
                scenario = scenario_like(axis, one, sounds[gearbox].microphone, hash_of(gearbox, number, twin))
                condition = condition_of(scenario)
                sound = Recording(scenario.perform(), SAMPLE_RATE_HZ)
                simulated.append(extract(sound, condition).features.values)
            measured.append(extract(Recording(one.samples, SAMPLE_RATE_HZ), condition).features.values)
    return FittedPlace(axis.name, sounds, two_sample_test(np.array(measured), np.array(simulated)))


def hash_of(gearbox: str, number: int, twin: int) -> int:
    """A seed that belongs to a twin of a recording."""
    return int(np.random.SeedSequence([*gearbox.encode(), number, twin]).generate_state(1)[0])


def two_sample_test(measured: NDArray[np.floating], simulated: NDArray[np.floating], seed: int = 0) -> TwoSampleTest:
    """Test whether two sets of feature vectors, shape (cases, features), are of one kind."""
    names = np.array(list(catalogue()))
    compared = np.array([definition.compared for definition in catalogue().values()])
    both = np.concatenate([measured, simulated]).astype(np.float64)
    usable = compared & np.isfinite(both).all(axis=0) & (both.std(axis=0) > 0)
    scaled = (both[:, usable] - both[:, usable].mean(axis=0)) / both[:, usable].std(axis=0)
    first = np.arange(len(both)) < len(measured)
    apart = cdist(scaled, scaled)
    random = np.random.default_rng(seed)
    distance = _energy(apart, first)
    others = [_energy(apart, random.permutation(first)) for _ in range(PERMUTATIONS)]
    p_value = (1 + sum(other >= distance for other in others)) / (1 + PERMUTATIONS)
    unmatched = _unmatched(names[usable], both[first][:, usable], both[~first][:, usable])
    return TwoSampleTest(distance, p_value, _told_apart(apart, first), len(measured), len(simulated), unmatched)


def _told_apart(apart: Floats, first: NDArray[np.bool_]) -> float:
    """Share right over parts of the second kind that are as large as the first; every other one of them in a part."""
    one, other = np.flatnonzero(first), np.flatnonzero(~first)
    parts = max(1, other.size // max(one.size, 1))
    shares = []
    for start in range(parts):
        rows = np.concatenate([one, other[start::parts]])
        near = np.where(np.eye(rows.size, dtype=bool), np.inf, apart[np.ix_(rows, rows)]).argmin(axis=1)
        shares.append(float(np.mean(first[rows][near] == first[rows])))
    return float(np.mean(shares))


def _energy(apart: Floats, first: NDArray[np.bool_]) -> float:
    between = apart[np.ix_(first, ~first)].mean()
    return float(2 * between - apart[np.ix_(first, first)].mean() - apart[np.ix_(~first, ~first)].mean())


def _unmatched(names: NDArray[np.str_], measured: Floats, simulated: Floats) -> tuple[Unmatched, ...]:
    from scipy import stats  # slow to import

    p_values = np.array([stats.ks_2samp(a, b).pvalue for a, b in zip(measured.T, simulated.T, strict=True)])
    adjusted = holm(p_values)
    spread = np.sqrt(0.5 * (measured.var(axis=0) + simulated.var(axis=0)))
    rows = zip(names, measured.mean(axis=0), simulated.mean(axis=0), spread, adjusted, strict=True)
    found = [
        Unmatched(str(name), float(a), float(b), float((b - a) / s), float(p)) for name, a, b, s, p in rows if p < LEVEL
    ]
    return tuple(sorted(found, key=lambda each: -abs(each.difference)))


def keep(session: Session, place: FittedPlace) -> Artifact:
    """Store the fitted place as the next version, which generation uses from now on."""
    detail = {"energy_distance": place.test.distance, "unmatched": len(place.test.unmatched)}
    return add_artifact(
        session, sound_kind(place.axis), place.to_document(), score=place.test.p_value, score_detail=detail
    )
