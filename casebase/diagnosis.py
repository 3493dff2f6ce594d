"""Reuse: from the features of a recording to a verdict, with why, how sure and what it was compared with."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from casebase.case_table import CaseTable, Mask
from casebase.experience import UNKNOWN_COLOUR, Experience, Judgement, gather, representative
from casebase.explanation import Evidence, baseline_evidence, feature_evidence, motion_evidence, novelty_evidence
from casebase.learning import Similarity
from casebase.moving import all_move, moving
from casebase.novelty import border, ranges_of
from casebase.priors import prior_weights
from casebase.retrieval import CaseMatrix, Match, NearestByClass
from casebase.signals.features import Extraction, FeatureVector, QualityFlag
from casebase.signals.features.meshing import Meshing
from casebase.superposition import Fault, faults
from casebase.voting import NEAREST

DIAGNOSED_FROM = 0.9
"""A label of less probability is `ambiguous`: what is diagnosed is right nine times in ten, each by itself."""
NEIGHBOURS = 5
MASKS_KEPT = 16
OF_ONE_AXIS = frozenset(definition.name for definition in Meshing.definitions)
"""Features that mean the same on one axis alone."""


@dataclass(frozen=True)
class Hypothesis:
    """One label and what speaks for it."""

    label: str
    probability: float
    p_value: float
    measured: int
    simulated: int

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {
            "label": self.label,
            "probability": self.probability,
            "p_value": self.p_value,
            "support": {"measured": self.measured, "simulated": self.simulated},
        }


@dataclass(frozen=True)
class Diagnosis:
    """What a recording is, by the library; `ambiguous`, `not_in_library` and `unusable` are answers, not errors.

    Args:
        label: the best hypothesis of a `diagnosed` or `ambiguous` recording, else None.
        faults: every fault that is present, also two at once.
        novelty, threshold: distance to what is known and where the unknown begins; None if the library cannot say.
        remarks: what limits this answer, one sentence each.
    """

    verdict: str
    label: str | None = None
    probability: float | None = None
    hypotheses: tuple[Hypothesis, ...] = ()
    neighbours: tuple[Match, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    quality: tuple[QualityFlag, ...] = ()
    novelty: float | None = None
    threshold: float | None = None
    remarks: tuple[str, ...] = field(default=())
    faults: tuple[Fault, ...] = ()

    def to_document(self) -> dict[str, object]:
        """Return it as JSON; `id`, `recording` and `provenance` are added where it is stored."""
        return {
            "verdict": self.verdict,
            "label": self.label,
            "probability": self.probability,
            "hypotheses": [each.to_document() for each in self.hypotheses],
            "faults": [each.to_document() for each in self.faults],
            "neighbours": [_neighbour(match) for match in self.neighbours],
            "evidence": [each.to_document() for each in self.evidence],
            "disturbances": [each for flag in self.quality if (each := flag.disturbance) is not None],
            "quality": [flag.to_document() for flag in self.quality],
            "novelty": {"distance": self.novelty, "threshold": self.threshold},
            "remarks": list(self.remarks),
        }


def _neighbour(match: Match) -> dict[str, object]:
    return {
        "case_id": match.case_id,
        "label": match.label,
        "origin": match.origin,
        "distance": match.distance,
        "contributions": {name: part for name, part in match.contributions.items() if part},
    }


class Reasoner:
    """A table of cases and what was learned, ready to diagnose; safe to share between threads.

    Args:
        outgrown: whether the weights were learned from a library that has changed much since.
    """

    def __init__(
        self,
        table: CaseTable,
        similarity: Similarity,
        similarity_version: int | None = None,
        outgrown: bool = False,
    ) -> None:
        self.table, self.similarity, self.similarity_version = table, similarity, similarity_version
        self.outgrown = outgrown
        self.matrix = CaseMatrix(table, similarity.metric)
        self.all_move = all_move(table.names, table.values)
        self.ranges = ranges_of(table, border(table))
        self._experiences: OrderedDict[bytes, Experience] = OrderedDict()
        self._lock = threading.Lock()

    def experience(self, present: Mask) -> Experience:
        """Return the library held against itself over these features; kept for the next query like it."""
        key = present.tobytes()
        with self._lock:
            if key not in self._experiences:
                rows = representative(self.table)
                self._experiences[key] = gather(self.table, self.similarity, present, rows)
                while len(self._experiences) > MASKS_KEPT:
                    self._experiences.popitem(last=False)
            self._experiences.move_to_end(key)
            return self._experiences[key]

    def judge(self, values: NDArray[np.floating]) -> Judgement:
        """Return probabilities, p-values and novelty of a vector of features, shape (n,)."""
        experience = self.experience(np.isfinite(values))
        return self._judged(values, self._near(values, NEAREST, experience), experience)

    def _near(
        self, values: NDArray[np.floating], k: int, experience: Experience, without: Mask | None = None
    ) -> NearestByClass:
        """Return the nearest cases of every class among those that vote."""
        voters = experience.voters if without is None else experience.voters & ~without
        return self.matrix.nearest_by_class(values, k, where=None if voters.all() else voters)

    def _judged(self, values: NDArray[np.floating], near: NearestByClass, experience: Experience) -> Judgement:
        still = self.all_move and not moving(self.table.names, values[None])[0]
        return experience.judge(near.voting(NEAREST), self.ranges.distance(values), values, still)

    def diagnose(self, extraction: Extraction, without: Mask | None = None, axis: str | None = None) -> Diagnosis:
        """Return the diagnosis of a recording by its features.

        Args:
            without: the cases that are of the same sound and have no vote, shape (cases,).
            axis: of the recording; lines of its meshes are held against cases of the same axis alone, for those of
                another are of other teeth.
        """
        extraction = self._comparable(extraction, axis)
        if not extraction.usable:
            remark = f"the recording cannot be used: {extraction.unusable_reason}"
            return Diagnosis("unusable", quality=extraction.quality, remarks=(remark,))
        values = extraction.features.values
        alone = not len(self.table) if without is None else bool(without.all())
        if alone or not np.isfinite(values[prior_weights(self.table.names) > 0]).any():
            remark = "the library has no case to compare with: add labelled recordings or generate cases"
            return Diagnosis("not_in_library", quality=extraction.quality, remarks=(remark,))
        if self.all_move and _less_than_a_cycle(extraction):
            remark = (
                "the recording covers less than one cycle of the motion, so what happens once per cycle cannot be "
                "excluded; record three cycles or more"
            )
            return Diagnosis("unusable", quality=extraction.quality, remarks=(remark,))
        return self._compared(extraction, without)

    def _comparable(self, extraction: Extraction, axis: str | None) -> Extraction:
        """Leave out the features that only cases of the same axis can be held against, where there are none."""
        if axis is None or axis in self.table.axes:
            return extraction
        names, values = extraction.features.names, extraction.features.values.copy()
        values[[name in OF_ONE_AXIS for name in names]] = np.nan
        return replace(extraction, features=FeatureVector(names, values))

    def _compared(self, extraction: Extraction, without: Mask | None) -> Diagnosis:
        values = extraction.features.values
        experience = self.experience(np.isfinite(values))
        near = self._near(values, max(NEIGHBOURS, NEAREST * len(self.table.classes)), experience, without)
        # what is the same sound is shown, and has no vote
        shown = near if without is None or not without.any() else self._near(values, NEIGHBOURS, experience)
        judgement = self._judged(values, near, experience)
        hypotheses = _hypotheses(near, judgement)
        verdict = verdict_of(judgement, extraction.poor)
        best = hypotheses[0]
        label = None if verdict == "not_in_library" else best.label
        return Diagnosis(
            verdict=verdict,
            label=label,
            probability=None if label is None else best.probability,
            hypotheses=hypotheses,
            neighbours=shown.overall(NEIGHBOURS),
            evidence=self._evidence(extraction, near, label, experience if judgement.refused else None),
            quality=extraction.quality,
            novelty=judgement.novelty,
            threshold=judgement.threshold,
            remarks=tuple(self._remarks(extraction, judgement, experience)),
            faults=() if label is None else self._faults(values, experience, hypotheses),
        )

    def _faults(
        self, values: NDArray[np.floating], experience: Experience, hypotheses: Sequence[Hypothesis]
    ) -> tuple[Fault, ...]:
        named = [(each.label, each.probability) for each in hypotheses]
        return faults(self.table, experience.voters, self.similarity.metric, experience.sharpness, values, named)

    def _evidence(
        self, extraction: Extraction, near: NearestByClass, label: str | None, refusing: Experience | None
    ) -> tuple[Evidence, ...]:
        values, motion = extraction.features.values, motion_evidence(extraction)
        if refusing is not None and refusing.normal is not None:
            return (*baseline_evidence(self.table.names, values, refusing.normal), *motion)
        if label is None:
            return (*novelty_evidence(self.table.names, values, self.ranges), *motion)
        return (*feature_evidence(self.table, values, near.of(label), near.other_than(label)), *motion)

    def _remarks(self, extraction: Extraction, judgement: Judgement, experience: Experience) -> list[str]:
        remarks = (
            []
            if not extraction.poor
            else ["the recording is too poor for a label to be relied on: see what is said of it, and record again"]
        )
        silent = int(np.count_nonzero(~experience.voters))
        if silent:
            remarks.append(f"{silent} simulated cases have no vote: enough cases of all these kinds were measured")
        if judgement.still:
            remarks.append(
                "no regular motion is heard, while all cases are of axes that move back and forth: "
                "record while the axis moves between the same two places, nearer to the gearbox"
            )
        if judgement.unlike > UNKNOWN_COLOUR:
            remarks.append(
                "the sound has another colour than every measured case: another machine, or a recorder that the "
                "library does not know"
            )
        if judgement.refused:
            remarks.append(
                "the nearest cases are of good gears, but the recording is unlike every one of them: it may be a "
                "fault that the library does not know, or a known one smaller than its cases"
            )
        small = [label for label, enough in zip(judgement.classes, judgement.supports_level, strict=True) if not enough]
        if small:
            remarks.append(
                f"p-values of {', '.join(small)} cannot fall to 0.05: that takes 19 cases held out by gearbox"
            )
        if self.outgrown:
            remarks.append("the library changed since feature weights were learned from it; they will be learned again")
        if len(self.table.gearboxes_known) < 2:
            remarks.append("fewer than two gearboxes are known, so probabilities are not calibrated across gearboxes")
        if judgement.threshold is None:
            remarks.append("too few cases to say where the unknown begins")
        return remarks


def _less_than_a_cycle(extraction: Extraction) -> bool:
    """Whether reversals are known, so few that no cycle is whole; with more of them the motion is irregular."""
    count = len(extraction.motion.reversal_times_s)
    return 0 < count < 3 and extraction.motion.cycles < 1


def _hypotheses(near: NearestByClass, judgement: Judgement) -> tuple[Hypothesis, ...]:
    matches = near.overall(NEAREST * len(judgement.classes))
    found = [
        Hypothesis(
            label=label,
            probability=float(judgement.probabilities[index]),
            p_value=float(judgement.p_values[index]),
            measured=_count(matches, label, "measured"),
            simulated=_count(matches, label, "simulated"),
        )
        for index, label in enumerate(judgement.classes)
    ]
    return tuple(sorted(found, key=lambda each: (-each.probability, -each.p_value, each.label)))


def verdict_of(judgement: Judgement, poor: bool = False) -> str:
    """Return `not_in_library`, `ambiguous` or `diagnosed`.

    Nothing is said with confidence of a poor recording, nor by a library that cannot say where the unknown begins.
    """
    if (
        judgement.still
        or judgement.unlike > UNKNOWN_COLOUR
        or judgement.refused
        or (judgement.threshold is not None and judgement.novelty > judgement.threshold)
    ):
        return "not_in_library"
    sure = judgement.probabilities.max() >= DIAGNOSED_FROM and judgement.threshold is not None
    return "diagnosed" if sure and not poor else "ambiguous"


def _count(matches: Sequence[Match], label: str, origin: str) -> int:
    return sum(match.label == label and match.origin == origin for match in matches)
