"""`gearcase cases add | list | export | import | review`."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from app.commands.axis import MEANT as AXIS_MEANT
from app.commands.axis import METAVAR, axis_of
from app.commands.exit_codes import BAD_INPUT
from app.commands.faults import sentence
from app.commands.frame import ACTOR, Json, Steady, frame_of
from app.commands.review import review
from app.commands.sounds import MEANT, Sound, sounds
from app.documents import CaseAnswer
from app.recordings.intake import media_type_of, take_in
from app.recordings.metadata import CaseMetadata
from casebase.errors import DuplicateError, LibraryError
from casebase.library import CaseLibrary
from casebase.search.case_filter import CaseFilter
from casebase.store.bundle import export_cases, import_cases
from casebase.store.counter import library_version
from casebase.store.fields import Verified
from signals.errors import SignalError
from sim.description.axis import Axis

cases = typer.Typer(help="Add, list, export and import cases.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    cases.command("review")(review)
    app.add_typer(cases, name="cases")


@cases.command()
def add(
    context: typer.Context,
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=MEANT)],
    label: Annotated[str, typer.Option(help="normal, notch, play or any other")],
    axis: Annotated[str | None, typer.Option(metavar=METAVAR, help=AXIS_MEANT)] = None,
    gearbox: Annotated[str | None, typer.Option(help="serial number of the gearbox")] = None,
    speed: Annotated[float | None, typer.Option(help="largest speed of the output [rad/s]")] = None,
    payload: Annotated[float | None, typer.Option(help="inertia carried by the output [kg m2]")] = None,
    period: Annotated[float | None, typer.Option(help="one full cycle of the motion [s]")] = None,
    steady: Steady = None,
    channel: Annotated[int | None, typer.Option(help="channel to use, from 0")] = None,
    verified_by: Annotated[str | None, typer.Option(help="how the label was verified")] = None,
    verification: Annotated[Verified | None, typer.Option(help="the same in one word")] = None,
    size: Annotated[
        float | None,
        typer.Option(help="measured gap of backlash (play) or depth of tooth damage (notch), at the driven gear [rad]"),
    ] = None,
    json: Json = False,
) -> None:
    """Add labelled recordings.

    Each file that cannot be added is named with the reason.

    A sound that is a case already, in whatever container, rate or gain, is not added again.
    """
    frame = frame_of(context)
    metadata = CaseMetadata(
        label=label,
        gearbox=gearbox,
        speed_rad_s=speed,
        payload_kg_m2=payload,
        motion_period_s=period,
        steady=steady,
        channel=channel,
        verified_by=verified_by,
        verification=verification,
        size_rad=size,
    )
    described = axis_of(frame, axis) if axis else None
    entries = []
    limit = frame.settings.upload_bytes
    with frame.library() as library, frame.progress() as progress, sounds(files, limit) as found:
        for sound in progress.track(found, description="adding"):
            entries.append(_add(library, sound, metadata, described))
    if json:
        frame.print_json(entries)
    else:
        for entry in entries:
            frame.print(f"{entry['file']}: {entry.get('error') or entry['id']}{_known(entry)}{_simulated(entry)}")
    raise typer.Exit(BAD_INPUT if any("error" in entry for entry in entries) else 0)


def _known(entry: dict[str, Any]) -> str:
    return " is a case with this sound already; nothing was changed" if entry.get("exists") else ""


def _simulated(entry: dict[str, Any]) -> str:
    return "; its sound is simulated, so this is a simulated case" if entry.get("origin") == "simulated" else ""


def _add(library: CaseLibrary, sound: Sound, metadata: CaseMetadata, axis: Axis | None) -> dict[str, Any]:
    if sound.problem:
        return {"file": sound.shown, "error": sound.problem}
    try:
        intake = take_in(library, sound.path, sound.name, media_type_of(sound.name), metadata, axis)
        with library.transaction(ACTOR) as session:
            before = library_version(session)
            row = intake.store(library, session)
            case = library.retain.case(session, row, metadata.labelling())
            known = case.library_version <= before
            return {"file": sound.shown, "exists": known, **CaseAnswer.model_validate(case).model_dump(mode="json")}
    except DuplicateError as error:
        there = {"id": error.case_id, "label": error.label, "gearbox": error.gearbox}
        return {"file": sound.shown, "error": sentence(error), "case": there}
    except (SignalError, LibraryError, OSError) as error:
        return {"file": sound.shown, "error": sentence(error)}


@cases.command("list")
def list_(
    context: typer.Context,
    label: str | None = None,
    origin: str | None = None,
    axis: str | None = None,
    gearbox: str | None = None,
    state: str | None = None,
    verification: Verified | None = None,
    limit: Annotated[int, typer.Option(min=1, help="how many, newest first")] = 1000,
    json: Json = False,
) -> None:
    """Show the cases, newest first."""
    frame = frame_of(context)
    wanted = CaseFilter(label=label, origin=origin, axis=axis, gearbox=gearbox, state=state, verification=verification)
    with frame.library() as library:
        found = _first(library, wanted, limit)
    if json:
        frame.print_json([case.model_dump(mode="json") for case in found])
        return
    table = Table("id", "label", "origin", "state", "axis", "gearbox", "file")
    for case in found:
        taken = case.recording
        table.add_row(
            case.id, case.label, case.origin, case.state, taken.axis or "-", taken.gearbox or "-", taken.file_name
        )
    frame.results.print(table)


def _first(library: CaseLibrary, wanted: CaseFilter, limit: int) -> list[CaseAnswer]:
    found: list[CaseAnswer] = []
    cursor: str | None = None
    with library.reading() as session:
        while len(found) < limit:
            page = library.retrieve.cases(session, wanted, limit=min(500, limit - len(found)), cursor=cursor)
            found += [CaseAnswer.model_validate(case) for case in page.items]
            cursor = page.next_cursor
            if cursor is None:
                break
    return found


@cases.command("export")
def export(
    context: typer.Context,
    out: Annotated[Path, typer.Argument(metavar="OUT.zip")],
    label: str | None = None,
    origin: str | None = None,
    axis: str | None = None,
    gearbox: str | None = None,
    json: Json = False,
) -> None:
    """Write a bundle of cases.

    It has their recordings, and another library can import it.
    """
    frame = frame_of(context)
    if out.exists():
        raise FileExistsError(f"{out} exists already; choose another name")
    wanted = CaseFilter(label=label, origin=origin, axis=axis, gearbox=gearbox)
    with frame.library() as library, library.reading() as session, frame.words.status("writing"):
        done = export_cases(library, session, out, wanted)
    if json:
        frame.print_json({"file": str(out), "cases": done.cases, "without_audio": done.without_audio})
    else:
        frame.print(f"{out}: {done.cases} cases")
    if done.without_audio:
        frame.say(f"{done.without_audio} of them are without audio, for it was erased: no library can import those")


@cases.command("import")
def import_(
    context: typer.Context, source: Annotated[Path, typer.Argument(metavar="IN.zip")], json: Json = False
) -> None:
    """Import the cases of a bundle.

    Cases that are in the library already stay as they are.
    """
    frame = frame_of(context)
    with frame.library() as library, frame.progress() as progress:
        task = progress.add_task("importing")
        done = import_cases(
            library, source, ACTOR, progress=lambda now, total: progress.update(task, completed=now, total=total)
        )
    if json:
        frame.print_json({"new": list(done.case_ids), "known": done.known, "refused": dict(done.refused)})
    else:
        frame.print(f"{source}: {len(done.case_ids)} new cases, {done.known} were here already")
    for name, reason in done.refused.items():
        frame.say(f"{name} refused: {reason}")
    raise typer.Exit(BAD_INPUT if done.refused else 0)
