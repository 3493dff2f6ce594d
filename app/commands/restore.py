"""`gearcase restore IN`: a backup into an empty data directory."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from sqlalchemy import make_url

from app.commands.frame import ACTOR, Frame, Json, frame_of
from casebase.store import backup as backups
from casebase.store.database import create_engine_for


def register(app: typer.Typer) -> None:
    app.command("restore")(restore)


def restore(
    context: typer.Context,
    source: Annotated[Path, typer.Argument(metavar="IN", help="what `backup` has written")],
    erased: Annotated[
        Path | None, typer.Option(metavar="LATER", help="a later backup: what was erased by then is erased again")
    ] = None,
    json: Json = False,
) -> None:
    """Bring a backup back into an empty data directory; a backup that is not whole changes nothing.

    Audio that was erased after the backup was made is in it, and comes back unless --erased names a later backup.
    """
    frame = frame_of(context)
    url = frame.settings.database_url
    database = create_engine_for(url) if url and make_url(url).get_backend_name() == "postgresql" else None
    later = () if erased is None else backups.erased_in(erased)
    with frame.words.status("restoring"):
        count = backups.restore(source, frame.settings.data_dir, database)
    again = _erase_again(frame, later) if later else 0
    if erased is None:
        frame.say("audio that was erased after this backup was made is back; --erased LATER erases it again")
    if json:
        frame.print_json({"data_dir": str(frame.settings.data_dir), "recordings": count, "erased_again": again})
    else:
        frame.print(f"{frame.settings.data_dir}: database and {count} recordings")


def _erase_again(frame: Frame, ids: Sequence[str]) -> int:
    """Erase what a later backup says was erased; return how many recordings came back and are gone again."""
    from casebase.store.erasing import erase
    from casebase.store.models import StoredRecording

    with frame.library() as library, library.transaction(ACTOR) as session:
        known = [row for row in (session.get(StoredRecording, each) for each in ids) if row is not None]
        back = [row for row in known if row.erased_at is None]
        for row in back:
            erase(library, session, row.id, "erased after the backup was made")
    return len(back)
