"""Investigations: measured data of an axis or a robot come in, a job looks for what the model misses.

An investigation and its job have the same id. Files are kept by their content like recordings, so that a worker on
another process finds them, and so that an investigation can be done again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import select
from sqlalchemy.orm import Session, defer

from app.jobs.job import Job, JobError, JobKind, JobNotFoundError, Json, Report
from app.jobs.jobs import Jobs
from app.recordings.intake import read_sound
from app.report.investigation_report import investigation_report
from casebase.axes import add_axis, find_axis
from casebase.description import check_name
from casebase.errors import ConflictError, NotFoundError
from casebase.library import CaseLibrary
from casebase.store import audit, revisions
from casebase.store.audio_store import Content
from casebase.store.models import AxisRevision, RobotRevision, StoredInvestigation, new_id, now
from signals.columns.joint_maps import LoggedJoint, read_joint_maps
from signals.errors import SignalError
from signals.reading.decode import read_recording
from signals.reading.documents import parse_foreign
from signals.recording import Recording
from signals.telemetry import Telemetry, check_telemetry, read_telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.errors import AxisError, SimulationError
from sim.investigation.data.pairing import check_as_new, check_pairs
from sim.investigation.report.comparison import Row, Value, findings_compared, values_compared
from sim.robot.foreign import ForeignRobot, foreign_robot, kept_robot

if TYPE_CHECKING:
    from sim.investigation.pooling.joint_investigation import Together
    from sim.investigation.results import Investigation
    from sim.robot.results import RobotInvestigation

KIND = "investigations"
ACTOR = "investigator"
MOST_COMPARABLE = 50
PARTS = ("telemetry", "sound", "as_new", "urdf")
"""What an investigation keeps files of; one with a URDF is of a robot."""


@dataclass(frozen=True)
class Measured:
    """One file of measured data, where it is now and what it was called."""

    path: Path
    name: str
    channel: int | None = None


@dataclass(frozen=True)
class Question:
    """What is to be investigated: an axis or a robot (the name of either), and measured data that is kept."""

    axis: str | None
    robot: str | None
    description: Mapping[str, object]
    inputs: Mapping[str, object]
    contents: Sequence[Content]


def take_in(
    library: CaseLibrary,
    axis: Axis,
    telemetries: Sequence[Measured],
    sounds: Sequence[Measured],
    sound_offset_s: float = 0.0,
    as_new: Sequence[Measured] = (),
    channels: str = "",
    diagnosis_id: str | None = None,
) -> Question:
    """Check and read what was measured; it takes a while, so no transaction may be open.

    The k-th sound belongs to the k-th telemetry; with sound alone, `as_new` is what it is compared with.
    `channels`: text of the channel map by which every telemetry is read. `diagnosis_id`: whose recording the sound is.

    Raises:
        AxisError: if there is nothing to investigate, a channel map without telemetry, a sound without its telemetry,
            the same telemetry twice, or a sound that is compared with itself.
        SignalError: if telemetry or sound cannot be read; of several it begins with the name of the file.
    """
    check_pairs(len(telemetries), len(sounds), len(as_new), channel_map=bool(channels))
    check_name("axis.name", axis.name)
    check = partial(check_telemetry, channels=channels or None)
    for measured in telemetries:
        _readable(measured, check, several=len(telemetries) > 1)
    for measured in (*sounds, *as_new):
        _readable(measured, partial(read_sound, channel=measured.channel), several=len(sounds) + len(as_new) > 1)
    contents: list[Content] = []
    inputs: dict[str, object] = {"sound_offset_s": sound_offset_s} | ({"channels": channels} if channels else {})
    inputs |= {} if diagnosis_id is None else {"diagnosis_id": diagnosis_id}
    if telemetries:
        files = [_read(library, measured, contents) for measured in telemetries]
        _refuse_twice(files)
        inputs["telemetry"] = files if len(files) > 1 else files[0]
    for part, heard in (("sound", sounds), ("as_new", as_new)):
        if heard:
            inputs[part] = [_read(library, measured, contents) for measured in heard]
    check_as_new(*([str(one["sha256"]) for one in files_of(inputs, part)] for part in ("sound", "as_new")))
    return Question(axis.name, None, axis.to_mapping(), inputs, contents)


def take_in_robot(
    library: CaseLibrary,
    robot: ForeignRobot,
    urdf: str,
    telemetries: Sequence[Measured],
    channels: str = "",
) -> Question:
    """Check and read what was measured of a robot's joints; as `take_in` for an axis. `urdf`: what that was called.

    Raises:
        AxisError: if there is no telemetry, or the same twice.
        SignalError: if the channel map does not fit the joints, or telemetry cannot be read; with the joint's name.
    """
    if not telemetries:
        raise AxisError("nothing to investigate: a robot needs telemetry of its joints")
    check_name("robot.name", robot.name)
    check = partial(_checked_joints, joints=robot.joints, channels=channels or None)
    for measured in telemetries:
        _readable(measured, check, several=len(telemetries) > 1)
    contents = [library.audio.content(robot.urdf.encode())]
    links = {"name": urdf[-255:], "sha256": contents[0].sha256, "suffix": Path(urdf).suffix.lower()}
    files = [_read(library, measured, contents) for measured in telemetries]
    _refuse_twice(files)
    inputs: dict[str, object] = {"urdf": links, "telemetry": files if len(files) > 1 else files[0]}
    inputs |= {"channels": channels} if channels else {}
    return Question(None, robot.name, robot.document, inputs, contents)


def _checked_joints(path: Path, joints: Sequence[LoggedJoint], channels: str | None) -> None:
    maps, _ = read_joint_maps(path, joints, channels, parse_foreign)
    for joint, map_ in zip(joints, maps, strict=True):
        try:
            check_telemetry(path, channels=map_)
        except SignalError as error:
            raise type(error)(f"{joint.name}: {error}") from error


def submit(library: CaseLibrary, session: Session, jobs: Jobs, question: Question) -> Job:
    """Store what is asked with its files, and order its job in the same transaction; both have the same id."""
    row = StoredInvestigation(
        id=new_id(),
        axis=question.axis,
        robot=question.robot,
        axis_document=dict(question.description),
        inputs=dict(question.inputs),
        created_by=audit.actor_of(session),
    )
    row.job_id = row.id
    session.add(row)
    session.flush()
    for content in question.contents:
        library.audio.keep(session, content)
    asked = {("robot" if row.robot else "axis"): row.subject, **question.inputs}
    audit.record(session, "investigation.asked", ("investigation", row.id), after=asked)
    files = [name for part in PARTS for name in names_of(row, part)]
    parameters: dict[str, Json] = {"investigation_id": row.id, "about": ", ".join([str(row.subject), *files])}
    return jobs.order(session, KIND, parameters, job_id=row.id, submitted_by=row.created_by)


def _readable(measured: Measured, read: Callable[[Path], object], *, several: bool) -> None:
    try:
        read(measured.path)
    except SignalError as error:
        if not several:
            raise
        raise type(error)(f"{measured.name}: {error}") from error


def _refuse_twice(files: Sequence[Mapping[str, object]]) -> None:
    names: dict[object, object] = {}
    for one in files:
        if one["sha256"] in names:
            raise AxisError(
                f"telemetry {one['name']} is the same file as {names[one['sha256']]}: send every recording once, "
                "since the same one twice says no more"
            )
        names[one["sha256"]] = one["name"]


def _read(library: CaseLibrary, measured: Measured, contents: list[Content]) -> dict[str, object]:
    contents.append(library.audio.content(measured.path))
    suffix = Path(measured.name).suffix.lower()
    file: dict[str, object] = {"name": measured.name[-255:], "sha256": contents[-1].sha256, "suffix": suffix}
    return file if measured.channel is None else {**file, "channel": measured.channel}


def get_investigation(session: Session, investigation_id: str) -> StoredInvestigation:
    """Return an investigation; raises NotFoundError."""
    row = session.get(StoredInvestigation, investigation_id)
    if row is None:
        raise NotFoundError(f"no investigation has the id {investigation_id!r}")
    return row


def state_of(row: StoredInvestigation, jobs: Callable[[], Jobs]) -> str:
    """Return how far an investigation is: of one that is not finished, what its job says.

    Args:
        jobs: opens the jobs, which only an unfinished investigation needs.
    """
    if row.document is not None or row.error is not None:
        return row.state
    try:
        return jobs().get(row.job_id or row.id).state
    except JobNotFoundError:
        return row.state


def document_of(row: StoredInvestigation, state: str | None = None) -> Mapping[str, object]:
    """Return the document of a finished investigation.

    Args:
        state: as `state_of` gives it, to be said of one that is not finished.

    Raises:
        ConflictError: if it is not finished, or failed; says which.
    """
    if row.document is None:
        unfinished = f"is {state or 'not finished'}; follow the job {row.job_id}"
        raise ConflictError(f"investigation {row.id} " + (f"failed: {row.error}" if row.error else unfinished))
    return row.document


def accept(library: CaseLibrary, session: Session, row: StoredInvestigation) -> AxisRevision | RobotRevision:
    """Store the extended axis or robot as its next revision; accepting it twice makes one revision.

    The first revision of what is new here is the description as it was given.

    Raises:
        ConflictError: if it is not finished, or found nothing that would extend the model.
    """
    document = document_of(row)
    extended = document.get("extended_axis")
    if document.get("verdict") != "named" or not isinstance(extended, dict) or not extended:
        raise ConflictError(
            f"investigation {row.id} names nothing that would extend the model (verdict: {document.get('verdict')}); "
            f"change the description itself with POST /{'robots' if row.robot else 'axes'}"
        )
    given, accepted = f"as described for investigation {row.id}", f"accepted investigation {row.id}"
    if row.robot:
        (urdf,) = _paths(library, row, "urdf")
        robot = foreign_robot(row.axis_document, urdf.read_text(encoding="utf-8"))
        if revisions.find(session, RobotRevision, robot.name) is None:
            add_robot(session, robot, note=given)
        return add_robot(session, robot, document=extended, note=accepted, investigation_id=row.id)
    axis = read_axis(extended)
    if find_axis(session, axis.name) is None:
        add_axis(session, axis.name, row.axis_document, note=given)
    return add_axis(session, axis.name, axis.to_mapping(), note=accepted, investigation_id=row.id)


def add_robot(
    session: Session,
    robot: ForeignRobot,
    *,
    document: Mapping[str, object] | None = None,
    note: str | None = None,
    investigation_id: str | None = None,
) -> RobotRevision:
    """Store a robot, or another `document` of it, as the next revision of its name; the same again is no new one."""
    content = {"document": dict(robot.document if document is None else document), "urdf": robot.urdf}
    return revisions.add(session, RobotRevision, robot.name, content, note=note, investigation_id=investigation_id)


def investigations(library: CaseLibrary) -> JobKind:
    """The job kind, for one library."""

    return JobKind(
        KIND,
        "investigating",
        plan=lambda parameters: [parameters],
        run=lambda task, report: perform(library, str(task["investigation_id"]), report),
        finish=lambda _, results: results[0],
        priority=1,
    )


def perform(library: CaseLibrary, investigation_id: str, report: Report) -> Json:
    """Do an investigation and keep document and report; what is done already stays as it is.

    Raises:
        JobError: if the data cannot be investigated, in the words of the investigation.
    """
    with library.reading() as session:
        row = get_investigation(session, investigation_id)
    if row.error is not None:
        raise JobError(row.error)
    if row.document is not None:
        return {"investigation_id": investigation_id, "verdict": str(row.document["verdict"])}
    try:
        found = _investigated(library, row, report)
    except (SimulationError, SignalError) as error:
        _finish(library, investigation_id, error=str(error))
        raise JobError(str(error)) from error
    _finish(library, investigation_id, document=found[0], report=found[1])
    return {"investigation_id": investigation_id, "verdict": str(found[0]["verdict"])}


def _investigated(library: CaseLibrary, row: StoredInvestigation, report: Report) -> tuple[dict[str, object], str]:
    channels: Any = row.inputs.get("channels")
    named = list(zip(names_of(row, "telemetry"), _paths(library, row, "telemetry"), strict=True))
    found: Investigation | Together | RobotInvestigation
    if row.robot:
        from sim.robot.investigation import investigate_robot  # only a worker pays for importing what investigates
        from sim.robot.motion import read_log

        (urdf,) = _paths(library, row, "urdf")
        robot = kept_robot(row.axis_document, urdf.read_bytes())
        logs = [replace(read_log(robot, path, channels), name=name) for name, path in named]
        found = investigate_robot(robot, logs, report)
    else:
        telemetry = [(name, read_telemetry(path, channels=channels)) for name, path in named]
        sounds, as_new = (_sounds(library, row, part) for part in ("sound", "as_new"))
        offset_s: Any = row.inputs.get("sound_offset_s", 0.0)
        found = investigated(read_axis(row.axis_document), telemetry, sounds, as_new, float(offset_s), report)
    document, page = reported(found, [name for part in ("urdf", *PARTS[:3]) for name in names_of(row, part)])
    return json.loads(json.dumps(document, allow_nan=False)), page


def investigated(
    axis: Axis,
    telemetry: Sequence[tuple[str, Telemetry]],
    sounds: Sequence[Recording],
    as_new: Sequence[Recording],
    sound_offset_s: float,
    progress: Report,
) -> Investigation | Together:
    """Hold measured data of an axis against its description; several recordings of named telemetry together."""
    from sim.investigation.investigate import investigate
    from sim.investigation.pooling.joint_investigation import investigate_together
    from sim.investigation.pooling.pooled_estimates import NamedRecording

    if len(telemetry) < 2:
        only = telemetry[0][1] if telemetry else None
        return investigate(axis, only, sounds, progress, sound_offset_s, as_new)
    pairs = zip_longest(telemetry, sounds)
    recordings = [NamedRecording(name, one, sound, sound.name if sound else None) for (name, one), sound in pairs]
    return investigate_together(axis, recordings, progress, sound_offset_s)


def reported(
    found: Investigation | Together | RobotInvestigation, files: Sequence[str]
) -> tuple[dict[str, object], str]:
    """Return the document of an investigation with its story, and its report as one HTML file.

    Args:
        files: names of what was measured; several recordings of an axis have theirs.
    """
    from sim.investigation.pooling.joint_investigation import Together
    from sim.investigation.report.summary import parts_together, story, story_together
    from sim.robot.report import parts_of_robot, robot_story
    from sim.robot.results import RobotInvestigation

    parts: list[tuple[str, dict[str, object]]] = []
    if isinstance(found, RobotInvestigation):
        axis, told, parts = None, robot_story(found), parts_of_robot(found)
    elif isinstance(found, Together):
        axis, told, parts = found.combined.axis, story_together(found), parts_together(found)
        files = [part.recording.name for part in found.parts]
    else:
        axis, told = found.axis, story(found)
    document = {**found.document(), "story": told}
    return document, investigation_report(document, axis, files, parts)


def files_of(inputs: Mapping[str, object], part: str) -> list[Mapping[str, Any]]:
    """Return the files of one of `PARTS` as an investigation's inputs name them."""
    kept: Any = inputs.get(part, [])
    return kept if isinstance(kept, list) else [kept]


def names_of(row: StoredInvestigation, part: str) -> list[str]:
    """Return what the files of `telemetry`, `sound` or `as_new` were called, in order."""
    return [str(one["name"]) for one in files_of(row.inputs, part)]


@dataclass(frozen=True)
class Compared:
    """Two investigations of one axis or robot, the earlier first, and what became of what was found."""

    before: StoredInvestigation
    after: StoredInvestigation
    rows: Sequence[Row]
    values: Sequence[Value]

    @property
    def other_description(self) -> bool:
        """Whether they were held against different descriptions."""
        return self.before.axis_document != self.after.axis_document


def compared(session: Session, first: str, second: str) -> Compared:
    """Hold two finished investigations of one axis or robot against each other.

    Raises:
        NotFoundError: if there is no such investigation.
        ConflictError: if one is not finished, or they are of different axes.
    """
    rows = [get_investigation(session, one) for one in (first, second)]
    before, after = sorted(rows, key=lambda row: (row.created_at, row.id))
    if (before.axis, before.robot) != (after.axis, after.robot):
        raise ConflictError(
            f"investigation {before.id} is of {before.subject!r} and {after.id} of {after.subject!r}; "
            "two of the same axis or robot can be compared"
        )
    documents = document_of(before), document_of(after)
    return Compared(before, after, findings_compared(*documents), values_compared(*documents))


def comparable(session: Session, row: StoredInvestigation) -> Sequence[StoredInvestigation]:
    """Return other finished investigations of the same axis or robot, newest first, their documents left out."""
    same = (
        StoredInvestigation.axis == row.axis if row.robot is None else StoredInvestigation.robot == row.robot,
        StoredInvestigation.state == "done",
        StoredInvestigation.id != row.id,
    )
    return session.scalars(
        select(StoredInvestigation)
        .options(defer(StoredInvestigation.document))
        .where(*same)
        .order_by(StoredInvestigation.id.desc())
        .limit(MOST_COMPARABLE)
    ).all()


def map_before(session: Session, axis: str | None, robot: str | None) -> str:
    """Return the channel map by which the last log of an axis or a robot was read; empty where none was."""
    channels = StoredInvestigation.inputs["channels"].as_string()
    same = StoredInvestigation.axis == axis if robot is None else StoredInvestigation.robot == robot
    asked = select(channels).where(same, channels.is_not(None), StoredInvestigation.error.is_(None))
    return session.scalar(asked.order_by(StoredInvestigation.id.desc()).limit(1)) or ""


def investigations_from(session: Session, diagnosis_id: str) -> Sequence[StoredInvestigation]:
    """Return the investigations that were started from a diagnosis, newest first."""
    started = StoredInvestigation.inputs["diagnosis_id"].as_string() == diagnosis_id
    return session.scalars(select(StoredInvestigation).where(started).order_by(StoredInvestigation.id.desc())).all()


def _sounds(library: CaseLibrary, row: StoredInvestigation, part: str) -> list[Recording]:
    return [
        replace(read_recording(library.audio.whole(str(one["sha256"])), channel=one.get("channel")), name=one["name"])
        for one in files_of(row.inputs, part)
    ]


def _paths(library: CaseLibrary, row: StoredInvestigation, part: str) -> list[Path]:
    return [library.audio.whole(str(one["sha256"])) for one in files_of(row.inputs, part)]


def _finish(
    library: CaseLibrary,
    investigation_id: str,
    *,
    document: dict[str, object] | None = None,
    report: str | None = None,
    error: str | None = None,
) -> None:
    with library.transaction(ACTOR) as session:
        row = get_investigation(session, investigation_id)
        row.state = "failed" if error else "done"
        row.document, row.report, row.error, row.finished_at = document, report, error, now()
        verdict = {"error": error} if document is None else {"verdict": document["verdict"]}
        audit.record(session, "investigation.finished", ("investigation", row.id), after=verdict)
