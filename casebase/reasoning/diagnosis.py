"""Reuse: from the features of a recording to a verdict, with why, how sure and what it was compared with."""

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from casebase.labels import BASELINES
from casebase.reasoning.classifier import Calibration, Classifier, log_odds, weights_for
from casebase.reasoning.explanation import Evidence, feature_evidence, motion_evidence, novelty_evidence
from casebase.reasoning.novelty import Likeness, follow_motion, likenesses, nearly_all_move
from casebase.reasoning.priors import prior_weights
from casebase.reasoning.tuning import TUNING
from casebase.search.case_selection import compared, fitted
from casebase.search.case_table import CaseTable, Mask
from casebase.search.retrieval import CaseMatrix, Match, NearestByClass, metric_of
from casebase.search.similarity import Floats
from signals.features import Extraction, QualityFlag
from signals.features.lines import Meshing

DIAGNOSED_FROM = 0.9
"""A label of less probability is `ambiguous`: what is diagnosed is right nine times in ten."""
EXCLUDED_BELOW = 0.1
"""A label of a smaller p-value is left out of the prediction set, which holds the truth nine times in ten."""
NEIGHBOURS, SUPPORTING = 5, 3
FEWEST_FOR_P_VALUE = 19
"""A p-value of so many cases can fall to 0.05."""
MODELS_KEPT = 16
OF_ONE_AXIS = frozenset(definition.name for definition in Meshing.definitions)
"""Features that mean the same on one axis alone."""


@dataclass(frozen=True)
class Hypothesis:
    """One label and what speaks for it."""

    label: str
    probability: float
    p_value: float
    measured: int = 0
    simulated: int = 0

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {
            "label": self.label,
            "probability": self.probability,
            "p_value": self.p_value,
            "support": {"measured": self.measured, "simulated": self.simulated},
        }


@dataclass(frozen=True)
class Fault:
    """A fault that is present, with its probability."""

    label: str
    probability: float


@dataclass(frozen=True)
class Diagnosis:
    """What a recording is, by the library; `ambiguous`, `not_in_library` and `unusable` are answers, not errors.

    Args:
        label: the best hypothesis of a `diagnosed` or `ambiguous` recording, else None.
        fault: how probable it is that there is any; None where the library has no normal case, or no case like it.
        labels: those that cannot be excluded at EXCLUDED_BELOW.
        faults: every fault that is present, also two at once.
        p_value: how often a recording of the leading label is as unlike its cases; None if the library cannot say.
        remarks: what limits this answer, one sentence each.
    """

    verdict: str
    label: str | None = None
    probability: float | None = None
    fault: float | None = None
    labels: tuple[str, ...] = ()
    hypotheses: tuple[Hypothesis, ...] = ()
    neighbours: tuple[Match, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    quality: tuple[QualityFlag, ...] = ()
    p_value: float | None = None
    remarks: tuple[str, ...] = field(default=())
    faults: tuple[Fault, ...] = ()

    def to_document(self) -> dict[str, object]:
        """Return it as JSON; `id`, `recording` and `provenance` are added where it is stored."""
        return {
            "verdict": self.verdict,
            "label": self.label,
            "probability": self.probability,
            "fault": {"present": _present(self.fault), "probability": self.fault},
            "labels": list(self.labels),
            "hypotheses": [each.to_document() for each in self.hypotheses],
            "faults": [{"label": each.label, "probability": each.probability} for each in self.faults],
            "neighbours": [_neighbour(match) for match in self.neighbours],
            "evidence": [each.to_document() for each in self.evidence],
            "disturbances": [each for flag in self.quality if (each := flag.disturbance) is not None],
            "quality": [flag.to_document() for flag in self.quality],
            "novelty": {
                "distance": None if self.p_value is None else -float(np.log10(max(self.p_value, 1e-300))),
                "threshold": None if self.p_value is None else -float(np.log10(TUNING.level)),
            },
            "remarks": list(self.remarks),
        }


def _present(probability: float | None) -> bool | None:
    if probability is None or 1 - DIAGNOSED_FROM < probability < DIAGNOSED_FROM:
        return None
    return probability >= DIAGNOSED_FROM


def _neighbour(match: Match) -> dict[str, object]:
    return {
        "case_id": match.case_id,
        "label": match.label,
        "origin": match.origin,
        "distance": match.distance,
        "contributions": {name: part for name, part in match.contributions.items() if part},
    }


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the cases say of the features of one recording.

    Args:
        hypotheses: the most probable first; one label alone has no probability but 1 over two.
        fault: see `Diagnosis`.
        likeness: of the leading label; None where its cases are of too few gearboxes.
        p_value: of the leading label.
        still: whether it does not follow a motion although the cases do.
    """

    hypotheses: tuple[Hypothesis, ...]
    fault: float | None
    likeness: Likeness | None
    p_value: float | None
    still: bool

    @property
    def best(self) -> Hypothesis:
        """The most probable label."""
        return self.hypotheses[0]

    @property
    def novel(self) -> bool:
        """Whether the recording is unlike the cases of the leading label."""
        return self.still or (self.p_value is not None and self.p_value < TUNING.level)

    def verdict(self, poor: bool = False) -> str:
        """Return `not_in_library`, `ambiguous` or `diagnosed`.

        Nothing is diagnosed of a poor recording, nor where the cases cannot say what is unlike them.
        """
        if self.novel:
            return "not_in_library"
        sure = self.best.probability >= DIAGNOSED_FROM and self.p_value is not None
        return "diagnosed" if sure and not poor else "ambiguous"


@dataclass(frozen=True, eq=False)
class _Model:
    """What the cases that count for one axis amount to.

    Args:
        counting: which cases count, shape (cases,).
        classifier: None where they have one label alone.
        likenesses: what their labels are like.
    """

    counting: Mask
    classifier: Classifier | None
    likenesses: Mapping[frozenset[str], Likeness]


class Reasoner:
    """A table of cases, ready to diagnose; safe to share between threads."""

    def __init__(self, table: CaseTable) -> None:
        self.table = table
        self.matrix = CaseMatrix(table, metric_of(table, weights_for(table.names, table.values)))
        self.all_move = nearly_all_move(table.names, table.values)
        self._models: OrderedDict[tuple[str | None, bool], _Model] = OrderedDict()
        self._lock = threading.Lock()

    def model(self, axis: str | None, gearbox: str | None = None) -> _Model:
        """Return the model of an axis; kept for the next recording of it.

        Where one gearbox alone is known by several labels, its own recordings are judged by each other.
        """
        own = gearbox is not None and self.table.gearboxes_known == [gearbox]
        key = axis if axis in self.table.axes else None, own
        with self._lock:
            if key not in self._models:
                table = self.table.by_recording if own else self.table
                classifier = fitted(table, key[0])
                counting = np.zeros(len(table), np.bool_)
                counting[slice(None) if classifier is None else classifier.rows] = True
                self._models[key] = _Model(counting, classifier, likenesses(table, compared(table, key[0], counting)))
                while len(self._models) > MODELS_KEPT:
                    self._models.popitem(last=False)
            self._models.move_to_end(key)
            return self._models[key]

    def accuracy(self, axis: str | None) -> float | None:
        """Return how often the leading label was right of cases left out by gearbox; None if that cannot be said."""
        classifier = self.model(axis).classifier
        if classifier is None or not classifier.held_out.truth.size:
            return None
        return float(np.mean(classifier.held_out.shares.argmax(axis=1) == classifier.held_out.truth))

    def judge(
        self,
        values: NDArray[np.floating],
        axis: str | None = None,
        gearbox: str | None = None,
        without: NDArray[np.intp] | None = None,
    ) -> Judgement:
        """Return what the cases say of a vector of features, shape (n,).

        Args:
            axis, gearbox: of the recording, where known.
            without: rows that do not count, for they are the same recording.
        """
        values = self._comparable(values, axis)
        model = self.model(axis, gearbox)
        hypotheses, fault = self._shares(model.classifier, values, without)
        known = [each for labels, each in model.likenesses.items() if hypotheses[0].label in labels]
        likeness = max(known, key=lambda each: each.p_value(values), default=None)
        still = self.all_move and not bool(follow_motion(self.table.names, values[None])[0])
        return Judgement(hypotheses, fault, likeness, None if likeness is None else likeness.p_value(values), still)

    def _comparable(self, values: NDArray[np.floating], axis: str | None) -> NDArray[np.floating]:
        """Leave out the features that only cases of the same axis can be held against, where there are none."""
        if axis is None or axis in self.table.axes:
            return values
        return np.where([name in OF_ONE_AXIS for name in self.table.names], np.nan, values)

    def _shares(
        self, classifier: Classifier | None, values: NDArray[np.floating], without: NDArray[np.intp] | None
    ) -> tuple[tuple[Hypothesis, ...], float | None]:
        left_out = [] if without is None else without.tolist()
        known = self.table.classes if classifier is None else classifier.labels(left_out)
        if classifier is None or len(known) < 2:
            return (Hypothesis((*known, *self.table.classes)[0], 0.5, 1.0),), None
        shares = classifier.shares(values, left_out)
        seen = classifier.held_out
        sure = seen.label().probability(float(log_odds(shares.max())))
        probabilities, p_values = _calibrated(shares, sure), seen.p_values(shares)
        found = [Hypothesis(*each) for each in zip(classifier.classes, probabilities, p_values, strict=True)]
        sound = np.isin(classifier.classes, BASELINES)
        fault = None
        if sound.any():
            score = float(log_odds(1 - shares[sound].sum()))
            leads = seen.fault().probability(abs(score))
            fault = leads if score > 0 else 1 - leads
        return tuple(sorted(found, key=lambda each: (-each.probability, -each.p_value, each.label))), fault

    def diagnose(
        self, extraction: Extraction, without: Mask | None = None, axis: str | None = None, gearbox: str | None = None
    ) -> Diagnosis:
        """Return the diagnosis of a recording by its features.

        Args:
            without: the cases that are of the same sound and do not count, shape (cases,).
            axis, gearbox: of the recording, where known.
        """
        reason = self._unusable(extraction)
        if reason is not None:
            return Diagnosis("unusable", quality=extraction.quality, remarks=(reason,))
        alone = not len(self.table) if without is None else bool(without.all())
        values = extraction.features.values
        if alone or not np.isfinite(values[prior_weights(self.table.names) > 0]).any():
            remark = "the library has no case to compare with: add labelled recordings or generate cases"
            return Diagnosis("not_in_library", quality=extraction.quality, remarks=(remark,))
        return self._compared(
            extraction, np.zeros(len(self.table), np.bool_) if without is None else without, axis, gearbox
        )

    def _unusable(self, extraction: Extraction) -> str | None:
        if not extraction.usable:
            return f"the recording cannot be used: {extraction.unusable_reason}"
        if self.all_move and less_than_a_cycle(len(extraction.motion.reversal_times_s), extraction.motion.cycles):
            return (
                "the recording covers less than one cycle of the motion, so what happens once per cycle cannot be "
                "excluded; record three cycles or more"
            )
        return None

    def _compared(self, extraction: Extraction, without: Mask, axis: str | None, gearbox: str | None) -> Diagnosis:
        values = self._comparable(extraction.features.values, axis)
        model = self.model(axis, gearbox)
        judgement = self.judge(values, axis, gearbox, np.flatnonzero(without))
        nearest = max(NEIGHBOURS, SUPPORTING * len(self.table.classes))
        near = self.matrix.nearest_by_class(values, nearest, where=model.counting & ~without)
        # what is the same sound is shown, and does not count
        shown = (
            near
            if not without.any()
            else self.matrix.nearest_by_class(values, NEIGHBOURS, where=model.counting | without)
        )
        verdict = judgement.verdict(extraction.poor)
        label = None if verdict == "not_in_library" else judgement.best.label
        return Diagnosis(
            verdict=verdict,
            label=label,
            probability=None if label is None else judgement.best.probability,
            fault=None if label is None else judgement.fault,
            labels=() if label is None else tuple(h.label for h in judgement.hypotheses if h.p_value > EXCLUDED_BELOW),
            hypotheses=tuple(_supported(each, near) for each in judgement.hypotheses),
            neighbours=shown.overall(NEIGHBOURS),
            evidence=self._evidence(extraction, near, label, judgement),
            quality=extraction.quality,
            p_value=0.0 if judgement.still else judgement.p_value,
            remarks=tuple(self._remarks(extraction, judgement, model)),
            faults=() if label is None else self._faults(values, model, judgement),
        )

    def _faults(self, values: NDArray[np.floating], model: _Model, judgement: Judgement) -> tuple[Fault, ...]:
        """Return every fault that is present, the leading label first; none where that is of a good gear."""
        best, classifier = judgement.best, model.classifier
        if best.label in BASELINES or classifier is None:
            return ()
        found = []
        for each in judgement.hypotheses[1:]:
            if each.label not in BASELINES:
                beside = classifier.superposed(values, best.label, each.label, BASELINES)
                found.append(Fault(each.label, min(each.probability + best.probability * beside, best.probability)))
        present = [each for each in found if each.probability > TUNING.present]
        return (Fault(best.label, best.probability), *sorted(present, key=lambda fault: -fault.probability))

    def _evidence(
        self, extraction: Extraction, near: NearestByClass, label: str | None, judgement: Judgement
    ) -> tuple[Evidence, ...]:
        values, motion = extraction.features.values, motion_evidence(extraction)
        if label is None:
            if judgement.likeness is None:
                return motion
            return (*novelty_evidence(self.table.names, values, judgement.best.label, judgement.likeness), *motion)
        return (*feature_evidence(self.table, values, near.of(label), near.other_than(label)), *motion)

    def _remarks(self, extraction: Extraction, judgement: Judgement, model: _Model) -> list[str]:
        """Return what limits the answer."""
        best, few, table = judgement.best, [], self.table
        unused = int(np.count_nonzero((table.origins == "simulated") & ~model.counting))
        answers = 0
        if model.classifier is not None:
            answers = model.classifier.held_out.truth.size
            counts = np.bincount(model.classifier.held_out.truth, minlength=len(model.classifier.classes))
            few = [
                each for each, count in zip(model.classifier.classes, counts, strict=True) if count < FEWEST_FOR_P_VALUE
            ]
        most = Calibration(observations=answers).most
        surest = 0.5 < most < 0.995 and max(best.probability, judgement.fault or 0) > most - 1e-9
        remarks = (
            (
                model.classifier is None,
                f"the library knows one label alone, {table.classes[0]}: it can say that a recording is unlike it "
                "and no more; add cases of other labels or generate them",
            ),
            (
                extraction.poor,
                "the recording is too poor for a label to be relied on: see its quality, and record again",
            ),
            (
                unused > 0,
                f"{unused} simulated cases do not count here: these labels were measured, or the axis is another",
            ),
            (
                judgement.still,
                "no regular motion is found, while all cases are of axes that move back and forth: "
                "record while the axis moves between the same two positions, nearer to the gearbox",
            ),
            (
                judgement.novel and not judgement.still,
                f"the nearest cases are {best.label}, but the recording is unlike them: it may be a fault "
                "that the library does not know, another machine or another recorder",
            ),
            (
                bool(few),
                f"p-values of {', '.join(few)} cannot fall to 0.05: that takes {FEWEST_FOR_P_VALUE} cases left out by "
                "gearbox",
            ),
            (
                len(table.gearboxes_known) < 2,
                "fewer than two gearboxes are known, so probabilities are not calibrated across gearboxes",
            ),
            (surest and not judgement.novel, "more labelled recordings could make it surer"),
            (judgement.p_value is None, f"too few gearboxes of {best.label} are known to say what is unlike them"),
        )
        return [words for holds, words in remarks if holds]


def less_than_a_cycle(reversals: int, cycles: float) -> bool:
    """Whether reversals are known, so few that no cycle is whole; with more of them the motion is irregular."""
    return 0 < reversals < 3 and cycles < 1


def _calibrated(shares: Floats, sure: float) -> list[float]:
    """Return probabilities: that of the leading label is given, the others divide the rest as before.

    Where it is less than its share, all are drawn to an even share, so that the leading label stays in the lead.
    """
    top, even = int(shares.argmax()), 1 / shares.size
    share, sure = float(shares[top]), max(sure, even + 1e-3)
    if share > sure:
        return list(map(float, even + (sure - even) / (share - even) * (shares - even)))
    probabilities = shares * ((1 - sure) / max(1 - share, 1e-12))
    probabilities[top] = sure
    return list(map(float, probabilities))


def _supported(hypothesis: Hypothesis, near: NearestByClass) -> Hypothesis:
    """Return it with the number of its cases of each origin among the nearest ones of all labels."""
    origins = [match.origin for match in near.overall(SUPPORTING * len(near.rows)) if match.label == hypothesis.label]
    return replace(hypothesis, measured=origins.count("measured"), simulated=origins.count("simulated"))
