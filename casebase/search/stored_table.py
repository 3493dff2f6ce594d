"""The case table in a file beside the database, so that a large library opens without reading every row.

The rows are the truth. A file is used only if the database names it, with its size and checksum: one that is half
written, spoilt, of another library or of a time that a restored database does not remember is never taken. What changed
after the file was written is read from the rows. The arrays are mapped into memory, not read: what a search does not
look at stays on disk.
"""

import os
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from casebase.search.case_table import CaseTable
from casebase.store.artifacts import add_artifact, list_artifacts
from casebase.store.audio_store import sync_folder
from casebase.store.models import Artifact, Case, new_id

FORMAT = 1
SMALLEST = 10_000
"""Smaller libraries are read from the rows in less than a tenth of a second."""
OUTGROWN = 0.01
"""The file is written again when more than this share of the cases changed; less is read from the rows."""
NAMED = 8
"""How many files the database names: those of so many machines may lie in data folders of their own."""
UNFINISHED = "unfinished.part"
"""Of one name, so that what a killed process leaves behind is overwritten; two at once spoil each other's checksum."""
BLOCK = 1 << 23
ALIGNED = 64
COLUMNS = ("ids", "labels", "origins", "axes", "gearboxes", "samples", "values")
DERIVED = ("sounds", "parts")
"""What follows from the columns and takes long to find."""


def kind_of(extractor_version: str) -> str:
    """Return the kind of the artifacts that name files."""
    return f"table/{extractor_version}"


def outgrown(session: Session, folder: Path, table: CaseTable) -> bool:
    """Whether a table should be written: it is large, and much changed since one that lies here was."""
    if len(table) < SMALLEST:
        return False
    named = _here(session, folder, table.extractor_version)
    if named is None:
        return True
    changed = select(func.count()).where(Case.library_version > int(str(named["version"])))
    return session.scalars(changed).one() > OUTGROWN * len(table)


def write_table(folder: Path, table: CaseTable) -> dict[str, object]:
    """Write a table, whole or not at all; return what the database is to say of it, see `name_table`."""
    folder.mkdir(parents=True, exist_ok=True)
    name, checksum, columns = f"{new_id()}.table", 0, []
    with (folder / UNFINISHED).open("wb") as file:
        for column in (*COLUMNS, *DERIVED):
            array = np.ascontiguousarray(getattr(table, column))
            start = -(-file.tell() // ALIGNED) * ALIGNED
            for block in (bytes(start - file.tell()), array.reshape(-1).view(np.uint8).data):
                checksum = zlib.crc32(block, checksum)
                file.write(block)
            columns.append({"name": column, "dtype": array.dtype.str, "shape": list(array.shape), "start": start})
        size = file.tell()
        file.flush()
        os.fsync(file.fileno())
    (folder / UNFINISHED).replace(folder / name)
    sync_folder(folder)
    return {
        "format": FORMAT,
        "file": name,
        "size": size,
        "crc32": checksum,
        "version": table.version,
        "names": list(table.names),
        "columns": columns,
    }


def name_table(session: Session, extractor_version: str, document: Mapping[str, object]) -> None:
    """Let the database name a file that was written."""
    kind = kind_of(extractor_version)
    row = add_artifact(session, kind, document)
    session.execute(delete(Artifact).where(Artifact.kind == kind, Artifact.version <= row.version - NAMED))


def remove_others(folder: Path, document: Mapping[str, object]) -> None:
    """Remove the files before this one, once the database has named it."""
    for path in folder.glob("*.table"):
        if path.name != document["file"]:
            path.unlink(missing_ok=True)


def read_table(session: Session, folder: Path, extractor_version: str) -> CaseTable | None:
    """Return the newest table that lies here whole and that the database names; None if there is none.

    A spoilt file is removed, so that it is written again.
    """
    named = _here(session, folder, extractor_version)
    if named is None:
        return None
    path = folder / str(named["file"])
    try:
        if path.stat().st_size != named["size"] or _checksum(path) != named["crc32"]:
            path.unlink(missing_ok=True)
            return None
        arrays = _mapped(path, named["columns"])
    except (OSError, ValueError):
        return None
    names = named["names"]
    assert isinstance(names, list)
    table = CaseTable(
        int(str(named["version"])), extractor_version, tuple(names), *(arrays[column] for column in COLUMNS)
    )
    table.__dict__.update({column: arrays[column] for column in DERIVED})
    return table


def _here(session: Session, folder: Path, extractor_version: str) -> Mapping[str, object] | None:
    """Return what the database says of the newest file that lies here."""
    for row in list_artifacts(session, kind_of(extractor_version)):
        if row.content.get("format") == FORMAT and (folder / str(row.content["file"])).exists():
            return row.content
    return None


def _checksum(path: Path) -> int:
    checksum = 0
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            checksum = zlib.crc32(block, checksum)
    return checksum


def _mapped(path: Path, columns: object) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file; writing to them changes no file."""
    assert isinstance(columns, Sequence)
    whole = np.memmap(path, np.uint8, "c")
    found = {}
    for column in columns:
        dtype, shape = np.dtype(column["dtype"]), tuple(column["shape"])
        end = column["start"] + int(np.prod(shape)) * dtype.itemsize
        found[column["name"]] = np.asarray(whole[column["start"] : end]).view(dtype).reshape(shape)
    return found
