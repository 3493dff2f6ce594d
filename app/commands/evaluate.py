"""`gearcase evaluate`: the library's own cross-validation."""

from typing import Annotated, Literal

import typer
from rich.table import Table
from sqlalchemy.orm import Session

from app.commands.frame import Frame, frame_of
from casebase.library import CaseLibrary
from casebase.reasoning.evaluation import Evaluation, Proportion


def register(app: typer.Typer) -> None:
    app.command("evaluate")(evaluate)


def evaluate(
    context: typer.Context,
    group: Annotated[Literal["gearbox", "axis", "case"], typer.Option(help="what is left out together")] = "gearbox",
    origin: Annotated[
        Literal["measured", "simulated", "both"], typer.Option(help="which cases to answer from")
    ] = "both",
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Leave out one gearbox at a time and diagnose it from the others."""
    frame = frame_of(context)
    with frame.library() as library, frame.words.status("cross-validating"), library.reading() as session:
        found = library.reuse.evaluate(session, group=group, origin=origin)
        alone = _alone(library, session, found)
    if json:
        compared = {each.origin: each.accuracy.to_document() for each in (*alone, found)}
        frame.print_json({**found.to_document(), "accuracy_by_origin": compared})
    else:
        _show(frame, found)
        for each in alone:
            frame.print(f"accuracy from {each.origin} cases alone: {_share(each.accuracy)}")


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


def _show(frame: Frame, found: Evaluation) -> None:
    answers = sorted({answer for row in found.confusion.values() for answer in row})
    table = Table("true label", *answers, "right", title=f"answers, each {found.group} left out in turn")
    for truth, row in found.confusion.items():
        counts = (str(len(row.get(answer, ()))) for answer in answers)
        table.add_row(truth, *counts, _share(found.per_class[truth]))
    frame.results.print(table)
    frame.print(f"{found.cases} cases of {found.gearboxes} measured gearboxes, answered from {found.origin}")
    frame.print(f"accuracy {_share(found.accuracy)}; of those called 'diagnosed' {_share(found.said)}")
    without = found.without_simulated
    figures = Table("called not_in_library", *(("with simulated cases", "without") if without else ("share",)))
    figures.add_row("known", *(_share(each.called_new) for each in (found, without) if each))
    for label in found.left_out:
        figures.add_row(f"{label}, left out", *(_share(each.left_out[label]) for each in (found, without) if each))
    frame.results.print(figures)


def _share(share: Proportion) -> str:
    if share.value is None:
        return "-"
    low, high = share.interval
    return f"{share.value:.2f} ({low:.2f} to {high:.2f}, {share.right} of {share.of})"
