"""Bytes of recordings, kept under their own SHA-256 and on disk before any row speaks of them."""

import hashlib
import os
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

from casebase.errors import DamagedError, NotFoundError
from casebase.store.stale_locks import hold

CHUNK = 1 << 20


@dataclass(frozen=True)
class StoredBytes:
    """What was put: SHA-256 in hexadecimal and the number of bytes."""

    sha256: str
    byte_count: int


@dataclass(frozen=True)
class AudioStore:
    """A folder of files named by content: `ab/cdef...`."""

    folder: Path

    def put(self, source: Path | bytes) -> StoredBytes:
        """Keep the bytes durably; the same bytes twice cost one file."""
        self.folder.mkdir(parents=True, exist_ok=True)
        part = self.folder / f".part-{os.getpid()}-{secrets.token_hex(8)}"
        try:
            with part.open("xb") as out:
                hold(out.fileno())
                stored = _write(source, out)
                target = self.path_of(stored.sha256)
                if not target.exists():
                    target.parent.mkdir(exist_ok=True)
                    part.rename(target)
                    sync_folder(target.parent)
                    sync_folder(self.folder)
        finally:
            part.unlink(missing_ok=True)
        return stored

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
            yield path.parent.name + path.name


def _write(source: Path | bytes, out: BinaryIO) -> StoredBytes:
    digest, count = hashlib.sha256(), 0
    for chunk in chunks(source):
        digest.update(chunk)
        count += len(chunk)
        out.write(chunk)
    out.flush()
    os.fsync(out.fileno())
    return StoredBytes(digest.hexdigest(), count)


def chunks(source: Path | bytes) -> Iterator[bytes]:
    """Yield the bytes in pieces."""
    if isinstance(source, bytes):
        yield source
        return
    with source.open("rb") as file:
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
