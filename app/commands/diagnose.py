"""`gearcase diagnose FILE...`: one entry per file, failures included."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from app.commands.axis import MEANT as AXIS_MEANT
from app.commands.axis import METAVAR, axis_of
from app.commands.exit_codes import BAD_INPUT, DONE, FAULT_FOUND
from app.commands.faults import sentence
from app.commands.frame import ACTOR, Frame, Steady, frame_of
from app.commands.sounds import MEANT, Sound, sounds
from app.documents import DiagnosisAnswer
from app.recordings.intake import media_type_of, take_in
from app.recordings.metadata import RecordingMetadata
from app.report.formatting import sentence as sentence_of
from app.report.words import is_poor, names_fault, remarks_beside, verdict_of
from casebase.labels import BASELINES
from casebase.library import CaseLibrary
from signals.errors import SignalError
from sim.description.axis import Axis


def register(app: typer.Typer) -> None:
    app.command("diagnose")(diagnose)


def diagnose(
    context: typer.Context,
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=MEANT)],
    axis: Annotated[str | None, typer.Option(metavar=METAVAR, help=AXIS_MEANT)] = None,
    speed: Annotated[float | None, typer.Option(help="largest speed of the output [rad/s]")] = None,
    payload: Annotated[float | None, typer.Option(help="inertia carried by the output [kg m2]")] = None,
    period: Annotated[float | None, typer.Option(help="one full cycle of the motion [s]")] = None,
    steady: Steady = None,
    gearbox: Annotated[str | None, typer.Option(help="serial number of the gearbox")] = None,
    channel: Annotated[int | None, typer.Option(help="channel to use, from 0")] = None,
    fail_on: Annotated[Literal["fault"] | None, typer.Option(help="end with 3 if a fault is found")] = None,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Diagnose recordings against the local library."""
    frame = frame_of(context)
    metadata = RecordingMetadata(
        speed_rad_s=speed,
        payload_kg_m2=payload,
        motion_period_s=period,
        steady=steady,
        gearbox=gearbox,
        channel=channel,
    )
    described = axis_of(frame, axis) if axis else None
    entries = []
    with (
        frame.library() as library,
        frame.progress() as progress,
        sounds(files, frame.settings.upload_bytes) as found,
    ):
        for sound in progress.track(found, description="diagnosing"):
            entries.append(_entry(library, sound, metadata, described))
    if json:
        frame.print_json(entries)
    else:
        _show(frame, entries)
    raise typer.Exit(_code(entries, fail_on))


def _entry(library: CaseLibrary, sound: Sound, metadata: RecordingMetadata, axis: Axis | None) -> dict[str, Any]:
    if sound.problem:
        return {"file": sound.shown, "error": sound.problem}
    try:
        intake = take_in(library, sound.path, sound.name, media_type_of(sound.name), metadata, axis)
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


def _show(frame: Frame, entries: list[dict[str, Any]]) -> None:
    for entry in entries:
        if "error" in entry:
            frame.print(f"{entry['file']}: failed: {entry['error']}")
            continue
        words, first = verdict_of(entry), _first(entry)
        if first:
            frame.print(f"{entry['file']}: {' '.join(map(sentence_of, first))}")
            told = list(words.told) == entry["remarks"]
            frame.print(f"  {words.headline}.{'' if told else f' {words.summary}'}")
        else:
            frame.print(f"{entry['file']}: {words.headline}. {words.summary}")
        for flag in entry["quality"]:
            if flag["reason"] not in first:
                frame.print(f"  {flag['severity']}, {flag['name'].replace('_', ' ')}: {flag['reason']}")
        for remark in remarks_beside(entry):
            if remark not in first:
                frame.print(f"  note: {remark}")
        if is_poor(entry):
            frame.print(f"  next: {words.checks[0]}")
