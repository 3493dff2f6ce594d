"""`gearcase cases review`: what to look at in the library; edits on request, undoable."""

from __future__ import annotations

from json import dumps
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from app.commands.frame import ACTOR, frame_of
from casebase import review as care

SHOWN = 10


def review(
    context: typer.Context,
    apply: Annotated[
        str | None, typer.Option(metavar="KIND", help="retire what is 'redundant' or quarantine what is 'far'")
    ] = None,
    undo: Annotated[int | None, typer.Option(metavar="VERSION", help="take back an edit of a review")] = None,
    plan: Annotated[
        Path | None,
        typer.Option(metavar="PLAN.json", help="write what `generate --plan` takes to fill the holes"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Show cases to look at, and what is missing.

    Cases to look at are redundant, contradictory, suspect or far from all others. Only --apply and --undo change any.
    """
    frame = frame_of(context)
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
    if json:
        frame.print_json({**found.to_document(), "edit": version})
        return
    table = Table("what", "case", "label", "origin", "reason")
    for name in ("contradictory", "suspect", "far", "redundant"):
        listed: tuple[care.Finding, ...] = getattr(found, name)
        for each in listed[:SHOWN]:
            table.add_row(name, each.case_id, each.label, each.origin, each.reason)
        if len(listed) > SHOWN:
            table.add_row(name, f"and {len(listed) - SHOWN} more", "", "", "")
    for hole in found.uncovered:
        table.add_row("uncovered", "", hole.label, "", f"{hole.reason}: generate {hole.cases}")
    frame.results.print(table)
    known = found.competence
    frame.say(
        f"{known.solved} of {known.of} cases get their right label from a case of another gearbox; "
        f"{known.footprint} well-chosen cases would be enough for that"
    )
    if version is not None:
        frame.say(f"done; take it back with: cases review --undo {version}")
