"""`gearcase restore IN`: a backup into an empty data directory."""

from pathlib import Path
from typing import Annotated

import typer
from sqlalchemy import make_url

from app.commands.frame import Json, frame_of
from casebase import backup as backups
from casebase.database import create_engine_for


def register(app: typer.Typer) -> None:
    app.command("restore")(restore)


def restore(
    context: typer.Context,
    source: Annotated[Path, typer.Argument(metavar="IN", help="what `backup` has written")],
    json: Json = False,
) -> None:
    """Bring a backup back into an empty data directory; a backup that is not whole changes nothing."""
    frame = frame_of(context)
    url = frame.settings.database_url
    database = create_engine_for(url) if url and make_url(url).get_backend_name() == "postgresql" else None
    with frame.words.status("restoring"):
        count = backups.restore(source, frame.settings.data_dir, database)
    if json:
        frame.print_json({"data_dir": str(frame.settings.data_dir), "recordings": count})
    else:
        frame.print(f"{frame.settings.data_dir}: database and {count} recordings")
