"""One case of a bundle, as its manifest says it: held to the same rules as a case that comes over HTTP."""

from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    JsonValue,
    StrictBool,
    StrictInt,
    StringConstraints,
)

from casebase.description import Labelling, RecordingDescription
from casebase.store.fields import AxisName, FileName, Label, Moment, Positive, Short, Text, Verification, Verified, Word
from signals.condition import OperatingCondition
from signals.motion_profile import MotionProfile

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Orders = Annotated[tuple[Annotated[FiniteFloat, Field(gt=0, le=1e9)], ...], Field(max_length=200)]
Times = Annotated[tuple[Annotated[FiniteFloat, Field(ge=-600, le=600)], ...], Field(max_length=10_000)]


class BundledCondition(BaseModel):
    """The operating condition; what is not known here is left out."""

    model_config = ConfigDict(frozen=True)

    speed_rad_s: Positive | None = None
    payload_kg_m2: Positive | None = None
    motion_period_s: Annotated[FiniteFloat, Field(ge=0.05, le=600)] | None = None
    reversal_times_s: Times = ()
    steady: StrictBool | None = None
    shaft_orders: Orders = ()
    mesh_orders: Orders = ()
    motion: MotionProfile | None = None


class BundledRecording(BaseModel):
    """How the recording was taken."""

    model_config = ConfigDict(frozen=True)

    file_name: FileName = "recording.wav"
    media_type: Short = "audio/wav"
    axis: AxisName | None = None
    gearbox: Word | None = None
    condition: BundledCondition = BundledCondition()
    recorded_at: Moment | None = None
    extra: Annotated[dict[Word, JsonValue], Field(max_length=200)] = {}

    def description(self) -> RecordingDescription:
        """The description that the library keeps. Raises ConditionError."""
        return RecordingDescription(
            file_name=self.file_name,
            media_type=self.media_type,
            axis=self.axis,
            gearbox=self.gearbox,
            condition=OperatingCondition(**vars(self.condition)),
            recorded_at=self.recorded_at,
            extra=dict(self.extra),
        )


class BundledCase(BaseModel):
    """A case; `audio` is the name of its sound in the bundle, None where it was erased."""

    model_config = ConfigDict(frozen=True)

    audio: Annotated[str, StringConstraints(min_length=1, max_length=200)] | None
    sha256: Sha256
    recording: BundledRecording
    label: Label
    channel: Annotated[StrictInt, Field(ge=0, le=63)] = 0
    origin: Literal["measured", "simulated"] = "measured"
    state: Literal["proposed", "confirmed", "retired"] = "confirmed"
    mechanism: Short | None = None
    location: Short | None = None
    severity: Positive | None = None
    parameters: Annotated[dict[Word, JsonValue], Field(max_length=200)] = {}
    model_version: Short | None = None
    verified_by: Verification | None = None
    verification: Verified | None = None
    quarantine_reason: Text | None = None
    note: Text | None = None
    key: Word | None = None

    def labelling(self, batch: str) -> Labelling:
        """What the recording is a case of."""
        carried = self.model_dump(exclude={"audio", "sha256", "recording", "channel"})
        return Labelling(batch=batch, **carried)
