"""CaseLibrary: retrieve, reuse, revise, retain; the rows are the truth, the audio lies beside them."""

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import BinaryIO

from sqlalchemy import Engine
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session
from sqlalchemy.orm.exc import StaleDataError

from casebase.cycle.retain import Retain
from casebase.cycle.retrieve import Retrieve
from casebase.cycle.reuse import Reuse
from casebase.cycle.revise import Revise
from casebase.errors import LibraryError, SchemaError, StaleVersionError
from casebase.recordings import DISCARDED, unspoken
from casebase.store import audit, leases
from casebase.store.audio_store import NAMED, AudioStore
from casebase.store.counter import lock
from casebase.store.database import LONGEST_WAIT_S, WRITING, create_engine_for, sqlite_url, upgrade_database
from casebase.store.models import StoredRecording
from casebase.store.write_queue import WriteQueue


class CaseLibrary:
    """The library over one database and one data folder: its transactions, and the four steps on it.

    `retrieve`, `reuse`, `revise` and `retain` work inside the caller's transaction, so that several steps happen
    together or not at all.
    """

    def __init__(self, engine: Engine, data_dir: Path, writers: WriteQueue | None = None) -> None:
        self.engine = engine
        self.writers = writers
        """None where the database itself lets many write."""
        self.data_dir = data_dir
        self.audio = AudioStore(data_dir / "audio")
        self.lease: str | None = None
        """Of the worker that this library is opened by: nothing is written once it has ended."""
        self.retrieve = Retrieve(self.audio)
        self.reuse = Reuse(self.retrieve)
        self.revise = Revise(self.retrieve)
        self.retain = Retain(self.audio)

    @classmethod
    def open(
        cls, data_dir: Path, url: str | None = None, *, look: bool = False, longest_wait_s: float = LONGEST_WAIT_S
    ) -> "CaseLibrary":
        """Open, and create where needed; SQLite in the data folder unless a URL is given.

        Folder and files belong to their owner alone, as does whatever this process writes from then on.

        Args:
            look: create and change nothing.
            longest_wait_s: for others that write; who waits longer is refused [s].

        Raises:
            SchemaError: if it is the library of another version, or there is none to look at.
        """
        os.umask(0o077)
        database = data_dir / "gearcase.db"
        if not look:
            data_dir.mkdir(parents=True, exist_ok=True)
            make_private(data_dir)
        elif url is None and not database.exists():
            raise SchemaError(f"there is no library in {data_dir} yet: `gearcase serve` makes one")
        url = url or sqlite_url(database)
        patient = create_engine_for(url, look=look)  # another service may be making the tables
        try:
            upgrade_database(patient, look=look)
        finally:
            patient.dispose()  # or a log would be left beside the database
        engine = create_engine_for(url, longest_wait_s, look=look)
        return cls(engine, data_dir, WriteQueue(longest_wait_s) if engine.dialect.name == "sqlite" else None)

    @contextmanager
    def transaction(self, actor: str, request_id: str | None = None) -> Iterator[Session]:
        """Give a session that commits when the block ends well and rolls back when it does not.

        Raises:
            LeaseLostError: if it is a worker's library and the worker's lease has ended; nothing is written then.
            BusyError: if too many write.
        """
        turn = nullcontext() if self.writers is None else self.writers.turn()
        named: dict[str, BinaryIO] = {}
        try:
            with turn, Session(self.engine, expire_on_commit=False) as session:
                session.info.update({audit.ACTOR: actor, audit.REQUEST: request_id, NAMED: named})
                session.connection(execution_options={WRITING: True})
                yield session
                if self.lease is not None:
                    session.flush()
                    leases.hold(session, self.lease)
                session.commit()
                self.audio.unmark(named)
                audit.stored(session.info.get(audit.RECORDED, ()))
                for sha256 in session.info.get(DISCARDED, ()):
                    self.audio.discard(sha256)
        except BaseException as error:
            with suppress(LibraryError, SQLAlchemyError, OSError):  # the next start of the service tries again
                self.sweep(named)
            if isinstance(error, StaleDataError):
                raise StaleVersionError("somebody changed it at the same time; read it again") from error
            raise
        finally:
            for mark in named.values():
                mark.close()

    def sweep(self, hashes: Collection[str]) -> int:
        """Delete those of some files that no row speaks of; return how many there were."""
        if not hashes:
            return 0
        with self.transaction("sweep") as session:
            lock(session)
            left = unspoken(session, hashes, StoredRecording.file_sha256.in_(hashes))
            for sha256 in left:
                self.audio.discard(sha256)
            self.audio.unmark(hashes)
        return len(left)

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Give a session for reading; it is rolled back."""
        with Session(self.engine, expire_on_commit=False) as session:
            yield session

    def close(self) -> None:
        """Give back the database connections."""
        self.engine.dispose()


def make_private(folder: Path) -> None:
    """Take from others what an unpacked backup has let them read.

    The folder keeps them out; its databases are closed as well, since they are copied about.
    """
    with suppress(PermissionError):  # of another owner, who has to see to it
        folder.chmod(0o700)
        for path in folder.glob("*"):
            if path.is_file() and not path.is_symlink():
                path.chmod(0o600)
