"""The nearest cases of a recording, as somebody asks for them; the same answer over HTTP and on the command line."""

from collections.abc import Iterable
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, StrictInt, model_validator
from sqlalchemy.orm import Session

from app.documents import QualityDocument, Question
from app.recordings.intake import DecodedRecording
from casebase.library import CaseLibrary
from casebase.reasoning.priors import LEVEL, prior_of
from casebase.recordings import feature_values
from casebase.search.case_table import CaseTable, Mask
from casebase.search.representation import weights_of
from casebase.search.retrieval import Match
from casebase.search.similarity import Floats
from casebase.store.fields import Word
from signals.features import FeatureDefinition, FlagLevel, catalogue
from signals.features.lines import Meshing

MOST_NEIGHBOURS = 100
OneOrMore = Word | Annotated[tuple[Word, ...], Field(min_length=1, max_length=MOST_NEIGHBOURS)]
Origin = Literal["measured", "simulated"]
Id = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Weight = Annotated[FiniteFloat, Field(ge=0, le=1e6)]
EMPTY = "the library has no case to compare with: add labelled recordings or generate cases"
OF_ONE_AXIS = frozenset(definition.name for definition in Meshing.definitions)
"""Features that mean the same on one axis alone."""


class NeighbourQuery(Question):
    """Which cases are looked for, and what counts as near; leave out what does not matter."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"k": 3, "representation": "paper", "label": ["normal", "notch"], "weights": {"crest_factor_low": 4.0}}
            ]
        }
    )

    k: StrictInt = Field(5, ge=1, le=MOST_NEIGHBOURS, description="how many cases at most")
    representation: Literal["full", "paper"] = Field(
        "full",
        description="what is compared: all features with the weights that physics gives them, or the bands of the FFT "
        "and the crest factors of Olsson and Stolyarchuk's paper, each of the same weight",
    )
    weights: dict[str, Weight] = Field(
        {},
        max_length=1000,
        description="weights by the name of a feature, or by how names begin, instead of those of the representation; "
        "the longest beginning holds, and an empty one is of all features",
    )
    label: OneOrMore | None = Field(None, description="only cases with this label, or one of these")
    axis: OneOrMore | None = Field(None, description="only cases of this axis, or one of these")
    origin: Origin | Annotated[tuple[Origin, ...], Field(min_length=1, max_length=2)] | None = Field(
        None, description="only measured or only simulated cases"
    )
    gearbox: OneOrMore | None = Field(None, description="only cases of this gearbox, or one of these")
    min_similarity: Annotated[FiniteFloat, Field(ge=0, le=1)] = Field(
        0.0, description="only cases that are at least so similar"
    )
    recording_id: Id | None = Field(None, description="a stored recording to ask for, instead of a file")
    case_id: Id | None = Field(None, description="a case to ask for, instead of a file")

    @model_validator(mode="after")
    def _of_one(self) -> "NeighbourQuery":
        if self.recording_id and self.case_id:
            raise ValueError("recording_id and case_id are two recordings; ask for one")
        return self


class ContributionAnswer(BaseModel):
    """One feature in the distance to a case."""

    share: float = Field(description="of the squared distance, from 0 to 1")
    query: float = Field(description="its value in the recording [unit]")
    case: float | None = Field(description="its value in the case [unit]; null where that has none")
    unit: str


class NeighbourAnswer(BaseModel):
    """A case that was found."""

    case_id: str
    label: str
    origin: Origin
    axis: str | None
    gearbox: str | None
    distance: float = Field(description="1 is what one spread of the library in every feature would give")
    similarity: float = Field(description="1 / (1 + distance)")
    contributions: dict[str, ContributionAnswer] = Field(description="of the features compared, the largest first")


class RetrievalAnswer(BaseModel):
    """The nearest cases, the nearest first."""

    representation: str
    k: int
    features: list[str] = Field(description="features with a weight above 0")
    weights: dict[str, float] = Field(description="of these features, before they are brought to sum 1")
    neighbours: list[NeighbourAnswer]
    library_version: int
    remarks: list[str]
    quality: list[QualityDocument] = Field([], description="what weakens the recording")
    motion_period_s: float | None = Field(None, description="of the back and forth, given or found; null: none")


def neighbours_of(library: CaseLibrary, heard: DecodedRecording, query: NeighbourQuery) -> RetrievalAnswer:
    """Return the nearest cases of a recording that is not stored."""
    flags = [flag.reason for flag in heard.extraction.quality if flag.severity is not FlagLevel.NOTE]
    values = heard.extraction.features.values
    with library.reading() as session:
        found = _nearest(library, session, query, values, heard.description.axis, [*heard.remarks, *flags])
    quality = [QualityDocument.model_validate(flag) for flag in heard.extraction.quality]
    return found.model_copy(update={"quality": quality, "motion_period_s": heard.extraction.motion.period_s})


def neighbours_of_stored(library: CaseLibrary, query: NeighbourQuery) -> RetrievalAnswer:
    """Return the nearest cases of the recording or case that the query names, without those of the same sound.

    Raises:
        NotFoundError: if it is not there.
    """
    with library.reading() as session:
        if query.case_id:
            row = library.retrieve.case(session, query.case_id).recording
        else:
            row = library.retrieve.recording(session, query.recording_id or "")
        stored = library.retrieve.features(session, row)
        values = feature_values([stored.finite], [stored.missing])[0]
        found = _nearest(library, session, query, values, row.axis, [], without=row.sound_id)
    quality = [QualityDocument.model_validate(flag) for flag in row.quality]
    return found.model_copy(update={"quality": quality, "motion_period_s": stored.motion.get("period_s")})


def _nearest(
    library: CaseLibrary,
    session: Session,
    query: NeighbourQuery,
    values: NDArray[np.float32],
    axis: str | None,
    remarks: list[str],
    without: str | None = None,
) -> RetrievalAnswer:
    table, known = library.retrieve.table(session), catalogue()
    names = table.names or tuple(known)
    weights = weights_of(names, query.representation, query.weights)
    counting = {name: float(weight) for name, weight in zip(names, weights, strict=True) if weight > 0}
    if axis not in table.axes:
        values = np.where([name in OF_ONE_AXIS for name in names], np.float32(np.nan), values)
    where = _wanted(table, query) & (table.samples != without)
    matches: tuple[Match, ...] = ()
    if not len(table):
        remarks = [EMPTY]
    elif not np.isfinite(values[weights > 0]).any():
        remarks.append("the recording has none of the features that are to be compared")
    elif not where.any():
        remarks.append(
            f"no case fits what is asked for; the library has the labels {_some(table.classes)}, the axes "
            f"{_some(table.axes)} and the gearboxes {_some(table.gearboxes)}"
        )
    else:
        matches = library.retrieve.matrix(session, weights).search(values, query.k, where=where)
    levels = [name for name in counting if prior_of(name)[1] == LEVEL]
    if levels:
        remarks.append(f"{', '.join(levels)} follow the gain: compare cases of one recorder and one place of it alone")
    found = [_neighbour(table, match, values, weights, known) for match in matches]
    return RetrievalAnswer(
        representation=query.representation,
        k=query.k,
        features=list(counting),
        weights=counting,
        neighbours=[each for each in found if each.similarity >= query.min_similarity],
        library_version=table.version,
        remarks=remarks,
    )


def _wanted(table: CaseTable, query: NeighbourQuery) -> Mask:
    """Return which cases the filters let through, shape (cases,)."""
    where = np.ones(len(table), dtype=np.bool_)
    for column, only in (
        (table.labels, query.label),
        (table.axes, query.axis),
        (table.origins, query.origin),
        (table.gearboxes, query.gearbox),
    ):
        if only is not None:
            where &= np.isin(column, only)
    return where


def _some(words: Iterable[str]) -> str:
    return ", ".join(sorted({str(word) for word in words} - {""})[:10]) or "(none named)"


def _neighbour(
    table: CaseTable,
    match: Match,
    values: NDArray[np.float32],
    weights: Floats,
    known: dict[str, FeatureDefinition],
) -> NeighbourAnswer:
    parts = np.array(list(match.contributions.values()))
    compared = np.flatnonzero((weights > 0) & np.isfinite(values))
    case = table.values[match.row]
    return NeighbourAnswer(
        case_id=match.case_id,
        label=match.label,
        origin=match.origin,
        axis=str(table.axes[match.row]) or None,
        gearbox=str(table.gearboxes[match.row]) or None,
        distance=match.distance,
        similarity=1 / (1 + match.distance),
        contributions={
            table.names[index]: ContributionAnswer(
                share=parts[index] / match.distance if match.distance > 0 else 0.0,
                query=values[index],
                case=case[index] if np.isfinite(case[index]) else None,
                unit=known[table.names[index]].unit,
            )
            for index in compared[np.argsort(-parts[compared], kind="stable")].tolist()
        },
    )
