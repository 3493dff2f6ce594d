"""Backup and restore of a library: a consistent copy of the database and all audio, with checksums.

A backup is a folder: `gearcase.db`, `audio/`, and `checksums.json`, which is written last and says which recordings
were erased: their audio is not missing. `gearcase.db` is SQLite whatever the database was, so that a backup of either
is restored into either. It has no sessions of browsers: a restore would begin again what somebody ended.
"""

import json
import shutil
import sqlite3
import stat
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import JSON, Connection, Engine, RowMapping, Table, delete, func, insert, select, text, update
from sqlalchemy.orm import Session

import migrations
from casebase.errors import BackupError, NotFoundError
from casebase.recordings import unspoken
from casebase.store.audio_store import AudioStore, sha256_of, sync_folder
from casebase.store.database import WRITING, create_engine_for, sqlite_url, upgrade_database
from casebase.store.models import Base, BrowserSession, LibraryCounter, StoredRecording, now
from signals.reading.plain_file import plain_bytes

CHECKSUMS = "checksums.json"
DATABASE = "gearcase.db"
SCHEMA = "gearcase-backup/1"
AT_A_TIME = 500
"""Rows that are copied together."""


def backup(engine: Engine, data_dir: Path, target: Path) -> int:
    """Copy a running library into a new folder and return how many audio files it holds.

    Raises:
        BackupError: if the folder exists and is not empty.
    """
    if target.exists() and any(target.iterdir()):
        raise BackupError(f"{target} is not empty; a backup needs a folder of its own")
    target.mkdir(parents=True, exist_ok=True)
    sums: dict[str, str] = {}
    if engine.dialect.name == "sqlite":
        _copy_database(Path(str(engine.url.database)), target / DATABASE)
    with _opened(target / DATABASE) as copied, Session(copied) as session:
        if engine.dialect.name != "sqlite":
            copy_rows(engine, copied)
        # the database first: audio that came later does no harm, audio that is missing would
        source, copy = AudioStore(data_dir / "audio"), AudioStore(target / "audio")
        hashes = set(source.hashes())
        hashes -= set(unspoken(session, hashes))
        for sha256 in sorted(hashes):
            with suppress(NotFoundError, FileNotFoundError):  # erased meanwhile; else `verify` says that it is missing
                if copy.put(source.path(sha256)) != sha256:
                    raise BackupError(f"audio {sha256[:12]} is damaged in the library; restore it from an older backup")
                sums[f"audio/{sha256}"] = sha256
        for sha256 in _erased_since(engine, session):
            copy.discard(sha256)
            sums.pop(f"audio/{sha256}", None)
    sums[DATABASE] = sha256_of(target / DATABASE)
    document = {
        "schema": SCHEMA,
        "database": engine.dialect.name,
        "made_at": now().isoformat(),
        "erased": _erased(target / DATABASE),
        "files": sums,
    }
    (target / CHECKSUMS).write_text(json.dumps(document, indent=1), encoding="utf-8")
    sync_folder(target)
    return sum(name.startswith("audio/") for name in sums)


def _erased_since(engine: Engine, copied: Session) -> set[str]:
    """Erase in the copy of the rows what was erased while audio was copied; return the files of all that is erased."""
    with Session(engine) as live:
        erased = live.scalars(select(StoredRecording).where(StoredRecording.erased_at.is_not(None))).all()
    for row in erased:
        before = StoredRecording.id == row.id, StoredRecording.erased_at.is_(None)
        values = {"erased_at": row.erased_at, "erased_by": row.erased_by}
        copied.execute(update(StoredRecording).where(*before).values(values))
    copied.commit()
    return {row.file_sha256 for row in erased}


def _copy_database(source: Path, target: Path) -> None:
    with closing(sqlite3.connect(source)) as live, closing(sqlite3.connect(target)) as copy:
        live.backup(copy)
        copy.execute(f"DELETE FROM {BrowserSession.__tablename__}")  # noqa: S608 - a name of ours
        copy.commit()


@contextmanager
def _opened(path: Path) -> Iterator[Engine]:
    """Give an SQLite database with the tables of the present revision; it is one file again at the end."""
    engine = create_engine_for(sqlite_url(path))
    try:
        upgrade_database(engine)
        yield engine
    finally:
        engine.dispose()


def verify(folder: Path) -> tuple[str, ...]:
    """Return what is wrong with a backup, nothing if it is whole. Files with several names are files as any others."""
    odd = [path for path in folder.rglob("*") if not (stat.S_ISREG(mode := path.lstat().st_mode) or stat.S_ISDIR(mode))]
    if odd:
        return (f"{odd[0]} is a link, a pipe, a device or a socket; a backup has files and folders alone",)
    try:
        document = _manifest(folder)
        files = dict(document["files"])
        if document["schema"] != SCHEMA:
            return (f"{CHECKSUMS} is not of {SCHEMA}",)
    except (OSError, ValueError, KeyError, TypeError) as error:
        return (f"no readable {CHECKSUMS}: this is no backup, or it was broken off ({error})",)
    return tuple(_faults(folder, files))


def _faults(folder: Path, files: dict[str, str]) -> Iterator[str]:
    store = AudioStore(folder / "audio")
    for name, expected in files.items():
        path = folder / DATABASE if name == DATABASE else store.path_of(name.removeprefix("audio/"))
        if not path.is_file():
            yield f"{name} is missing"
        elif sha256_of(path) != expected:
            yield f"{name} differs from its checksum"
    if DATABASE not in files:
        yield f"{DATABASE} is not in the backup: the rows are missing, and audio alone is no library"
    elif (folder / DATABASE).is_file():
        yield from _database_faults(folder / DATABASE, files)


def erased_in(folder: Path) -> tuple[str, ...]:
    """Return the ids of the recordings that were erased when a backup was made, by its manifest.

    Raises:
        BackupError: if the folder is no backup.
    """
    try:
        return tuple(_manifest(folder).get("erased", {}))
    except (OSError, ValueError, AttributeError) as error:
        raise BackupError(f"no readable {CHECKSUMS} in {folder}: this is no backup ({error})") from error


def _manifest(folder: Path) -> Any:
    return json.loads(plain_bytes(folder / CHECKSUMS))


def _erased(path: Path) -> dict[str, str]:
    """Return which recordings of a copied database are erased: id -> SHA-256 of the file."""
    with closing(_read_only(path)) as database:
        return dict(database.execute("SELECT id, file_sha256 FROM recordings WHERE erased_at IS NOT NULL"))


def _read_only(path: Path) -> sqlite3.Connection:
    """Open a database that nobody writes, without the files beside it that even who only reads would make."""
    return sqlite3.connect(f"file:{quote(str(path.resolve()))}?immutable=1", uri=True)


def _database_faults(path: Path, files: dict[str, str]) -> Iterator[str]:
    try:
        with closing(_read_only(path)) as database:
            result = database.execute("PRAGMA integrity_check").fetchone()[0]
            if result != "ok":
                yield f"the database is damaged: {result}"
            (revision,) = database.execute("SELECT version_num FROM alembic_version").fetchone() or (None,)
            if revision != migrations.NEWEST:
                yield f"its tables are of revision {revision}, and this version needs {migrations.NEWEST}"
                return
            erased = _erased(path)
            for (sha256,) in database.execute("SELECT DISTINCT file_sha256 FROM recordings"):
                if f"audio/{sha256}" not in files and sha256 not in erased.values():
                    yield f"audio/{sha256} is spoken of by the database but not in the backup"
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # the latter of names that are no text any more
        yield f"the database cannot be read: {error}"


def restore(source: Path, data_dir: Path, database: Engine | None = None) -> int:
    """Bring a backup back into an empty data folder and return how many audio files it holds.

    Args:
        database: an empty PostgreSQL database for the rows; SQLite in the data folder by default.

    Raises:
        BackupError: if the backup is not whole, or the folder or database holds a library already.
    """
    faults = verify(source)
    if faults:
        raise BackupError("the backup is not whole, nothing was restored: " + "; ".join(faults[:5]))
    if data_dir.exists() and any(data_dir.iterdir()):
        raise BackupError(f"{data_dir} is not empty; restore into a new data folder, then use that one")
    part = data_dir.with_name(data_dir.name + ".restoring")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    kept, store = AudioStore(source / "audio"), AudioStore(part / "audio")
    files = [name.removeprefix("audio/") for name in _manifest(source)["files"] if name != DATABASE]
    count = len([store.put(kept.path(sha256)) for sha256 in files])
    shutil.copy(source / DATABASE, part / DATABASE)
    if sha256_of(source / DATABASE) != sha256_of(part / DATABASE):
        raise BackupError(f"{DATABASE} did not arrive whole; is the disk full?")
    if database is not None:
        with _opened(part / DATABASE) as copied:
            upgrade_database(database)
            copy_rows(copied, database)
        (part / DATABASE).unlink()
    if data_dir.exists():
        data_dir.rmdir()
    part.rename(data_dir)
    sync_folder(data_dir.parent)
    return count


def copy_rows(source: Engine, target: Engine) -> None:
    """Copy all rows as they are at one moment; both databases have the tables of the present revision.

    Raises:
        BackupError: if the target holds anything already; nothing is changed then.
    """
    moment = {"isolation_level": "REPEATABLE READ"} if source.dialect.name == "postgresql" else {}
    with (
        source.connect().execution_options(**moment) as here,
        target.connect().execution_options(**{WRITING: True}) as there,
        there.begin(),
    ):
        _check_empty(there)
        there.execute(delete(LibraryCounter))
        for table in (each for each in Base.metadata.sorted_tables if each.name != BrowserSession.__tablename__):
            for rows in here.execution_options(yield_per=AT_A_TIME).execute(select(table)).mappings().partitions():
                for alike in _alike(table, rows):
                    there.execute(insert(table), alike)
        if target.dialect.name == "postgresql":
            # rows came with their numbers; the next one must not begin at 1 again
            there.execute(text("SELECT setval(pg_get_serial_sequence('audit', 'id'), max(id)) FROM audit"))


def _check_empty(there: Connection) -> None:
    for table in Base.metadata.sorted_tables:
        if table.name != LibraryCounter.__tablename__ and there.scalar(select(func.count()).select_from(table)):
            raise BackupError(f"the database is not empty ({table.name} has rows); restore into a new one")


def _alike(table: Table, rows: Sequence[RowMapping]) -> Iterator[list[dict[str, Any]]]:
    """Yield rows in groups with the same columns: a document that is absent is left out, or it would become `null`."""
    documents = {column.name for column in table.columns if isinstance(column.type, JSON)}
    kept = [{name: value for name, value in row.items() if value is not None or name not in documents} for row in rows]
    for _, group in groupby(kept, key=",".join):
        yield list(group)
