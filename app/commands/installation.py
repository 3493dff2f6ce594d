"""`gearcase backup`, `restore` and `doctor`: an installation is copied, brought back, and checked."""

import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from sqlalchemy import exists, func, make_url, select
from sqlalchemy.orm import Session

from app.api.operation import FREE_BYTES
from app.commands import DONE, FAILURE, frame
from app.commands.frame import ACTOR, Json
from app.http.keys import Role
from app.upkeep import leftovers
from casebase.errors import BackupError, NotFoundError, SchemaError
from casebase.library import CaseLibrary
from casebase.recordings import unspoken
from casebase.store import backup as backups
from casebase.store.audio_store import sha256_of
from casebase.store.backup import AT_A_TIME
from casebase.store.database import create_engine_for
from casebase.store.erasing import erase
from casebase.store.integrity import RESTORE, faults_of
from casebase.store.models import ApiKey, FeatureRow, StoredRecording
from signals.errors import DecoderUnavailableError
from signals.features import EXTRACTOR_VERSION
from signals.reading.decode import warm_up


def backup(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="a folder to be made")],
    json: Json = False,
) -> None:
    """Write everything into a folder, with checksums, and read it back to be sure; the service may run on."""
    with frame.library() as library, frame.WORDS.status("copying"):
        count = backups.backup(library.engine, library.data_dir, out)
        faults = backups.verify(out)
    if faults:
        raise BackupError("the backup does not read back as it was written: " + "; ".join(faults[:5]))
    document = {"folder": str(out), "recordings": count, "verified": True}
    frame.answer(json, document, f"{out}: database and {count} recordings, read back and compared")


def restore(
    source: Annotated[Path, typer.Argument(metavar="IN", help="what `backup` has written")],
    erased: Annotated[
        Path | None, typer.Option(metavar="LATER", help="a later backup: what was erased by then is erased again")
    ] = None,
    json: Json = False,
) -> None:
    """Bring a backup back into an empty data directory; a backup that is not whole changes nothing.

    Audio that was erased after the backup was made is in it, and comes back unless --erased names a later backup.
    """
    folder, url = frame.settings().data_dir, frame.settings().database_url
    database = create_engine_for(url) if url and make_url(url).get_backend_name() == "postgresql" else None
    later = () if erased is None else backups.erased_in(erased)
    with frame.WORDS.status("restoring"):
        count = backups.restore(source, folder, database)
    again = _erase_again(later) if later else 0
    if erased is None:
        frame.say("audio that was erased after this backup was made is back; --erased LATER erases it again")
    document = {"data_dir": str(folder), "recordings": count, "erased_again": again}
    frame.answer(json, document, f"{folder}: database and {count} recordings")


def _erase_again(ids: Sequence[str]) -> int:
    """Erase what a later backup says was erased; return how many recordings came back and are gone again."""
    with frame.library() as library, library.transaction(ACTOR) as session:
        known = [row for row in (session.get(StoredRecording, each) for each in ids) if row is not None]
        back = [row for row in known if row.erased_at is None]
        for row in back:
            erase(library, session, row.id, "erased after the backup was made")
    return len(back)


class Finding(NamedTuple):
    """One thing that was looked at; `fault` says what is wrong and what to do, None is good."""

    what: str
    found: str
    fault: str | None = None


def doctor(
    thorough: Annotated[bool, typer.Option(help="read every recording and compare its SHA-256")] = False,
    sweep: Annotated[bool, typer.Option("--sweep", help="first remove audio that no row speaks of")] = False,
    json: Json = False,
) -> None:
    """Check this installation and say what to do; ends with 1 if something is wrong. Changes nothing but by --sweep."""
    if sweep:
        with frame.library() as library:
            left = _unspoken(library)
            removed = sum(library.sweep(left[at : at + AT_A_TIME]) for at in range(0, len(left), AT_A_TIME))
        frame.say(f"{removed} files of audio removed")
    try:
        with frame.library(look=True) as library, library.reading() as session:
            findings = [_database(library, thorough)]
            if findings[0].fault is None:
                findings += _checked(library, session, thorough)
    except SchemaError as error:
        findings = [Finding("database", "there is none that can be looked at", str(error))]
    lines = (
        f"{'WRONG' if one.fault else 'good '}  {one.what}: {one.found}" + (f"\n       {one.fault}" if one.fault else "")
        for one in findings
    )
    frame.answer(json, [one._asdict() for one in findings], *lines)
    raise typer.Exit(FAILURE if any(one.fault for one in findings) else DONE)


def _database(library: CaseLibrary, thorough: bool) -> Finding:
    faults = faults_of(library.engine, thorough=thorough)
    if faults:
        return Finding("database", f"is damaged: {'; '.join(faults)}", RESTORE)
    if library.engine.dialect.name != "sqlite":
        return Finding("database", "PostgreSQL checks its pages itself, where data checksums are switched on")
    checked = "tables and indexes are whole" if thorough else "its pages are whole (for its indexes see --thorough)"
    return Finding("database", checked)


def _checked(library: CaseLibrary, session: Session, thorough: bool) -> Iterator[Finding]:
    """Look at all but the database, which is good."""
    free, writable = shutil.disk_usage(library.data_dir).free, os.access(library.data_dir, os.W_OK)
    yield Finding(
        "disk",
        f"{free >> 20} MiB free where the data folder lies",
        None if free > FREE_BYTES else "Make room: uploads are refused soon.",
    )
    yield Finding(
        "data folder",
        f"{library.data_dir} is {'writable' if writable else 'not writable'}",
        None if writable else "Give the folder to the user who runs the service.",
    )
    admins = session.scalar(
        select(func.count()).select_from(ApiKey).where(ApiKey.role == Role.ADMIN.value, ApiKey.revoked_at.is_(None))
    )
    missing = None if admins else "Run `gearcase keys create --role admin --name NAME`."
    yield Finding("keys", f"{admins} admin keys in force", missing)
    counts = library.retrieve.counts(session)
    shown = ", ".join(f"{count} {label} {origin}" for (label, origin), count in sorted(counts.items()))
    empty = None if counts else "Run `gearcase cases add FILE... --label LABEL`, or `gearcase starter`."
    yield Finding("library", shown or "no cases", empty)
    known = exists().where(
        FeatureRow.recording_id == StoredRecording.id, FeatureRow.extractor_version == EXTRACTOR_VERSION
    )
    old = session.scalar(select(func.count()).select_from(StoredRecording).where(~known))
    stale = "Export the cases, and import them: their features are taken again." if old else None
    yield Finding("features", f"{old} recordings lack features of the present extractor: not searched", stale)
    try:
        warm_up()
        yield Finding("decoder", "starts in its limited process")
    except DecoderUnavailableError as error:
        yield Finding("decoder", "does not start", str(error))
    yield _audio(library, session, thorough)
    yield _leftovers(library)


def _audio(library: CaseLibrary, session: Session, thorough: bool) -> Finding:
    missing, changed, number = [], [], 0
    rows = select(StoredRecording).where(StoredRecording.erased_at.is_(None)).execution_options(yield_per=500)
    for number, row in enumerate(session.scalars(rows), 1):  # noqa: B007
        try:
            path = library.audio.path(row.file_sha256)
        except NotFoundError:
            missing.append(row.id)
            continue
        if thorough and sha256_of(path) != row.file_sha256:
            changed.append(row.id)
    looked = "read and compared" if thorough else "there (their bytes were not read; see --thorough)"
    names = ", ".join((missing + changed)[:5])
    fault = f"{len(missing)} are missing and {len(changed)} changed ({names}, ...): restore them from a backup."
    whole = number - len(missing) - len(changed)
    return Finding("recordings", f"{whole} of {number} are {looked}", fault if whole < number else None)


def _leftovers(library: CaseLibrary) -> Finding:
    """Of processes that were killed, and of older versions, which kept what they refused."""
    unspoken = _unspoken(library)
    size = sum(library.audio.path_of(sha256).stat().st_size for sha256 in unspoken)
    left = leftovers(library, frame.settings().incoming, remove=False)
    return Finding(
        "leftovers",
        f"{left} that the next start of the service removes, {len(unspoken)} files of audio that no row speaks of "
        f"({size >> 20} MiB)",
        "Run `gearcase doctor --sweep`." if unspoken else None,
    )


def _unspoken(library: CaseLibrary) -> list[str]:
    """Return the hashes of audio that no row speaks of and that is not just being stored."""
    hashes = set(library.audio.hashes()) - set(library.audio.marks())
    with library.reading() as session:  # begun after the look at the disk, so that it knows the rows of all of that
        return sorted(unspoken(session, hashes))
