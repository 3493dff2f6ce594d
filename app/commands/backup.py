"""`gearcase backup OUT`: database and recordings of a running installation, with checksums."""

from pathlib import Path
from typing import Annotated

import typer

from app.commands.frame import Json, frame_of
from casebase.errors import BackupError
from casebase.store import backup as backups


def register(app: typer.Typer) -> None:
    app.command("backup")(backup)


def backup(
    context: typer.Context,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="a folder to be made")],
    json: Json = False,
) -> None:
    """Write everything into a folder, with checksums, and read it back to be sure; the service may run on."""
    frame = frame_of(context)
    with frame.library() as library, frame.words.status("copying"):
        count = backups.backup(library.engine, library.data_dir, out)
        faults = backups.verify(out)
    if faults:
        raise BackupError("the backup does not read back as it was written: " + "; ".join(faults[:5]))
    if json:
        frame.print_json({"folder": str(out), "recordings": count, "verified": True})
    else:
        frame.print(f"{out}: database and {count} recordings, read back and compared")
