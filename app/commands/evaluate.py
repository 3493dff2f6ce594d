"""`gearcase evaluate`: the library's own cross-validation."""

from typing import Annotated, Literal

import typer
from rich.table import Table

from app.commands.frame import Frame, frame_of
from casebase.evaluation import Evaluation, Proportion


def register(app: typer.Typer) -> None:
    app.command("evaluate")(evaluate)


def evaluate(
    context: typer.Context,
    group: Annotated[Literal["gearbox", "axis", "case"], typer.Option(help="what is left out together")] = "gearbox",
    origin: Annotated[
        Literal["measured", "simulated", "both"], typer.Option(help="which cases to learn from")
    ] = "both",
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Leave out one gearbox at a time, learn from the others and diagnose it."""
    frame = frame_of(context)
    with frame.current_library() as library, frame.words.status("cross-validating"), library.reading() as session:
        found = library.evaluate(session, group=group, origin=origin)
        kinds = {kind for _, kind in library.counts(session)}
        alone = (
            [library.evaluate(session, group=group, origin=kind) for kind in sorted(kinds)] if len(kinds) > 1 else []
        )
    if json:
        compared = {each.origin: each.accuracy.to_document() for each in (*alone, found)}
        frame.print_json({**found.to_document(), "accuracy_by_origin": compared})
    else:
        _show(frame, found)
        for each in alone:
            frame.print(f"accuracy learned from {each.origin} cases alone: {_share(each.accuracy)}")


def _show(frame: Frame, found: Evaluation) -> None:
    answers = sorted({answer for row in found.confusion.values() for answer in row})
    table = Table("true label", *answers, "right", title=f"answers, each {found.group} left out in turn")
    for truth, row in found.confusion.items():
        counts = (str(len(row.get(answer, ()))) for answer in answers)
        table.add_row(truth, *counts, _share(found.per_class[truth]))
    frame.results.print(table)
    frame.print(f"{found.cases} cases of {found.gearboxes} measured gearboxes, learned from {found.origin}")
    frame.print(f"accuracy {_share(found.accuracy)}; of those called 'diagnosed' {_share(found.said)}")
    frame.print(f"known, but called not_in_library: {_share(found.called_new)}")
    for label, share in found.left_out.items():
        frame.print(f"{label} left out of the library, called not_in_library: {_share(share)}")


def _share(share: Proportion) -> str:
    if share.value is None:
        return "-"
    low, high = share.interval
    return f"{share.value:.2f} ({low:.2f} to {high:.2f}, {share.right} of {share.of})"
