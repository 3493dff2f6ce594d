"""A recording comes in: decoded in the limited worker, its features taken, what was said of it kept.

What is said of it is one strict document for HTTP, command line and bundles.
"""

import math
import tomllib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    StrictBool,
    StrictInt,
    StringConstraints,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from sqlalchemy.orm import Session

from app.http.errors import Unprocessable, validation_problem
from app.settings import settings_of
from casebase.axes import find_axis, list_axes
from casebase.description import Labelling, RecordingDescription, check_name
from casebase.library import CaseLibrary
from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.plausibility import Expected, Known, held_against
from casebase.store.audio_store import Content
from casebase.store.fields import AxisName, Label, Moment, Positive, Text, Verification, Verified, Word, is_ahead
from casebase.store.models import StoredDiagnosis, StoredRecording
from signals.columns.column_names import meaning_of
from signals.condition import OperatingCondition
from signals.errors import ConditionError, TelemetryError
from signals.features import Extraction, extract
from signals.measured_motion import measured_motion
from signals.motion import CONTRADICTS
from signals.motion_profile import MotionProfile
from signals.reading.decode import LIMITS, read_recording
from signals.recording import Recording
from signals.recording_quality.disturbances import survey
from signals.telemetry import CHANNELS, Telemetry, read_telemetry, recognise_columns
from sim.description.axis import Axis
from sim.description.axis_document import read_axis

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
    motion: Annotated[MotionProfile | None, WithJsonSchema(TypeAdapter(MotionProfile).json_schema())] = Field(
        None, description="the course of back and forth: rad and s at the output; a sine has no acceleration_time_s"
    )
    steady: StrictBool | None = Field(None, description="true: constant speed; false: back and forth")
    temperature_degc: Annotated[FiniteFloat, Field(ge=-100, le=300)] | None = Field(
        None, description="of the gearbox [°C]"
    )
    recorded_at: Moment | None = Field(
        None, description="RFC 3339 with an offset, such as 2026-11-20T14:03:00+01:00; not in the future"
    )
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

    @model_validator(mode="after")
    def _no_contradiction(self) -> Self:
        for name, value in ({} if self.motion is None else self.motion.condition()).items():
            given = getattr(self, name)
            if given is not None and differs(given, value):
                raise ValueError(f"{name} is {shown(given)}, but {shown(value)} by `motion`: leave one of them out")
        return self

    def condition(
        self, shaft_orders: tuple[float, ...] = (), mesh_orders: tuple[float, ...] = ()
    ) -> OperatingCondition:
        """The operating condition, with the orders [per turn of the output] that the axis implies."""
        given = {each.name: getattr(self, each.name, None) for each in fields(OperatingCondition)}
        known = {name: value for name, value in given.items() if value is not None}
        implied = {} if self.motion is None else self.motion.condition()
        return OperatingCondition(**{**implied, **known, "shaft_orders": shaft_orders, "mesh_orders": mesh_orders})

    def description(self) -> dict[str, object]:
        """What was said, as JSON, without what was not."""
        return self.model_dump(mode="json", exclude_none=True)


def differs(one: object, other: object) -> bool:
    """Whether two values are not the same, or two numbers differ by more than a given and a heard period may."""
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) > CONTRADICTS * max(abs(one), abs(other))
    return one != other


def shown(value: object) -> str:
    """Return a value for a sentence."""
    if isinstance(value, tuple):
        return f"{len(value)} times"
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower()


def heard_apart_s(recording: Recording, condition: OperatingCondition) -> float:
    """Return how far given reversals lie from those that are heard, where that is too far for one clock [s]; else 0.

    Where no reversals are heard, or with another period, nothing is said against the given ones.
    """
    surveyed = survey(recording, replace(condition, reversal_times_s=()))
    motion, period_s = surveyed.analysis.motion, condition.motion_period_s or 0.0
    heard, given = np.array(motion.reversal_times_s), np.array(condition.reversal_times_s) - surveyed.start_s
    if not given.size or motion.period_in_sound_s is None or differs(motion.period_in_sound_s, period_s):
        return 0.0
    apart_s = float(np.median(np.abs(heard[:, None] - given).min(axis=0)))
    return apart_s if apart_s > max(period_s / 20, 0.1) else 0.0


def superseded(typed: OperatingCondition, measured: Mapping[str, Any]) -> tuple[str, ...]:
    """Say what was typed of a motion and is something else by the telemetry, one sentence each."""
    pairs = [(name, getattr(typed, name), value) for name, value in measured.items() if name != "motion"]
    for name in ("kind", "stroke_rad", "acceleration_time_s") if measured and typed.motion else ():
        pairs.append((f"motion.{name}", getattr(typed.motion, name), getattr(measured["motion"], name)))
    return tuple(
        f"{name} is {shown(value)} by the telemetry, so the {shown(given)} that was given is not used"
        for name, given, value in pairs
        if given not in (None, ()) and differs(given, value)
    )


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


OUTPUT_ANGLES = ("load_position_rad", "motor_position_rad")
CONTRADICTED = "contradicted"
"""Key of what was typed of a recording and is not used."""

KEEPERS = ThreadPoolExecutor(4, thread_name_prefix="keeper")
"""Waiting for the disk takes no processor: bytes are made durable while features are computed."""


@dataclass(frozen=True)
class Log:
    """Telemetry beside a recording; it begins with the sound, unless its clock says another moment of the sound.

    Args:
        channels: text of a channel map, where its columns need one.
    """

    path: Path
    channels: str | None = None

    def condition(self, axis: Axis | None, duration_s: float) -> Mapping[str, Any]:
        """Return what the operating condition of a recording of so many seconds has of it.

        Raises:
            TelemetryError: if it cannot be read, has no angle of the output, or no motion back and forth.
        """
        try:
            log = read_telemetry(self.path, channels=self.channels or angles_recognised(self.path))
            motion = measured_motion(log.time_s, output_angle(log, axis))
        except (TelemetryError, ConditionError) as error:
            raise TelemetryError(f"telemetry: {error}") from None
        return motion.condition(log.first_s if -log.duration_s < log.first_s < duration_s else 0.0, duration_s)


def angles_recognised(path: Path) -> str | None:
    """Return the channel map of clock and angles, where these are recognised; what a current needs is not asked for.

    None where the channels have their own names, or the table does not tell enough of an angle either.

    Raises:
        TelemetryError: if an angle may be of the motor or of the output.
    """
    clock, angles = [], {}
    for line in recognise_columns(path).map.splitlines():
        name = line.split(" ", 1)[0]
        if name in OUTPUT_ANGLES and "..." not in line:
            angles[name] = line
        elif name not in CHANNELS:
            clock.append(line)
    if [*angles] == ["motor_position_rad"]:
        column = tomllib.loads(angles["motor_position_rad"])["motor_position_rad"]["column"]
        meaning = meaning_of(str(column))
        if meaning is not None and not meaning.side:
            raise TelemetryError(
                f"the column {column!r} may be an angle of the motor or of the output: call it motor_position_rad or "
                "load_position_rad, or send a channel map"
            )
    text = "\n".join([*clock, *angles.values()])
    return text if angles and "..." not in text else None


def output_angle(log: Telemetry, axis: Axis | None) -> NDArray[np.float64]:
    """Return the angle of the output, shape (n,) [rad]; raises TelemetryError where it has none."""
    if "load_position_rad" in log:
        return log["load_position_rad"]
    if axis is not None and "motor_position_rad" in log:
        return log["motor_position_rad"] / axis.ratio
    raise TelemetryError(
        "it has no angle of the output: load_position_rad, or motor_position_rad and an axis that is described are "
        f"needed; it has {', '.join(log.channels)}"
    )


@dataclass(frozen=True)
class DecodedRecording:
    """A recording, its features and how it was taken; nothing of it is stored.

    Args:
        remarks: what of its description limits an answer, one sentence each.
    """

    recording: Recording
    extraction: Extraction
    description: RecordingDescription
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Intake(DecodedRecording):
    """A recording on its way into the library; the file that it came in must be there until it is stored."""

    content: Content
    reasoner: Reasoner | None = None
    """What diagnoses it, once that is fitted."""

    def fitted(self, library: CaseLibrary) -> "Intake":
        """Return it with what diagnoses it, made before a transaction begins that keeps others from writing."""
        with library.reading() as session:
            reasoner = library.reuse.fitted(session, self.description.axis, self.description.gearbox)
        return replace(self, reasoner=reasoner)

    def store(self, library: CaseLibrary, session: Session) -> StoredRecording:
        return library.retain.recording(session, self.content, self.recording, self.extraction, self.description)

    def diagnose(self, library: CaseLibrary, session: Session) -> StoredDiagnosis:
        row = self.store(library, session)
        return library.reuse.diagnose(session, row, self.extraction, self.remarks, self.reasoner)


MEDIA_TYPES = {
    ".wav": "audio/wav",
    ".flac": "audio/flac",
    ".aif": "audio/aiff",
    ".aiff": "audio/aiff",
    ".caf": "audio/x-caf",
    ".mp3": "audio/mpeg",
    ".m4a": "audio/mp4",
    ".mp4": "video/mp4",
    ".mov": "video/quicktime",
    ".3gp": "video/3gpp",
    ".aac": "audio/aac",
    ".amr": "audio/amr",
    ".ogg": "audio/ogg",
    ".oga": "audio/ogg",
    ".opus": "audio/ogg",
    ".mka": "audio/x-matroska",
    ".mkv": "video/x-matroska",
    ".webm": "video/webm",
    ".wma": "audio/x-ms-wma",
}


def media_type_of(file_name: str) -> str:
    """The media type that a file's name says: sound, video or plain bytes."""
    return MEDIA_TYPES.get(Path(file_name).suffix.lower(), "application/octet-stream")


def when_recorded(recording: Recording, said: datetime | None) -> tuple[datetime | None, tuple[str, ...]]:
    """Return when a sound was recorded, what was said before what the recorder's clock says, and a remark on it.

    A clock without an offset is taken to be that of the site (`GEARCASE_TIME_ZONE`); one that is ahead says nothing.
    """
    clock = recording.source.recorded_at
    if said is not None or clock is None:
        return said, ()
    zone = settings_of().time_zone
    when = clock if clock.tzinfo is not None else clock.replace(tzinfo=ZoneInfo(zone))
    shown = f"the recorder's clock said {clock:%Y-%m-%d %H:%M:%S}"
    if is_ahead(when):
        return None, (f"{shown}, which lies in the future, so it is not known when this was recorded",)
    if when is clock:
        return when, ()
    return when, (f"{shown} without an offset, which was taken as time of {zone}",)


def orders_of(axis: Axis | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return turns of each shaft, and engagements of each mesh with known teeth, per turn of the output, motor first.

    Of an unknown axis there are none.
    """
    if axis is None:
        return (), ()
    shafts = tuple(axis.ratio_from(shaft) for shaft in ("motor", *(stage.name for stage in axis.stages)))
    teeth = [(stage.name, stage.driven_teeth) for stage in axis.stages if stage.driven_teeth is not None]
    return shafts, tuple(count * axis.ratio_from(name) for name, count in teeth)


def condition_on(
    axis: Axis,
    speed_rad_s: float | None = None,
    payload_kg_m2: float | None = None,
    motion_period_s: float | None = None,
) -> OperatingCondition:
    """Return the operating condition of a recording of a described axis."""
    shaft_orders, mesh_orders = orders_of(axis)
    return OperatingCondition(
        speed_rad_s=speed_rad_s,
        payload_kg_m2=payload_kg_m2,
        motion_period_s=motion_period_s,
        shaft_orders=shaft_orders,
        mesh_orders=mesh_orders,
    )


def known_axis(library: CaseLibrary, name: str | None) -> Axis | None:
    """The current description of an axis, or None where only its name is known."""
    if name is None:
        return None
    with library.reading() as session:
        row = find_axis(session, name)
    return None if row is None else read_axis(row.document)


def expected(library: CaseLibrary, axis: Axis | None, name: str | None) -> Expected:
    """What an axis' description and the library's measured cases of it say of its motion."""
    name = name or (axis.name if axis else None)
    with library.reading() as session:
        cases = library.retrieve.measured(session, name) if name else Expected()
    if axis is None:
        return cases
    source = f"the description of {axis.name!r}"

    def known(value: float) -> Known:
        return Known(value, value, source)

    motion, load, limit = axis.motion, axis.load.inertia_kg_m2, axis.motor.speed_limit_rad_s
    described = Expected(
        speed_rad_s=known(motion.load_speed_rad_s) if axis.describes_motion("load_speed_rad_s") else None,
        payload_kg_m2=known(load) if load > 0 else None,
        motion_period_s=known(motion.period_s) if axis.describes_motion("period_s") else None,
        top_speed_rad_s=limit / axis.ratio if math.isfinite(limit) else None,
        ratio=axis.ratio,
    )
    return described.joined(cases)


def read_sound(path: Path, *, channel: int | None = None) -> Recording:
    """Decode a file that comes in, as `read_recording` does; lossy ones only if the installation takes them."""
    return read_recording(path, channel=channel, limits=replace(LIMITS, lossy=settings_of().accept_lossy))


def take_in(
    library: CaseLibrary,
    path: Path,
    name: str,
    media_type: str,
    metadata: RecordingMetadata,
    axis: Axis | None = None,
    log: Log | None = None,
) -> Intake:
    """Decode a file, take its features and, meanwhile, read its bytes; see `hear`."""
    recording = decoded(path, metadata, axis)
    keeping = KEEPERS.submit(library.audio.content, path)
    try:
        heard = hear(library, recording, name, media_type, metadata, axis, log)
    finally:
        content = keeping.result()
    return Intake(**vars(heard), content=content)


def decoded(path: Path, metadata: RecordingMetadata, axis: Axis | None = None) -> Recording:
    """Decode a file in the limited worker.

    Raises:
        SignalError: what is wrong with the file, as `read_recording` says.
    """
    if axis is not None:
        check_name("name of the axis", axis.name)
    return replace(read_sound(path, channel=metadata.channel), unit=metadata.unit)


def hear(
    library: CaseLibrary,
    recording: Recording,
    name: str,
    media_type: str,
    metadata: RecordingMetadata,
    axis: Axis | None = None,
    log: Log | None = None,
) -> DecodedRecording:
    """Take the features of a recording and what is known of how it was taken; nothing is stored.

    What sound, axis or library contradict of the condition is not used: it stands under `contradicted` in the
    description, and a flag says why.

    Args:
        axis: its description; by default the library's for the name in the metadata, where it has one.
        log: what it says of the motion is used, whatever was typed.

    Raises:
        SignalError: what its description or its telemetry has wrong, as `extract` and `Log.condition` say.
    """
    axis = axis or known_axis(library, metadata.axis)
    typed = metadata.condition(*orders_of(axis))
    measured = {} if log is None else log.condition(axis, recording.duration_s)
    condition = replace(typed, **measured)
    extraction = extract(recording, condition)
    late_s = 0.0 if log is None else heard_apart_s(recording, condition)
    if late_s:
        measured = {name: value for name, value in measured.items() if name != "reversal_times_s"}
        condition = replace(typed, **measured)
        extraction = extract(recording, condition)
    stated = typed.speed_rad_s or typed.payload_kg_m2 or typed.motion_period_s
    known = expected(library, axis, metadata.axis) if stated else Expected()
    doubtful = replace(condition, speed_rad_s=None, motion_period_s=None) if measured else condition
    usable, doubts = held_against(doubtful, extraction.motion, known)
    usable = replace(usable, **measured)
    if usable.speed_rad_s is None or usable.motion_period_s is None:
        usable = replace(usable, motion=None)
    if doubts:
        extraction = extract(recording, usable)
        extraction = replace(extraction, quality=(*extraction.quality, *doubts))
    extra = metadata.model_dump(
        mode="json", include={"robot", "temperature_degc", "notes", "verified_by"}, exclude_none=True
    )
    used = asdict(usable)
    unused = {name: value for name, value in asdict(typed).items() if value not in (None, ()) and value != used[name]}
    extra |= {CONTRADICTED: unused} if unused else {}
    if recording.source.device is not None:
        extra["device"] = recording.source.device
    recorded_at, remarks = when_recorded(recording, metadata.recorded_at)
    remarks += superseded(typed, measured)
    if late_s:
        remarks += (f"the reversals of the telemetry lie {late_s:.2g} s from those that are heard, which are used",)
    description = RecordingDescription(
        file_name=name,
        media_type=media_type,
        axis=metadata.axis or (axis.name if axis else None),
        gearbox=metadata.gearbox,
        condition=usable,
        recorded_at=recorded_at,
        extra=extra,
    )
    if axis is None:
        remarks += unknown_axis(library, metadata.axis)
    elif usable.motion is not None:
        from sim.experiment.motion_limits import not_covered  # slow to import

        remarks += not_covered(axis, usable.motion, usable.payload_kg_m2)
    return DecodedRecording(recording, extraction, description, remarks)


def unknown_axis(library: CaseLibrary, name: str | None) -> tuple[str, ...]:
    """Say what an axis without a description costs, and which ones are described; nothing where none was named."""
    if name is None:
        return ()
    with library.reading() as session:
        known = [row.name for row in list_axes(session)]
    described = f"described are {', '.join(known[:10])}" if known else "none is described yet (POST /api/v1/axes)"
    return (f"no axis is described as {name!r}, so features of its shafts and meshes are missing; {described}",)
