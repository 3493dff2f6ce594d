"""What a request asks to be investigated: an axis or a robot, described there or stored, and measured data of it."""

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from app.http.errors import TooLarge, Unprocessable
from app.http.uploads import Upload, UploadedFile
from app.investigations import Measured, Question, files_of, get_investigation, map_before, take_in, take_in_robot
from app.service import Service
from casebase.axes import find_axis, get_axis
from casebase.diagnoses import get_diagnosis
from casebase.store import revisions
from casebase.store.models import RobotRevision, StoredInvestigation
from signals.reading.documents import parse_foreign
from signals.telemetry import recognise_columns, recognise_joint_columns
from sim.description.axis import Axis
from sim.description.axis_document import parse_axis, read_axis
from sim.investigation.model.one_body import UNDESCRIBED
from sim.robot.foreign import ForeignRobot, check_foreign, foreign_robot
from sim.robot.robot import LARGEST_URDF_BYTES

PARTS = ("axis", "telemetry", "sound", "as_new", "sound_offset_s", "channels", "robot", "urdf", "diagnosis")
BLANK = re.compile(r"(?:(?<=[=,] )|(?<=\[))\.\.\.(?=[,}\]])")
"""What has to be filled in, in a channel map that was recognised."""


def asked_of(service: Service, upload: Upload) -> tuple[tuple[object, ...], Callable[[], Question]]:
    """Return what a form asks for, an investigation of an axis or of a robot: all that makes it the same as another
    request, and what takes it in.

    Raises:
        Unprocessable: if parts are missing or do not go together.
        AxisError: if the description of the axis or robot is wrong.
    """
    hashes = [(name, file.sha256) for name in PARTS for file in upload.all_of(name)]
    telemetry, sounds, as_new = (
        tuple(Measured(file.path, file.name) for file in upload.all_of(name))
        for name in ("telemetry", "sound", "as_new")
    )
    channels = upload.text("channels", service.settings.document_bytes).strip()
    mapped = [channels] if channels else []
    if {"robot", "urdf"} & {*upload.files, *upload.fields}:
        _refuse_sound(upload)
        robot = robot_of(service, upload)
        urdf = upload.file("urdf").name if "urdf" in upload.files else f"{robot.name}.urdf"
        take = partial(take_in_robot, service.library, robot, urdf, telemetry, channels)
        return (robot.document, robot.urdf, hashes, *mapped), take
    diagnosed = upload.fields.get("diagnosis", "").strip() or None
    if diagnosed is not None:
        sounds = (_recorded(service, upload, diagnosed),)
    axis = axis_of(service, upload)
    offset = offset_of(upload)
    take = partial(take_in, service.library, axis, telemetry, sounds, offset, as_new, channels, diagnosed)
    return (axis.to_mapping(), hashes, offset, *mapped, *([diagnosed] if diagnosed else [])), take


def given(upload: Upload, *parts: str) -> bool:
    """Whether a form has one of these parts."""
    return bool({*parts} & {*upload.files, *upload.fields})


def completed(service: Service, upload: Upload) -> Upload:
    """Return the form of the page with the stored axis or robot that was chosen there (`subject`), and with what it
    does not replace of the investigation that is asked for again."""
    upload = upload.filled()
    kind, _, name = upload.fields.pop("subject", "").partition("/")
    new = upload.fields.pop("new_name", "")
    if kind == "new" and new and not given(upload, "axis", "robot", "urdf"):
        with service.library.reading() as session:
            if find_axis(session, new) is not None:
                raise Unprocessable(f"There is an axis {new!r}: choose it from the list, or give another name.")
        upload.fields["axis"] = json.dumps({**UNDESCRIBED, "name": new})
    if name and not given(upload, "axis", "robot", "urdf"):
        upload.fields[kind] = name
    if again := upload.fields.pop("again", ""):
        with service.library.reading() as session:
            row = get_investigation(session, again)
        _put_back(service, upload, row)
    if given(upload, "robot", "urdf"):
        upload.fields.pop("sound_offset_s", None)
    return upload


def _put_back(service: Service, upload: Upload, row: StoredInvestigation) -> None:
    """Put the description and the files of an investigation where a form has no others."""
    parts = ["telemetry"]
    if not given(upload, "axis", "robot", "urdf"):
        upload.fields["robot" if row.robot else "axis"] = json.dumps(row.axis_document)
        parts.append("urdf")
    if not given(upload, "robot"):
        parts += ["as_new"] if row.diagnosis_id else ["sound", "as_new"]
    for part in parts:
        if part not in upload.files and (kept := files_of(row.inputs, part)):
            paths = [service.library.audio.whole(one["sha256"]) for one in kept]
            upload.files[part] = [
                UploadedFile(path, one["name"], "application/octet-stream", path.stat().st_size, one["sha256"])
                for path, one in zip(paths, kept, strict=True)
            ]


def offered(service: Service, upload: Upload) -> dict[str, object]:
    """Return what the columns of a log look like, and a channel map: that of the form, else that of the last log of the
    axis or robot if the columns are there, else what is recognised, with `""` for what is in `doubt`."""
    path = upload.file("telemetry").path
    found = recognise_columns(path)
    robot = robot_of(service, upload) if given(upload, "robot", "urdf") else None
    joints = [(joint.name, joint.ratio) for joint in robot.joints] if robot else []
    before, text = "", upload.text("channels", service.settings.document_bytes).strip()
    if not text and given(upload, "robot", "axis"):
        axis = None if robot else axis_of(service, upload).name
        with service.library.reading() as session:
            before = map_before(session, axis, robot.name if robot else None)
    map_, doubt = parse_foreign(text or before), ""
    if not text and not _fits(map_, [column["name"] for column in found.columns]):
        told = recognise_joint_columns(path, joints, {}) if len(joints) > 1 else found
        map_, doubt, before = parse_foreign(BLANK.sub('""', told.map)), told.open, ""
    answer = {"columns": found.columns, "map": map_, "doubt": doubt, "before": bool(before)}
    return {**answer, "joints": [name for name, _ in joints]}


def _fits(map_: Mapping[str, object], names: Sequence[str]) -> bool:
    """Whether a channel map names columns, and a table has all of them."""
    tables = [table["column"] for table in map_.values() if isinstance(table, Mapping) and "column" in table]
    named = [column for each in tables for column in (each if isinstance(each, list) else [each])]
    return bool(named) and all(one <= len(names) if isinstance(one, int) else one in names for one in named)


def _recorded(service: Service, upload: Upload, diagnosis_id: str) -> Measured:
    """Return the recording of a diagnosis as a sound; its axis is meant where the form has none."""
    if "sound" in upload.files:
        raise Unprocessable(
            "The parts 'diagnosis' and 'sound' do not go together: the diagnosis' recording is the sound."
        )
    with service.library.reading() as session:
        row = get_diagnosis(session, diagnosis_id).recording
    if row.erased_at is not None:
        raise Unprocessable(f"The recording of diagnosis {diagnosis_id} was erased; send a sound instead.")
    if row.axis and "axis" not in upload.files:
        upload.fields.setdefault("axis", row.axis)
    return Measured(service.library.retrieve.audio_path(row), row.file_name, row.channel)


def _refuse_sound(upload: Upload) -> None:
    if besides := sorted({"sound", "as_new", "sound_offset_s", "diagnosis"} & {*upload.files, *upload.fields}):
        raise Unprocessable(
            f"The part {besides[0]!r} does not go with a robot: sound is investigated with the axis of the joint that "
            "is heard; leave it out, or send 'axis' instead of 'robot'."
        )


def axis_of(service: Service, upload: Upload) -> Axis:
    """Return the axis of a request: TOML, JSON, or the name of a stored one.

    Raises:
        Unprocessable: if it is missing.
        AxisError: if the description is wrong or none of these.
    """
    if len(upload.all_of("axis")) > 1:
        raise Unprocessable("The form has the part 'axis' twice; one axis is investigated at a time, or a robot.")
    text = upload.text("axis", service.settings.document_bytes).strip()
    if not text:
        raise Unprocessable(
            "The form needs the part 'axis': an axis.toml, the same as JSON, or a stored axis' name; or, of a whole "
            "robot, the parts 'robot' (with 'urdf', or a stored one's name) and 'telemetry'."
        )
    if not any(mark in text for mark in "{=\n"):
        with service.library.reading() as session:
            return read_axis(get_axis(session, text).document)
    return read_axis(parse_axis(text))


def offset_of(upload: Upload) -> float:
    """Return the start of the sounds of a request after that of the telemetry [s].

    Raises:
        Unprocessable: if it is no number.
    """
    text = upload.fields.get("sound_offset_s", "")
    try:
        value = float(text or 0.0)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise Unprocessable(f"sound_offset_s must be a number of seconds, got {text[:40]!r}.")
    return value


def robot_of(service: Service, upload: Upload) -> ForeignRobot:
    """Return the robot of a request: described there, or stored under the name that it gives.

    Raises:
        Unprocessable: if a part is missing, or is one too many.
        NotFoundError: if no robot of that name is stored.
        SimulationError: if the description is wrong.
    """
    text = upload.text("robot", service.settings.document_bytes).strip()
    if not text:
        raise Unprocessable("The part 'urdf' belongs to a robot: send its robot.toml, or the same as JSON, as 'robot'.")
    if upload.fields.get("axis", "").strip():
        raise Unprocessable(
            "The parts 'axis' and 'robot' are one too many: send the axis alone, or the robot. An axis of one of its "
            "joints comes as a file, under the name that the joint gives, or as a table in the robot's description."
        )
    if any(mark in text for mark in "{=\n"):
        return described_robot(service, upload)
    if besides := sorted({"urdf", "axis"} & {*upload.files}):
        raise Unprocessable(
            f"The part {besides[0]!r} goes with a description, and 'robot' is the name of a stored robot, which has "
            "its own: leave one of them out."
        )
    with service.library.reading() as session:
        row = revisions.get(session, RobotRevision, text)
        return foreign_robot(row.document, row.urdf)


def described_robot(service: Service, upload: Upload) -> ForeignRobot:
    """Return the robot that the parts of a request describe.

    Raises:
        Unprocessable: if a part is missing.
        SimulationError: if the description is wrong.
    """
    limit = service.settings.document_bytes
    text = upload.text("robot", limit).strip()
    if not text:
        raise Unprocessable("The form needs the part 'robot': a robot.toml, or the same as JSON.")
    urdf = upload.file("urdf")
    if urdf.size > LARGEST_URDF_BYTES:
        raise TooLarge(f"The part 'urdf' has {urdf.size} bytes; it may have {LARGEST_URDF_BYTES}.")
    return check_foreign(text, urdf.path.read_bytes(), upload.texts("axis", limit))
