"""Case bundles, opened in the limited process: names, counts, sizes and nesting are checked on what is really read."""

import json
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import PurePosixPath
from typing import Any

from casebase.errors import BundleError
from signals.errors import TextError
from signals.reading.documents import check_nesting
from signals.reading.limited_worker import RefusedError, Send

MANIFEST = "manifest.json"
CHUNK = 1 << 20
UNREADABLE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    NotImplementedError,
    OSError,
    OverflowError,
    RuntimeError,
    UnicodeError,
    ValueError,
)
"""What `zipfile` raises of a spoilt archive: a method or a password that it does not know, too, and a wrong offset."""


def manifest(request: Mapping[str, Any], limits: Mapping[str, float], send: Send) -> None:
    """Task: check all names of the bundle at `path`, and send its manifest as JSON."""
    with _opened(request, limits) as bundle:
        text = b"".join(_entry(bundle, MANIFEST, int(limits["manifest_bytes"])))
        try:
            document = json.loads(text)
            check_nesting(document, "JSON", int(limits["manifest_bytes"]))
            send(json.dumps(document, allow_nan=False).encode())
        except (ValueError, RecursionError, TextError) as error:
            raise BundleError(f"{MANIFEST} is no JSON that is read here: {error}") from error


def entry(request: Mapping[str, Any], limits: Mapping[str, float], send: Send) -> None:
    """Task: send what the entry `name` of the bundle at `path` holds."""
    with _opened(request, limits) as bundle:
        for part in _entry(bundle, str(request["name"]), int(limits["file_bytes"])):
            send(part)


@contextmanager
def _opened(request: Mapping[str, Any], limits: Mapping[str, float]) -> Iterator[zipfile.ZipFile]:
    try:
        with open(request["path"], "rb") as file, zipfile.ZipFile(file) as bundle:
            packed = file.seek(0, 2)
            _check_names(bundle, packed, limits)
            yield bundle
    except BundleError as error:
        raise RefusedError("bundle", str(error)[:2000]) from error
    except UNREADABLE as error:
        raise RefusedError("bundle", f"this is no readable ZIP: {str(error)[:1000]}") from error


def _check_names(bundle: zipfile.ZipFile, packed_bytes: int, limits: Mapping[str, float]) -> None:
    """Raise BundleError for too many entries, a name that leaves the folder, a link, a name twice, or a bomb."""
    infos = bundle.infolist()
    if len(infos) > limits["entries"]:
        raise BundleError(f"{len(infos)} entries; at most {limits['entries']} are allowed: split the bundle")
    seen: set[str] = set()
    for info in infos:
        path = PurePosixPath(info.filename)
        if path.is_absolute() or ".." in path.parts or "\\" in info.filename or ":" in info.filename:
            raise BundleError(f"the name {info.filename[:100]!r} leads out of the bundle")
        if stat.S_ISLNK(info.external_attr >> 16):
            raise BundleError(f"{info.filename[:100]!r} is a link; a bundle holds plain files only")
        if path.as_posix() in seen:
            raise BundleError(f"{info.filename[:100]!r} is there twice")
        seen.add(path.as_posix())
    declared = sum(info.file_size for info in infos)
    if declared > limits["total_bytes"] or declared > limits["ratio"] * max(packed_bytes, 1):
        raise BundleError(
            f"{packed_bytes} bytes claim to hold {declared}; at most {limits['ratio']:.0f} times as much and "
            f"{limits['total_bytes']} bytes are allowed"
        )


def _entry(bundle: zipfile.ZipFile, name: str, most: int) -> Iterator[bytes]:
    """Yield what an entry really holds; raises BundleError once it is more than allowed or than declared."""
    try:
        declared = bundle.getinfo(name).file_size
    except KeyError as error:
        raise BundleError(f"the bundle has no {name[:100]!r}") from error
    count = 0
    with bundle.open(name) as file:
        while part := file.read(CHUNK):
            count += len(part)
            if count > min(most, declared):
                raise BundleError(f"{name[:100]!r} holds more than the {min(most, declared)} bytes allowed")
            yield part
