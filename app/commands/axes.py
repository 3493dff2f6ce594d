"""`gearcase axes list | show | template | add | change`."""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any

import tomli_w
import typer

from app.axes import TEMPLATES, in_si
from app.commands import frame
from app.commands.frame import ACTOR, Json
from app.http.errors import Unprocessable
from casebase.axes import add_axis, get_axis, list_axes
from casebase.store.models import AxisRevision
from sim.description.axis_document import read_axis, write_axis

axes = typer.Typer(help="List, show, add and change axes.", no_args_is_help=True)
Name = Annotated[str, typer.Argument(metavar="NAME", help="name of the axis")]


@axes.command("list")
def list_all(json: Json = False) -> None:
    """List the axes that are described."""
    with frame.library() as library, library.reading() as session:
        rows = list_axes(session)
    shown = [(row.name, str(row.revision), _stages(row.document), f"{row.created_at:%Y-%m-%d %H:%M}Z") for row in rows]
    frame.answer(json, [_document(row) for row in rows], frame.table(("axis", "revision", "stages", "since"), shown))


def _document(row: AxisRevision) -> dict[str, object]:
    return {"name": row.name, "revision": row.revision, "document": row.document}


def _stages(document: Mapping[str, Any]) -> str:
    return ", ".join(str(stage["name"]) for stage in document.get("stages") or ()) or "direct drive"


@axes.command()
def show(name: Name, json: Json = False) -> None:
    """Print the description of an axis as axis.toml."""
    with frame.library() as library, library.reading() as session:
        row = get_axis(session, name)
    if json:
        frame.print_json(_document(row))
    else:
        typer.echo(tomli_w.dumps(dict(row.document)), nl=False)


@axes.command()
def template(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="of gear unit; without it all are listed")] = "",
    name: Annotated[str, typer.Option("--name", help="of the axis")] = "axis",
) -> None:
    """Print an axis.toml with a usual gear unit, to be filled from the data sheet."""
    if not kind:
        frame.show(frame.table(("kind", "gear unit"), [(key, one.words) for key, one in TEMPLATES.items()]))
        return
    if kind not in TEMPLATES:
        raise Unprocessable(f"There is no template {kind!r}; there are {', '.join(TEMPLATES)}.")
    typer.echo(write_axis(read_axis(TEMPLATES[kind].document(name))), nl=False)


@axes.command()
def add(
    file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="the description")],
    json: Json = False,
) -> None:
    """Store a description; of an axis that is there it is the next revision."""
    _store(read_axis(file).to_mapping(), None, json)


@axes.command()
def change(
    name: Name,
    given: Annotated[
        list[str],
        typer.Option("--set", metavar="KEY=VALUE", help='such as load.inertia_kg_m2=50, or =..."900 kg cm2"'),
    ],
    json: Json = False,
) -> None:
    """Change numbers of an axis: the next revision.

    A key is written as in axis.toml, a stage by its name: stages.output.backlash_rad="1 arcmin".
    """
    with frame.library() as library, library.reading() as session:
        row = get_axis(session, name)
    document = deepcopy(dict(row.document))
    for each in given:
        _set(document, *each.partition("=")[::2])
    _store(document, row.revision, json)


def _set(document: dict[str, Any], path: str, text: str) -> None:
    """Put a number with its unit where a key of the description says."""
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


def _store(document: Mapping[str, Any], based_on: int | None, json: bool) -> None:
    described = read_axis(document)
    with frame.library() as library, library.transaction(ACTOR) as session:
        row = add_axis(session, described.name, described.to_mapping(), based_on=based_on)
        stored = {"name": row.name, "revision": row.revision}
    if json:
        frame.print_json(stored)
    else:
        frame.say(f"{stored['name']} is at revision {stored['revision']}")
