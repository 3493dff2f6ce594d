"""What is said of a recording when it comes in: one strict document for HTTP, command line and bundles."""

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    StrictBool,
    StrictInt,
    StringConstraints,
    ValidationError,
    field_validator,
)

from app.http.errors import Unprocessable, validation_problem
from casebase.description import Labelling
from casebase.store.fields import AxisName, Label, Moment, Positive, Text, Verification, Verified, Word
from signals.condition import OperatingCondition

SCHEMA = "gearcase-recording/1"


class RecordingMetadata(BaseModel):
    """How a recording was taken, as far as it is known; leave out what is not known, we guess nothing."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        json_schema_extra={
            "examples": [{"axis": "axis-a", "gearbox": "g00", "speed_rad_s": 2.5, "payload_kg_m2": 40.0, "channel": 0}]
        },
    )

    axis: AxisName | None = Field(None, description="name of the axis, as in its description")
    gearbox: Word | None = Field(None, description="serial number of the gearbox")
    robot: Word | None = Field(None, description="name or serial number of the robot")
    unit: Annotated[str, StringConstraints(pattern=r"^[\x21-\x7e]{1,20}$")] = Field(
        "1", description="UCUM code of the samples; 1 for an uncalibrated microphone"
    )
    channel: StrictInt | None = Field(None, ge=0, le=63, description="which channel to use, counted from 0")
    speed_rad_s: Positive | None = Field(None, description="largest speed of the output [rad/s]")
    payload_kg_m2: Positive | None = Field(None, description="inertia carried by the output [kg m2]")
    motion_period_s: Annotated[FiniteFloat, Field(ge=0.05, le=600)] | None = Field(
        None, description="one full cycle of back and forth [s]"
    )
    reversal_times_s: tuple[Annotated[FiniteFloat, Field(ge=-600, le=600)], ...] | None = Field(
        None, max_length=10_000, description="standstills from the recording's start, in any order [s]"
    )
    steady: StrictBool | None = Field(None, description="true: constant speed; false: back and forth")
    temperature_degc: Annotated[FiniteFloat, Field(ge=-100, le=300)] | None = Field(
        None, description="of the gearbox [°C]"
    )
    recorded_at: Moment | None = Field(None, description="RFC 3339 with an offset, e.g. 2026-11-20T14:03:00+01:00")
    verified_by: Verification | None = Field(None, description="how the label was verified, e.g. gearbox opened")
    notes: Text | None = Field(None, description="anything else")

    @field_validator("recorded_at", mode="before")
    @classmethod
    def _only_text(cls, value: object) -> object:
        if value is not None and not isinstance(value, str):
            raise ValueError("must be text like 2026-11-20T14:03:00+01:00")
        return value

    @field_validator("reversal_times_s")
    @classmethod
    def _in_order(cls, times: tuple[float, ...] | None) -> tuple[float, ...] | None:
        return None if times is None else tuple(sorted(set(times)))

    def condition(
        self, shaft_orders: tuple[float, ...] = (), mesh_orders: tuple[float, ...] = ()
    ) -> OperatingCondition:
        """The operating condition, with the orders [per turn of the output] that the axis implies."""
        return OperatingCondition(
            speed_rad_s=self.speed_rad_s,
            payload_kg_m2=self.payload_kg_m2,
            motion_period_s=self.motion_period_s,
            reversal_times_s=self.reversal_times_s or (),
            steady=self.steady,
            shaft_orders=shaft_orders,
            mesh_orders=mesh_orders,
        )

    def description(self) -> dict[str, object]:
        """What was said, as JSON, without what was not."""
        return self.model_dump(mode="json", exclude_none=True)


class CaseMetadata(RecordingMetadata):
    """How a recording was taken, and its label."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"label": "notch", "axis": "axis-a", "gearbox": "g00", "verified_by": "gearbox opened"}]
        }
    )

    label: Label = Field(description="normal, notch, play, or any other label of the library")
    verification: Verified | None = Field(None, description="the same as `verified_by` in one word")
    state: Literal["proposed"] | None = Field(None, description="proposed: in no search until an admin releases it")
    size_rad: Positive | None = Field(
        None,
        description="measured gap of backlash (play) or depth of tooth damage (notch), at the driven gear [rad]",
    )

    def labelling(self) -> Labelling:
        """What the recording is a case of, as measured."""
        return Labelling(
            self.label,
            state=self.state or "confirmed",
            severity=self.size_rad,
            verified_by=self.verified_by,
            verification=self.verification,
            note=self.notes,
        )


def read_metadata(text: str, model: type[BaseModel], part: str = "metadata") -> Any:
    """Return the metadata of an upload, or what else a part of it says in JSON.

    Raises:
        Unprocessable: if it is no JSON object, or says something unknown or impossible; lists what is known.
    """
    try:
        return model.model_validate_json(text or "{}")
    except ValidationError as error:
        problem = validation_problem(error.errors(include_url=False), part)
        known = ", ".join(model.model_fields)
        raise Unprocessable(f"{problem.detail}. Known: {known}.", **problem.extras) from None
