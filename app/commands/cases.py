"""`gearcase cases add | list | export | import | review`, and `gearcase evaluate`."""

from json import dumps
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.table import Table
from sqlalchemy.orm import Session

from app.commands import BAD_INPUT, DONE, frame
from app.commands.faults import sentence
from app.commands.frame import ACTOR, AXIS, Channel, Gearbox, Json, Payload, Period, Speed, Steady
from app.documents import CaseAnswer, ErasedAnswer
from app.recordings.intake import CaseMetadata, media_type_of, take_in
from app.recordings.sound_files import MEANT, Sound, sounds
from app.upkeep import erase_old
from casebase import review as care
from casebase.errors import DuplicateError, InvalidRequestError, LibraryError
from casebase.library import CaseLibrary
from casebase.reasoning.evaluation import Evaluation, Proportion
from casebase.search.case_filter import CaseFilter
from casebase.store.bundle import export_cases, import_cases
from casebase.store.counter import library_version
from casebase.store.erasing import erase as erase_audio
from casebase.store.fields import Verified
from signals.errors import SignalError
from sim.description.axis import Axis

cases = typer.Typer(help="Add, list, export and import cases.", no_args_is_help=True)
SHOWN = 10


@cases.command()
def add(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=MEANT)],
    label: Annotated[str, typer.Option(help="normal, notch, play or any other")],
    axis: Annotated[str | None, AXIS] = None,
    gearbox: Gearbox = None,
    speed: Speed = None,
    payload: Payload = None,
    period: Period = None,
    steady: Steady = None,
    channel: Channel = None,
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
    described = frame.axis_of(axis) if axis else None
    limit = frame.settings().upload_bytes
    with frame.library() as library, frame.progress() as progress, sounds(files, limit) as found:
        entries = [_add(library, one, metadata, described) for one in progress.track(found, description="adding")]
    frame.answer(json, entries, *map(_line, entries))
    raise typer.Exit(BAD_INPUT if any("error" in entry for entry in entries) else DONE)


def _line(entry: dict[str, Any]) -> str:
    known = " is a case with this sound already; nothing was changed" if entry.get("exists") else ""
    simulated = entry.get("origin") == "simulated"
    about = "; its sound is simulated, so this is a simulated case" if simulated else ""
    return f"{entry['file']}: {entry.get('error') or entry['id']}{known}{about}"


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
    wanted = CaseFilter(label=label, origin=origin, axis=axis, gearbox=gearbox, state=state, verification=verification)
    with frame.library() as library:
        found = _first(library, wanted, limit)
    columns = ("id", "label", "origin", "state", "axis", "gearbox", "file")
    rows = [
        (one.id, one.label, one.origin, one.state, taken.axis or "-", taken.gearbox or "-", taken.file_name)
        for one in found
        for taken in [one.recording]
    ]
    frame.answer(json, [one.model_dump(mode="json") for one in found], frame.table(columns, rows))


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
    if out.exists():
        raise FileExistsError(f"{out} exists already; choose another name")
    wanted = CaseFilter(label=label, origin=origin, axis=axis, gearbox=gearbox)
    with frame.library() as library, library.reading() as session, frame.WORDS.status("writing"):
        done = export_cases(library, session, out, wanted)
    document = {"file": str(out), "cases": done.cases, "without_audio": done.without_audio}
    frame.answer(json, document, f"{out}: {done.cases} cases")
    if done.without_audio:
        frame.say(f"{done.without_audio} of them are without audio, for it was erased: no library can import those")


@cases.command("import")
def import_(source: Annotated[Path, typer.Argument(metavar="IN.zip")], json: Json = False) -> None:
    """Import the cases of a bundle.

    Cases that are in the library already stay as they are.
    """
    with frame.library() as library, frame.progress() as progress:
        task = progress.add_task("importing")
        done = import_cases(
            library, source, ACTOR, progress=lambda now, total: progress.update(task, completed=now, total=total)
        )
    document = {"new": list(done.case_ids), "known": done.known, "refused": dict(done.refused)}
    frame.answer(json, document, f"{source}: {len(done.case_ids)} new cases, {done.known} were here already")
    for name, reason in done.refused.items():
        frame.say(f"{name} refused: {reason}")
    raise typer.Exit(BAD_INPUT if done.refused else DONE)


@cases.command()
def review(
    apply: Annotated[
        str | None, typer.Option(metavar="KIND", help="retire what is 'redundant' or quarantine what is 'far'")
    ] = None,
    undo: Annotated[int | None, typer.Option(metavar="VERSION", help="take back an edit of a review")] = None,
    plan: Annotated[
        Path | None,
        typer.Option(metavar="PLAN.json", help="write what `generate --plan` takes to fill the holes"),
    ] = None,
    json: Json = False,
) -> None:
    """Show cases to look at, and what is missing.

    Cases to look at are redundant, contradictory, suspect or far from all others. Only --apply and --undo change any.
    """
    with frame.library() as library:
        if undo is not None:
            with library.transaction(ACTOR) as session:
                frame.say(f"{care.undo(library, session, undo)} cases are as they were")
            return
        with library.reading() as session:
            found = care.review(session, library.reuse.reasoner(session), most=None)
        version = None
        if apply is not None:
            with library.transaction(ACTOR) as session:
                version = care.apply(library, session, found, apply).version
    if plan is not None:
        campaigns = [hole.campaign() for hole in found.uncovered]
        plan.write_text(dumps({"campaigns": campaigns}, indent=1) + "\n", encoding="utf-8")
    frame.answer(json, {**found.to_document(), "edit": version}, _reviewed(found))
    if json:
        return
    known = found.competence
    frame.say(
        f"{known.solved} of {known.of} cases get their right label from a case of another gearbox; "
        f"{known.footprint} well-chosen cases would be enough for that"
    )
    if version is not None:
        frame.say(f"done; take it back with: cases review --undo {version}")


def _reviewed(found: care.Review) -> Table:
    rows: list[tuple[str, ...]] = []
    for name in ("contradictory", "suspect", "far", "redundant"):
        listed: tuple[care.Finding, ...] = getattr(found, name)
        rows += [(name, one.case_id, one.label, one.origin, one.reason) for one in listed[:SHOWN]]
        rows += [(name, f"and {len(listed) - SHOWN} more")] if len(listed) > SHOWN else []
    rows += [("uncovered", "", hole.label, "", f"{hole.reason}: generate {hole.cases}") for hole in found.uncovered]
    return frame.table(("what", "case", "label", "origin", "reason"), rows)


def evaluate(
    group: Annotated[Literal["gearbox", "axis", "case"], typer.Option(help="what is left out together")] = "gearbox",
    origin: Annotated[
        Literal["measured", "simulated", "both"], typer.Option(help="which cases to answer from")
    ] = "both",
    json: Json = False,
) -> None:
    """Leave out one gearbox at a time and diagnose it from the others."""
    with frame.library() as library, frame.WORDS.status("cross-validating"), library.reading() as session:
        found = library.reuse.evaluate(session, group=group, origin=origin)
        alone = _alone(library, session, found)
    if json:
        compared = {each.origin: each.accuracy.to_document() for each in (*alone, found)}
        frame.print_json({**found.to_document(), "accuracy_by_origin": compared})
        return
    answers = sorted({answer for row in found.confusion.values() for answer in row})
    rows = [
        (truth, *(str(len(row.get(answer, ()))) for answer in answers), _share(found.per_class[truth]))
        for truth, row in found.confusion.items()
    ]
    title = f"answers, each {found.group} left out in turn"
    both = [each for each in (found, found.without_simulated) if each]
    unknown = [("known", *(_share(each.called_new) for each in both))]
    unknown += [(f"{label}, left out", *(_share(each.left_out[label]) for each in both)) for label in found.left_out]
    shares = ("with simulated cases", "without") if len(both) > 1 else ("share",)
    frame.show(
        frame.table(("true label", *answers, "right"), rows, title),
        f"{found.cases} cases of {found.gearboxes} measured gearboxes, answered from {found.origin}",
        f"accuracy {_share(found.accuracy)}; of those called 'diagnosed' {_share(found.said)}",
        frame.table(("called not_in_library", *shares), unknown),
        *(f"accuracy from {each.origin} cases alone: {_share(each.accuracy)}" for each in alone),
    )


def _alone(library: CaseLibrary, session: Session, found: Evaluation) -> list[Evaluation]:
    """Return the evaluations by measured and by simulated cases alone, where there are both."""
    measured = found.without_simulated
    if measured is None and len({kind for _, kind in library.retrieve.counts(session)}) < 2:
        return []
    kept = {each.origin: each for each in (found, measured) if each}
    return [
        kept.get(origin) or library.reuse.evaluate(session, group=found.group, origin=origin)
        for origin in ("measured", "simulated")
    ]


def _share(share: Proportion) -> str:
    if share.value is None:
        return "-"
    low, high = share.interval
    return f"{share.value:.2f} ({low:.2f} to {high:.2f}, {share.right} of {share.of})"


recordings = typer.Typer(help="Erase the audio of recordings.", no_args_is_help=True)
Yes = Annotated[bool, typer.Option("--yes", help="do not ask")]
LOST = "The sound and its plots are gone for good. Features, diagnoses and cases stay. Older backups still hold it."


@recordings.command()
def erase(
    ids: Annotated[list[str], typer.Argument(metavar="ID...", help="ids of recordings")],
    yes: Yes = False,
    json: Json = False,
) -> None:
    """Erase the audio of recordings.

    All of them or none. Features, diagnoses, cases and the audit log stay.
    """
    _confirm(yes, json, f"Erase the audio of {len(ids)} recordings? {LOST}")
    with frame.library() as library, library.transaction(ACTOR) as session:
        done = [erase_audio(library, session, each) for each in ids]
    lines = []
    for one in done:
        also = sorted(set(one.recordings) - {one.id})
        lines += [f"{one.id}: erased", *(f"{other}: erased too, for it has the same sound or file" for other in also)]
    frame.answer(json, [ErasedAnswer.model_validate(one).model_dump(mode="json") for one in done], *lines)


@recordings.command()
def expire(
    days: Annotated[
        int | None, typer.Option(min=1, help="how long audio is kept [GEARCASE_RETAIN_AUDIO_DAYS]", show_default=False)
    ] = None,
    yes: Yes = False,
    json: Json = False,
) -> None:
    """Erase old audio.

    That is the audio of recordings that are no cases and are older than so many days.
    """
    days = days or frame.settings().retain_audio_days
    if days is None:
        raise InvalidRequestError("say how long audio is kept: --days N, or set GEARCASE_RETAIN_AUDIO_DAYS")
    _confirm(yes, json, f"Erase the audio of all recordings that are no cases and older than {days} days? {LOST}")
    with frame.library() as library:
        gone = erase_old(library, days, ACTOR)
    frame.answer(json, {"days": days, "erased": gone}, f"{len(gone)} recordings erased")


def _confirm(yes: bool, json: bool, question: str) -> None:
    if yes:
        return
    if json:
        raise InvalidRequestError("with --json nobody is asked: add --yes if you are sure")
    typer.confirm(question, abort=True, err=True)
