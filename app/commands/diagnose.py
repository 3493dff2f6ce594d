"""`gearcase diagnose FILE...`, one entry per file, failures included; `gearcase retrieve FILE`, nothing stored."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from app.commands import BAD_INPUT, DONE, FAULT_FOUND, frame
from app.commands.faults import sentence
from app.commands.frame import ACTOR, AXIS, Channel, Gearbox, Json, Payload, Period, Speed, Steady
from app.documents import DiagnosisAnswer
from app.recordings.intake import Log, RecordingMetadata, decoded, hear, media_type_of, take_in
from app.recordings.neighbours import MOST_NEIGHBOURS, NeighbourAnswer, NeighbourQuery, neighbours_of
from app.recordings.sound_files import MEANT, Sound, sounds
from app.report.formatting import sentence as sentence_of
from app.report.words import is_poor, names_fault, remarks_beside, verdict_of
from casebase.labels import BASELINES
from casebase.library import CaseLibrary
from signals.errors import SignalError
from signals.features import feature_words
from signals.reading.plain_file import plain_bytes
from signals.reading.text import text_of
from sim.description.axis import Axis

SHOWN_FEATURES = 3


def diagnose(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=MEANT)],
    axis: Annotated[str | None, AXIS] = None,
    speed: Speed = None,
    payload: Payload = None,
    period: Period = None,
    steady: Steady = None,
    gearbox: Gearbox = None,
    channel: Channel = None,
    telemetry: Annotated[
        Path | None, typer.Option(help="table of the same motion beside one FILE; its angle says the motion")
    ] = None,
    channels: Annotated[Path | None, typer.Option(help="channel map of the telemetry")] = None,
    fail_on: Annotated[Literal["fault"] | None, typer.Option(help="end with 3 if a fault is found")] = None,
    json: Json = False,
) -> None:
    """Diagnose recordings against the local library."""
    metadata = RecordingMetadata(
        speed_rad_s=speed,
        payload_kg_m2=payload,
        motion_period_s=period,
        steady=steady,
        gearbox=gearbox,
        channel=channel,
    )
    if (telemetry is not None and len(files) != 1) or (channels is not None and telemetry is None):
        raise typer.BadParameter("--telemetry goes with one FILE, and --channels with --telemetry")
    described = frame.axis_of(axis) if axis else None
    log = None if telemetry is None else Log(telemetry, text_of(plain_bytes(channels)) if channels else None)
    limit = frame.settings().upload_bytes
    with frame.library() as library, frame.progress() as progress, sounds(files, limit) as found:
        entries = [
            _entry(library, one, metadata, described, log) for one in progress.track(found, description="diagnosing")
        ]
    frame.answer(json, entries, *(line for entry in entries for line in _lines(entry)))
    raise typer.Exit(_code(entries, fail_on))


def _entry(
    library: CaseLibrary, sound: Sound, metadata: RecordingMetadata, axis: Axis | None, log: Log | None
) -> dict[str, Any]:
    if sound.problem:
        return {"file": sound.shown, "error": sound.problem}
    try:
        intake = take_in(library, sound.path, sound.name, media_type_of(sound.name), metadata, axis, log)
    except (SignalError, OSError) as error:
        return {"file": sound.shown, "error": sentence(error)}
    with library.transaction(ACTOR) as session:
        found = DiagnosisAnswer.of(intake.diagnose(library, session))
    return {"file": sound.shown, **found.model_dump(mode="json")}


def is_fault(entry: dict[str, Any]) -> bool:
    """Whether a diagnosis finds a fault, or is undecided with normal less probable than all others together."""
    if "verdict" not in entry:
        return False
    normal = sum(each["probability"] for each in entry["hypotheses"] if each["label"] in BASELINES)
    return names_fault(entry) or (entry["verdict"] == "ambiguous" and normal < 0.5)


def _code(entries: list[dict[str, Any]], fail_on: str | None) -> int:
    if fail_on == "fault" and any(is_fault(entry) for entry in entries):
        return FAULT_FOUND
    return BAD_INPUT if any("error" in entry for entry in entries) else DONE


def _first(entry: dict[str, Any]) -> list[str]:
    """What stands before the answer: why a recording is too short, and all remarks where one label at most is known."""
    short = [flag["reason"] for flag in entry["quality"] if flag["name"].startswith("too_short")]
    limited = short or entry["verdict"] == "unusable" or len(entry["hypotheses"]) < 2
    return [*short, *entry["remarks"]] if limited else []


def _lines(entry: dict[str, Any]) -> list[str]:
    if "error" in entry:
        return [f"{entry['file']}: failed: {entry['error']}"]
    words, first = verdict_of(entry), _first(entry)
    if first:
        summary = "" if list(words.told) == entry["remarks"] else f" {words.summary}"
        lines = [f"{entry['file']}: {' '.join(map(sentence_of, first))}", f"  {words.headline}.{summary}"]
    else:
        lines = [f"{entry['file']}: {words.headline}. {words.summary}"]
    lines += [
        f"  {flag['severity']}, {flag['name'].replace('_', ' ')}: {flag['reason']}"
        for flag in entry["quality"]
        if flag["reason"] not in first
    ]
    lines += [f"  note: {remark}" for remark in remarks_beside(entry) if remark not in first]
    return [*lines, f"  next: {words.checks[0]}"] if is_poor(entry) else lines


def retrieve(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="sound file: WAV, FLAC, phone formats")],
    k: Annotated[int, typer.Option("--k", min=1, max=MOST_NEIGHBOURS, metavar="N", help="how many cases")] = 5,
    representation: Annotated[
        Literal["full", "paper"], typer.Option(help="all features, or FFT bands and crest factors as in the paper")
    ] = "full",
    weight: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="of a feature, or of all whose names begin so; may come again"),
    ] = None,
    label: Annotated[
        list[str] | None, typer.Option(metavar="LABEL", help="only cases with this label; may come again")
    ] = None,
    origin: Annotated[Literal["measured", "simulated"] | None, typer.Option(help="only such cases")] = None,
    of_axis: Annotated[list[str] | None, typer.Option(metavar="NAME", help="only cases of this axis")] = None,
    of_gearbox: Annotated[list[str] | None, typer.Option(metavar="NAME", help="only cases of this gearbox")] = None,
    axis: Annotated[str | None, AXIS] = None,
    speed: Speed = None,
    payload: Payload = None,
    period: Period = None,
    steady: Steady = None,
    channel: Channel = None,
    json: Json = False,
) -> None:
    """Find the cases of the local library that are nearest to a recording, and why they are near.

    Nothing is stored. --axis, --speed, --payload, --period and --steady say how the recording was taken; --label,
    --origin, --of-axis and --of-gearbox which cases may be found.
    """
    query = NeighbourQuery.model_validate(
        {
            "k": k,
            "representation": representation,
            "weights": dict(_weight(each) for each in weight or ()),
            "label": label or None,
            "origin": origin,
            "axis": of_axis or None,
            "gearbox": of_gearbox or None,
        }
    )
    metadata = RecordingMetadata(
        speed_rad_s=speed, payload_kg_m2=payload, motion_period_s=period, steady=steady, channel=channel
    )
    described = frame.axis_of(axis) if axis else None
    recording = decoded(file, metadata, described)
    with frame.library() as library:
        heard = hear(library, recording, file.name, media_type_of(file.name), metadata, described)
        found = neighbours_of(library, heard, query)
    rows = [
        (str(rank), one.label, one.origin, one.gearbox or "-", f"{one.distance:.3f}", _differences(one))
        for rank, one in enumerate(found.neighbours, 1)
    ]
    columns = ("rank", "label", "origin", "gearbox", "distance", "differs most in")
    nearest = [frame.table(columns, rows)] if rows else []
    frame.answer(json, found.model_dump(mode="json"), *nearest, *found.remarks)


def _weight(given: str) -> tuple[str, str]:
    name, equals, value = given.rpartition("=")
    if not equals:
        raise typer.BadParameter(f"--weight {given}: write NAME=VALUE, such as crest_factor=2")
    return name, value


def _differences(neighbour: NeighbourAnswer) -> str:
    first = list(neighbour.contributions.items())[:SHOWN_FEATURES]
    return "; ".join(f"{feature_words(name)} {part.share:.0%}" for name, part in first)
