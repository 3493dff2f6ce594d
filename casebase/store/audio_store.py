"""Bytes of recordings, under their own SHA-256; they get that name in the transaction that makes a row of them."""

import hashlib
import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, TypeGuard

from sqlalchemy.orm import Session

from casebase.errors import DamagedError, InvalidRequestError, NotFoundError
from casebase.store.counter import lock
from casebase.store.stale_locks import hold
from signals.reading.plain_file import open_plain

CHUNK = 1 << 20
NAMED = "named_files"
"""In a session's `info`: hashes of the files that it named, with their marks, which it holds until it ends."""
MARK = ".pending-"


@dataclass(frozen=True)
class Content:
    """Bytes that were read: where they are, their SHA-256 in hexadecimal and their number."""

    source: Path | bytes
    sha256: str
    byte_count: int


@dataclass(frozen=True)
class AudioStore:
    """A folder of files named by content: `ab/cdef...`."""

    folder: Path

    def content(self, source: Path | bytes) -> Content:
        """Read bytes that are to be kept, and make an upload durable: before a transaction, for it takes its time."""
        sha256 = sha256_of(source)
        if isinstance(source, bytes):
            return Content(source, sha256, len(source))
        if self._is_upload(source):
            with source.open("rb") as file:
                os.fsync(file.fileno())
        return Content(source, sha256, source.stat().st_size)

    def keep(self, session: Session, content: Content) -> None:
        """Name the bytes for a row of this transaction; what no row speaks of in the end goes again.

        Until then it holds a mark beside them, by which what a kill left is found.

        Raises:
            InvalidRequestError: if the file has changed since it was read.
        """
        lock(session)
        target = self.path_of(content.sha256)
        if target.is_file():
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        named: dict[str, BinaryIO] = session.info[NAMED]
        named[content.sha256] = mark = self._mark(content.sha256).open("ab")
        hold(mark.fileno())
        if self._is_upload(content.source) and _is_linked(content.source, target):
            return
        with self.unnamed(content.source) as (part, written):
            if written != content.sha256:
                raise InvalidRequestError(f"{content.source!s} was written to while it was read; try again")
            _name(part, target)

    def put(self, source: Path | bytes) -> str:
        """Write the bytes durably under their SHA-256, and return it; the same bytes twice cost one file."""
        with self.unnamed(source) as (part, sha256):
            _name(part, self.path_of(sha256))
        return sha256

    @contextmanager
    def unnamed(self, source: Path | bytes) -> Iterator[tuple[Path, str]]:
        """Give a durable copy that is gone after the block, and its SHA-256."""
        self.folder.mkdir(parents=True, exist_ok=True)
        part = self.folder / f".part-{os.getpid()}-{secrets.token_hex(8)}"
        try:
            with part.open("xb") as out:
                hold(out.fileno())
                yield part, _write(source, out)
        finally:
            part.unlink(missing_ok=True)

    def marks(self) -> dict[str, Path]:
        """Return the marks of what is being named, by its hash: still held, or abandoned."""
        return {path.name.removeprefix(MARK): path for path in self.folder.glob(f"{MARK}*")}

    def unmark(self, hashes: Iterable[str]) -> None:
        """Take marks away, once it is settled what becomes of their files."""
        for sha256 in hashes:
            self._mark(sha256).unlink(missing_ok=True)

    def _mark(self, sha256: str) -> Path:
        return self.folder / f"{MARK}{sha256}"

    def _is_upload(self, source: Path | bytes) -> TypeGuard[Path]:
        """Whether it is a file in the data folder, where nobody changes it."""
        return isinstance(source, Path) and self.folder.parent.resolve() in source.resolve().parents

    def unfinished(self) -> Iterator[Path]:
        """Yield what is not written to its end: still held by its writer, or abandoned."""
        yield from self.folder.glob(".part-*")

    def path(self, sha256: str) -> Path:
        """Return where the bytes lie; raises NotFoundError if they are gone."""
        path = self.path_of(sha256)
        if not path.is_file():
            raise NotFoundError(f"the audio {sha256[:12]} is missing from the data folder; restore it from a backup")
        return path

    def whole(self, sha256: str) -> Path:
        """Return where the bytes lie, read and compared since they last changed.

        Raises:
            NotFoundError: if they are gone.
            DamagedError: if they are not those that were put.
        """
        path = self.path(sha256)
        state = path.stat()
        if not _is_whole(path, sha256, state.st_mtime_ns, state.st_size):
            raise DamagedError(
                f"the audio {sha256[:12]} is damaged: it is not what was stored. Bring the file back from a backup: "
                f"it lies there as audio/{sha256[:2]}/{sha256[2:]}"
            )
        return path

    def discard(self, sha256: str) -> None:
        """Delete the bytes durably, if they are there."""
        path = self.path_of(sha256)
        if path.is_file():
            path.unlink(missing_ok=True)
            sync_folder(path.parent)

    def path_of(self, sha256: str) -> Path:
        """Return where bytes with this hash belong."""
        if len(sha256) != 64 or not set(sha256) <= set("0123456789abcdef"):
            raise NotFoundError(f"{sha256!r} is no SHA-256 in hexadecimal")
        return self.folder / sha256[:2] / sha256[2:]

    def hashes(self) -> Iterator[str]:
        """Yield the hash of everything kept, sorted."""
        for path in sorted(self.folder.glob("??/*")):
            if path.is_file():
                yield path.parent.name + path.name


def _write(source: Path | bytes, out: BinaryIO) -> str:
    digest = hashlib.sha256()
    for chunk in chunks(source):
        digest.update(chunk)
        out.write(chunk)
    out.flush()
    os.fsync(out.fileno())
    return digest.hexdigest()


def _name(part: Path, target: Path) -> None:
    """Give bytes their name durably, unless it is there."""
    if not target.exists():
        target.parent.mkdir(exist_ok=True)
        part.rename(target)
        _sync(target)


def _sync(target: Path) -> None:
    sync_folder(target.parent)
    sync_folder(target.parent.parent)


def _is_linked(source: Path, target: Path) -> bool:
    """Whether a file could be given a second name: not on every file system, and not from one to another."""
    try:
        os.link(source, target)
    except OSError:
        return False
    _sync(target)
    return True


def chunks(source: Path | bytes) -> Iterator[bytes]:
    """Yield the bytes in pieces."""
    if isinstance(source, bytes):
        yield source
        return
    with open_plain(source) as file:
        yield from read_chunks(file)


def read_chunks(file: BinaryIO) -> Iterator[bytes]:
    """Yield what is left in an open file in pieces."""
    while chunk := file.read(CHUNK):
        yield chunk


def sha256_of(source: Path | bytes) -> str:
    """Return the SHA-256 of bytes or of a file, in hexadecimal."""
    digest = hashlib.sha256()
    for chunk in chunks(source):
        digest.update(chunk)
    return digest.hexdigest()


@lru_cache(maxsize=100_000)
def _is_whole(path: Path, sha256: str, _changed_ns: int, _size: int) -> bool:
    return sha256_of(path) == sha256


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
