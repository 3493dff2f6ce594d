"""`gearcase keys create | list | revoke`."""

from datetime import datetime
from typing import Annotated

import typer

from app.commands import frame
from app.commands.frame import ACTOR, Json
from app.documents import KeyAnswer
from app.http.keys import Role, create_key, list_keys, revoke_key

keys = typer.Typer(help="Make, list and revoke keys.", no_args_is_help=True)


@keys.command()
def create(
    role: Annotated[Role, typer.Option(help="viewer reads, operator diagnoses, admin changes the library")],
    name: Annotated[str, typer.Option(help="whose key it is")],
    json: Json = False,
) -> None:
    """Print a new key, alone on stdout, this once."""
    with frame.library() as library, library.transaction(ACTOR) as session:
        row, key = create_key(session, name=name, role=role)
    frame.say(f"key {row.id} of {name}, role {role.value}; it is shown this once:")
    frame.answer(json, {"id": row.id, "name": row.name, "role": role.value, "key": key}, key)


@keys.command("list")
def list_(json: Json = False) -> None:
    """List the keys.

    Shows whose they are, their role and when they were used; never the keys themselves.
    """
    with frame.library() as library, library.reading() as session:
        answers = [KeyAnswer.model_validate(row) for row in list_keys(session)]
    rows = [
        (one.id, one.name, one.role.value, *map(_minute, (one.created_at, one.last_used_at, one.revoked_at)))
        for one in answers
    ]
    shown = frame.table(("id", "name", "role", "created", "last used", "revoked"), rows)
    frame.answer(json, [one.model_dump(mode="json") for one in answers], shown)


def _minute(time: datetime | None) -> str:
    return f"{time:%Y-%m-%d %H:%M}Z" if time else "-"


@keys.command()
def revoke(key_id: Annotated[str, typer.Argument(metavar="ID")]) -> None:
    """End a key for good."""
    with frame.library() as library, library.transaction(ACTOR) as session:
        row = revoke_key(session, key_id)
    frame.say(f"key {row.id} of {row.name} is revoked")
