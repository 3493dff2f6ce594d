"""What goes over the edge: pydantic models of requests and answers, SI units named in the keys."""

from collections.abc import Callable, Collection, Iterator
from datetime import UTC, datetime
from inspect import get_annotations
from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, TypeVar, get_args

from fastapi import Path, Query
from pydantic import MISSING, AfterValidator, AwareDatetime, BaseModel, ConfigDict, Field, model_validator
from sqlalchemy.orm import Session

from app.http.keys import Role
from casebase.axes import is_axis, unknown_axis
from casebase.store.fields import Label, Positive, Text, Verification, Verified, Word
from casebase.store.models import ApiKey, AuditEntry, AxisRevision, Base, Case, StoredDiagnosis, StoredRecording
from casebase.store.pagination import Page
from signals.reading.text import is_whole
from signals.recording_quality.quality import DISTURBANCES

Row = TypeVar("Row")
Document = TypeVar("Document")

Identifier = Annotated[str, Path(pattern=r"^[0-9a-f]{32}$", description="as answered by the call that made it")]
Limit = Annotated[int, Query(ge=1, le=200, description="items per page")]
CONTINUES = "next_cursor of the page before"
Cursor = Annotated[
    str | None,
    Query(description=CONTINUES, json_schema_extra={"pattern": r"^[0-9a-f]{32}$"}),
]


Filter = Annotated[str | None, Query(max_length=200, pattern=r"^[^\x00]*$", description="only those with exactly this")]
OriginFilter = Annotated[
    Literal["measured", "simulated"] | None, Query(description="only what was measured, or only what was simulated")
]
Instant = Annotated[AwareDatetime, AfterValidator(lambda time: time.astimezone(UTC))]


class Answer(BaseModel):
    """An answer, read from the attributes of a row.

    `of` a table it has all columns but those named in `without`; what it states itself counts.
    """

    model_config = ConfigDict(from_attributes=True)

    def __init_subclass__(cls, of: type[Base] | None = None, without: Collection[str] = (), **options: Any) -> None:
        super().__init_subclass__(**options)
        if of is not None:
            names = [column.key for column in of.__mapper__.column_attrs if column.key not in without]
            hints = {name: hint for base in reversed(of.__mro__) for name, hint in get_annotations(base).items()}
            kinds = {name: get_args(hints[name])[0] for name in names}
            times = {datetime: Instant, datetime | None: Instant | None}
            columns = {name: times.get(kind, kind) for name, kind in kinds.items()}
            cls.__annotations__ = {**columns, **get_annotations(cls)}

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


class Question(BaseModel):
    """A JSON request: what is not known here is refused rather than ignored."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _whole(cls, given: object) -> object:
        for text in _texts(given):
            if not is_whole(text):
                raise ValueError(f"{NOT_WHOLE}; got {text[:60]!a}")
        return given


NOT_WHOLE = "a text must have whole characters: no NUL, and no half of a surrogate pair such as \\ud83d without \\ude00"


def _texts(given: object) -> Iterator[str]:
    """Yield every text of a JSON document, keys too, however deep it nests."""
    waiting = [given]
    while waiting:
        value = waiting.pop()
        if isinstance(value, str):
            yield value
        elif isinstance(value, dict):
            waiting += [*value.keys(), *value.values()]
        elif isinstance(value, list):
            waiting += value


class PageOf(BaseModel, Generic[Document]):
    """One page of a list; ask again with `cursor` = `next_cursor` until it is null."""

    items: list[Document]
    next_cursor: str | None


class PageFound(PageOf[Document], Generic[Document]):
    """One page of what a filter finds."""

    remark: str | None = Field(None, description="why nothing is found, where the filter names an axis that is nowhere")


def page_of(page: Page[Row], convert: Callable[[Row], Document]) -> PageOf[Document]:
    return PageOf(items=[convert(row) for row in page.items], next_cursor=page.next_cursor)


def page_found(session: Session, axis: str | None, page: PageOf[Document]) -> PageFound[Document]:
    """Return a page, with a remark where it is empty since nobody knows the axis that was asked for."""
    nowhere = axis is not None and not page.items and not is_axis(session, axis)
    remark = unknown_axis(session, axis) if axis is not None and nowhere else None
    return PageFound(items=page.items, next_cursor=page.next_cursor, remark=remark)


class KeyRequest(Question, json_schema_extra={"examples": [{"name": "test bench 3", "role": "operator"}]}):
    name: Word = Field(description="whose key it is")
    role: Role = Field(description="a viewer reads, an operator diagnoses, an admin does all")


class KeyAnswer(Answer, of=ApiKey, without=("key_sha256",)):
    """A key as the list shows it: never the key itself."""

    role: Role


class NewKey(KeyAnswer):
    key: str | None = Field(description="the key itself, this once; null when an Idempotency-Key is repeated")


class AuditAnswer(Answer, of=AuditEntry):
    """Who did what to which, with what it was and became."""


class AxisAnswer(Answer, of=AxisRevision, without=("investigation_id",)):
    """One revision of an axis description."""


class RobotAnswer(AxisAnswer):
    """One revision of a robot's description; the axes of its joints stand in it. Its URDF is asked for by itself."""


class QualityDocument(Answer):
    """Something that weakens what can be said of a recording."""

    name: str
    severity: Literal["note", "poor", "unusable"]
    reason: str
    start_s: float | None = Field(None, description="from the start of the recording; null: the whole recording")
    end_s: float | None = None


class DisturbanceDocument(BaseModel):
    """Something in a recording that is not the machine, or that the recorder did to it."""

    kind: str = Field(description="what it is", json_schema_extra={"enum": list(DISTURBANCES)})
    start_s: float = Field(description="from the start of the recording")
    end_s: float
    severity: Literal["info", "poor"] = Field(description="info: left out or harmless; poor: no label is relied on")


class RecordingAnswer(Answer, of=StoredRecording, without=("fingerprint", "sound")):
    """A recording, how it was taken, and where its plots and sound are."""

    quality: list[QualityDocument]
    sound_id: str = Field(description="the same for recordings of one sound, whatever their container, rate or gain")
    erased_at: Instant | None = Field(description="since when the audio is not kept any more")


class ErasedAnswer(Answer):
    """What was erased: the sound in every file that it came in."""

    id: str
    erased_at: Instant
    erased_by: str
    recordings: list[str] = Field(description="ids of all recordings of this sound or of its files: all are erased")


class CaseAnswer(Answer, of=Case, without=("key", "recording_id", "library_version")):
    """A recording with a label: what the library knows."""

    origin: Literal["measured", "simulated"]
    state: Literal["proposed", "confirmed", "retired"]
    verification: Verified | None
    recording: RecordingAnswer


FOUND = {"label": "notch", "verified_by": "gearbox opened", "verification": "opened"}


class CaseFromDiagnosis(Question, json_schema_extra={"examples": [{"diagnosis_id": "0" * 32, **FOUND}]}):
    """A case made of a diagnosis that somebody has verified."""

    diagnosis_id: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$", description="which diagnosis")]
    label: Label | None = Field(None, description="by default what the diagnosis was confirmed or corrected to")
    verified_by: Verification | None = Field(None, description="how it was verified; by default as the diagnosis says")
    verification: Verified | None = Field(None, description="the same in one word; by default as the diagnosis says")


class CaseChange(Question, json_schema_extra={"examples": [{"state": "retired", "note": "the microphone was loose"}]}):
    """What to change; leave out what stays. `state` retired takes a case out of every search, confirmed back in."""

    label: Label | MISSING = Field(MISSING, description="what the recording is a case of")
    state: Literal["proposed", "confirmed", "retired"] | MISSING = Field(
        MISSING, description="only confirmed ones count"
    )
    verified_by: Verification | MISSING | None = Field(MISSING, description="how the label was verified")
    verification: Verified | MISSING | None = Field(MISSING, description="the same in one word")
    note: Text | MISSING | None = Field(MISSING, description="anything else")
    mechanism: Word | MISSING | None = Field(MISSING, description="of the simulator, such as tooth_damage")
    location: Word | MISSING | None = Field(MISSING, description="gear or shaft where the fault is")
    severity: Positive | MISSING | None = Field(MISSING, description="size of the fault at the driven gear [rad]")
    quarantine_reason: Text | MISSING | None = Field(MISSING, description="why it is not searched; null: it is")


class DiagnosisChange(Question, json_schema_extra={"examples": [{"verdict": "corrected", **FOUND}]}):
    """What a person found: it was right, was another fault, or cannot be used; `open` takes that back."""

    verdict: Literal["confirmed", "corrected", "rejected", "open"] = Field(description="what a person found")
    label: Label | None = Field(None, description="the right label; needed for corrected")
    verified_by: Verification | None = Field(None, description="how it was verified, e.g. gearbox opened")
    verification: Verified | None = Field(None, description="the same in one word")
    note: Text | None = Field(None, description="anything else")


class Revision(BaseModel):
    """What became of a diagnosis: `open` until a person says more."""

    state: Literal["open", "confirmed", "corrected", "rejected"]
    label: str | None
    verified_by: str | None
    verification: Verified | None
    note: str | None
    by: str | None
    at: Instant | None


class Support(BaseModel):
    """How many of the nearest cases carry the label, by origin."""

    measured: int
    simulated: int


class HypothesisDocument(BaseModel):
    """One label and what speaks for it."""

    label: str
    probability: float
    p_value: float
    support: Support


class FaultDocument(BaseModel):
    """A fault that is present, with its probability."""

    label: str
    probability: float


class FaultPresence(BaseModel):
    """Whether there is a fault at all, whichever it is."""

    present: bool | None = Field(description="null where that is undecided or not known")
    probability: float | None = Field(description="null where the library has no normal case, or no case like it")


class NeighbourDocument(BaseModel):
    """A case near to the recording; the contributions of the features add up to the distance."""

    model_config = ConfigDict(extra="allow")

    case_id: str
    label: str
    origin: Literal["measured", "simulated"]
    distance: float
    contributions: dict[str, float]


class Novelty(BaseModel):
    """How unlike the cases of the leading label it is, and where the unknown begins (null: too few gearboxes)."""

    distance: float | None = Field(description="-log10 of how often a recording of that label is as unlike its cases")
    threshold: float | None = Field(description="-log10 of the p-value below which it is not in the library")


class DiagnosisAnswer(BaseModel):
    """What a recording is, by the library; not knowing is an answer too."""

    model_config = ConfigDict(extra="allow")

    id: str
    verdict: Literal["diagnosed", "ambiguous", "not_in_library", "unusable"]
    label: str | None
    probability: float | None
    fault: FaultPresence | None = Field(
        None, description="whether there is a fault, also where its label is undecided; null in earlier diagnoses"
    )
    labels: list[str] | None = Field(
        None,
        description="the labels that cannot be excluded at 10 %: nine times in ten the right one is among them; null "
        "in earlier diagnoses",
    )
    hypotheses: list[HypothesisDocument]
    neighbours: list[NeighbourDocument]
    faults: list[FaultDocument] = Field([], description="every fault that is present, the most probable first")
    detection_limit: dict[str, dict[str, float] | None] = Field(
        {}, description="the smallest fault of each kind that would be heard [rad]; null where that cannot be said"
    )
    evidence: list[dict[str, object]]
    disturbances: list[DisturbanceDocument] = Field(
        [], description="what was left out or disturbs; empty in diagnoses from before they were looked for"
    )
    quality: list[QualityDocument]
    novelty: Novelty
    remarks: list[str]
    recording: dict[str, object]
    provenance: dict[str, object]
    revision: Revision
    created_at: Instant
    created_by: str

    @classmethod
    def of(cls, row: StoredDiagnosis) -> "DiagnosisAnswer":
        revision = Revision(
            state=row.state,
            label=row.revised_label,
            verified_by=row.verified_by,
            verification=row.verification,
            note=row.note,
            by=row.revised_by,
            at=row.revised_at,
        )
        about = {"revision": revision, "created_at": row.created_at, "created_by": row.created_by}
        return cls.model_validate({**row.document, **about})


class ProportionDocument(BaseModel):
    """A share with its 95 % interval (Wilson); null of nothing."""

    value: float | None
    right: int
    of: int
    low: float
    high: float


class FiguresDocument(BaseModel):
    """What of an evaluation tells whether simulated cases help or harm."""

    accuracy: ProportionDocument
    known_called_new: ProportionDocument
    left_out_class_called_new: dict[str, ProportionDocument]


class EvaluationAnswer(BaseModel):
    """The library's own cross-validation: what it says of each group when that group is left out."""

    model_config = ConfigDict(extra="allow")

    group: str
    origin: str
    cases: int = Field(description="cases that were diagnosed without their group")
    known_cases: int = Field(0, description="cases that the library was evaluated by: all, or 20,000 of a larger one")
    gearboxes: int = Field(description="distinct measured gearboxes behind the numbers")
    right_means: str = Field(description="what counts as right, in accuracy, per class and on confusion's diagonal")
    accuracy: ProportionDocument
    accuracy_when_diagnosed: ProportionDocument
    known_called_new: ProportionDocument
    per_class: dict[str, ProportionDocument]
    confusion: dict[str, dict[str, int]] = Field(description="true label -> answered label -> cases")
    cells: dict[str, dict[str, list[str]]] = Field(description="the ids of the cases of each cell")
    left_out_class_called_new: dict[str, ProportionDocument]
    without_simulated: FiguresDocument | None = Field(
        description="the same cases by the measured ones alone; null unless there are simulated cases beside them"
    )
