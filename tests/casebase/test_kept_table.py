"""The table of the cases in a file: the same as the rows say, or not used at all."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import delete

from casebase.library import TABLES, CaseLibrary
from casebase.search import stored_table as kept_table
from casebase.search.case_table import CaseTable, load_table
from casebase.search.stored_table import read_table
from casebase.store.models import Artifact
from casebase.upkeep import keep_table
from tests.casebase.made import VERSION, add_case

COLUMNS = (*kept_table.COLUMNS, *kept_table.DERIVED)


@pytest.fixture(autouse=True)
def _however_small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_table, "SMALLEST", 1)


def filled(library: CaseLibrary, count: int = 6) -> CaseLibrary:
    with library.transaction("test") as session:
        for seed in range(count):
            box = None if seed == 3 else f"g{seed % 2}"
            add_case(
                library,
                session,
                [seed, np.nan if seed == 2 else 1.0],
                ("normal", "notch")[seed % 2],
                seed=seed,
                gearbox=box,
            )
    return library


def kept(library: CaseLibrary) -> CaseTable | None:
    with library.reading() as session:
        return read_table(session, library.data_dir / TABLES, VERSION)


def assert_is_what_the_rows_say(library: CaseLibrary) -> None:
    again = CaseLibrary(library.engine, library.data_dir)
    with library.reading() as session:
        rows, opened = load_table(session, VERSION), again.retrieve.all_cases(session, VERSION)
    assert (opened.version, opened.names) == (rows.version, rows.names)
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(opened, column), getattr(rows, column))


def test_file_is_mapped_and_what_changed_since_is_read_from_the_rows(library: CaseLibrary) -> None:
    filled(library)
    assert keep_table(library, "test", VERSION)
    assert not keep_table(library, "test", VERSION), "nothing changed"
    table = kept(library)
    assert table is not None
    assert isinstance(table.values.base.base, np.memmap)  # type: ignore[union-attr]
    assert_is_what_the_rows_say(library)
    with library.transaction("test") as session:
        library.revise.retire(session, str(table.ids[0]))
        library.revise.case(session, str(table.ids[1]), {"label": "play"})
        add_case(library, session, [9.0, 9.0], "normal", seed=9)
    assert_is_what_the_rows_say(library)
    assert keep_table(library, "test", VERSION), "much changed"
    assert len(list((library.data_dir / TABLES).iterdir())) == 1
    assert_is_what_the_rows_say(library)


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size - 1)


@pytest.mark.parametrize("spoil", [flipped, cut, Path.unlink])
def test_spoilt_file_is_not_used_and_written_again(sqlite_library: CaseLibrary, spoil: Callable[[Path], None]) -> None:
    library = filled(sqlite_library)
    keep_table(library, "test", VERSION)
    (path,) = (library.data_dir / TABLES).iterdir()
    spoil(path)
    assert kept(library) is None
    assert_is_what_the_rows_say(library)
    assert keep_table(library, "test", VERSION)
    assert kept(library) is not None


def test_file_that_the_database_does_not_remember_is_not_used(sqlite_library: CaseLibrary) -> None:
    """As after a backup from before was restored, or a folder of another library was put in its place."""
    library = filled(sqlite_library)
    keep_table(library, "test", VERSION)
    with library.transaction("test") as session:
        session.execute(delete(Artifact).where(Artifact.kind == kept_table.kind_of(VERSION)))
    assert kept(library) is None
    assert_is_what_the_rows_say(library)


CHILD = """
import sys
from pathlib import Path
from casebase.search import stored_table as kept_table
from casebase.library import CaseLibrary
from casebase.upkeep import keep_table
from tests.casebase.made import VERSION
kept_table.SMALLEST, kept_table.OUTGROWN = 1, -1.0
library = CaseLibrary.open(Path(sys.argv[1]))
while True:
    keep_table(library, "child", VERSION)
    print("written", flush=True)
"""


def test_kill_at_any_moment_leaves_a_whole_table_or_none(tmp_path: Path) -> None:
    library = filled(CaseLibrary.open(tmp_path))
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    child.stdout.readline()
    for after_s in (0.003, 0.011, 0.0):
        child.stdout.readline()
        time.sleep(after_s)
    child.kill()
    child.wait()
    child.stdout.close()
    assert_is_what_the_rows_say(library)
    assert kept(library) is not None, "the one before is there until the next is named"
    library.close()
