"""`gearcase keys create | list | revoke`."""

from typing import Annotated

import typer
from rich.table import Table

from app.commands.frame import ACTOR, Json, frame_of
from app.documents import KeyAnswer
from app.http.keys import Role, create_key, list_keys, revoke_key

keys = typer.Typer(help="Make, list and revoke keys.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    app.add_typer(keys, name="keys")


@keys.command()
def create(
    context: typer.Context,
    role: Annotated[Role, typer.Option(help="viewer reads, operator diagnoses, admin changes the library")],
    name: Annotated[str, typer.Option(help="whose key it is")],
    json: Json = False,
) -> None:
    """Print a new key, alone on stdout, this once."""
    frame = frame_of(context)
    with frame.library() as library, library.transaction(ACTOR) as session:
        row, key = create_key(session, name=name, role=role)
    frame.say(f"key {row.id} of {name}, role {role.value}; it is shown this once:")
    if json:
        frame.print_json({"id": row.id, "name": row.name, "role": role.value, "key": key})
    else:
        typer.echo(key)


@keys.command("list")
def list_(
    context: typer.Context, json: Annotated[bool, typer.Option("--json", help="one JSON document")] = False
) -> None:
    """List the keys.

    Shows whose they are, their role and when they were used; never the keys themselves.
    """
    frame = frame_of(context)
    with frame.library() as library, library.reading() as session:
        answers = [KeyAnswer.model_validate(row) for row in list_keys(session)]
    if json:
        frame.print_json([answer.model_dump(mode="json") for answer in answers])
        return
    table = Table("id", "name", "role", "created", "last used", "revoked")
    for answer in answers:
        times = (answer.created_at, answer.last_used_at, answer.revoked_at)
        shown = (f"{time:%Y-%m-%d %H:%M}Z" if time else "-" for time in times)
        table.add_row(answer.id, answer.name, answer.role.value, *shown)
    frame.results.print(table)


@keys.command()
def revoke(context: typer.Context, key_id: Annotated[str, typer.Argument(metavar="ID")]) -> None:
    """End a key for good."""
    frame = frame_of(context)
    with frame.library() as library, library.transaction(ACTOR) as session:
        row = revoke_key(session, key_id)
    frame.say(f"key {row.id} of {row.name} is revoked")
