"""`gearcase axes list | show | template | add | change`."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from app.commands.frame import ACTOR, frame_of

axes = typer.Typer(help="List, show, add and change axes.", no_args_is_help=True)
Name = Annotated[str, typer.Argument(metavar="NAME", help="name of the axis")]
AsJson = Annotated[bool, typer.Option("--json", help="one JSON document on stdout")]


def register(app: typer.Typer) -> None:
    app.add_typer(axes, name="axes")


@axes.command("list")
def list_all(context: typer.Context, json: AsJson = False) -> None:
    """List the axes that are described."""
    from casebase.axes import list_axes

    frame = frame_of(context)
    with frame.library() as library, library.reading() as session:
        rows = list_axes(session)
    if json:
        frame.print_json([{"name": row.name, "revision": row.revision, "document": row.document} for row in rows])
        return
    table = Table("axis", "revision", "stages", "since")
    for row in rows:
        stages: Any = row.document.get("stages") or []
        names = ", ".join(str(stage["name"]) for stage in stages)
        table.add_row(row.name, str(row.revision), names or "direct drive", f"{row.created_at:%Y-%m-%d %H:%M}Z")
    frame.results.print(table)


@axes.command()
def show(context: typer.Context, name: Name, json: AsJson = False) -> None:
    """Print the description of an axis as axis.toml."""
    import tomli_w

    from casebase.axes import get_axis

    frame = frame_of(context)
    with frame.library() as library, library.reading() as session:
        row = get_axis(session, name)
    if json:
        frame.print_json({"name": row.name, "revision": row.revision, "document": row.document})
    else:
        typer.echo(tomli_w.dumps(dict(row.document)), nl=False)


@axes.command()
def template(
    context: typer.Context,
    kind: Annotated[str, typer.Argument(metavar="KIND", help="of gear unit; without it all are listed")] = "",
    name: Annotated[str, typer.Option("--name", help="of the axis")] = "axis",
) -> None:
    """Print an axis.toml with a usual gear unit, to be filled from the data sheet."""
    from app.axes.axis_templates import TEMPLATES
    from app.http.errors import Unprocessable
    from sim.description.axis_document import read_axis, write_axis

    frame = frame_of(context)
    if not kind:
        table = Table("kind", "gear unit")
        for key, one in TEMPLATES.items():
            table.add_row(key, one.words)
        frame.results.print(table)
        return
    if kind not in TEMPLATES:
        raise Unprocessable(f"There is no template {kind!r}; there are {', '.join(TEMPLATES)}.")
    typer.echo(write_axis(read_axis(TEMPLATES[kind].document(name))), nl=False)


@axes.command()
def add(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="the description")],
    json: AsJson = False,
) -> None:
    """Store a description; of an axis that is there it is the next revision."""
    from sim.description.axis_document import read_axis

    _store(context, read_axis(file).to_mapping(), None, json)


@axes.command()
def change(
    context: typer.Context,
    name: Name,
    given: Annotated[
        list[str],
        typer.Option("--set", metavar="KEY=VALUE", help='such as load.inertia_kg_m2=50, or =..."900 kg cm2"'),
    ],
    json: AsJson = False,
) -> None:
    """Change numbers of an axis: the next revision.

    A key is written as in axis.toml, a stage by its name: stages.output.backlash_rad="1 arcmin".
    """
    from casebase.axes import get_axis

    frame = frame_of(context)
    with frame.library() as library, library.reading() as session:
        row = get_axis(session, name)
    document = deepcopy(dict(row.document))
    for each in given:
        _set(document, *each.partition("=")[::2])
    _store(context, document, row.revision, json)


def _set(document: dict[str, Any], path: str, text: str) -> None:
    """Put a number with its unit where a key of the description says."""
    from app.axes.axis_units import in_si
    from app.http.errors import Unprocessable

    table_name, _, rest = path.partition(".")
    table: dict[str, Any]
    if table_name == "stages":
        stage, _, rest = rest.rpartition(".")
        known = {str(one["name"]): one for one in document.get("stages", ())}
        if stage not in known:
            raise Unprocessable(f"{path}: no stage is called {stage!r}; there are {', '.join(known) or 'none'}.")
        table = known[stage]
    else:
        table = document.setdefault(table_name, {})
    if not rest or not text.strip():
        raise Unprocessable(f"{path or 'KEY'}: write KEY=VALUE, such as load.inertia_kg_m2=50.")
    value = in_si(rest, text)
    if rest.endswith("_teeth"):
        table.pop("ratio", None)
    table[rest] = int(value) if rest.endswith("_teeth") and value.is_integer() else value


def _store(context: typer.Context, document: dict[str, Any], based_on: int | None, json: bool) -> None:
    from casebase.axes import add_axis
    from sim.description.axis_document import read_axis

    frame = frame_of(context)
    described = read_axis(document)
    with frame.library() as library, library.transaction(ACTOR) as session:
        row = add_axis(session, described.name, described.to_mapping(), based_on=based_on)
        name, revision = row.name, row.revision
    if json:
        frame.print_json({"name": name, "revision": revision})
    else:
        frame.say(f"{name} is at revision {revision}")
