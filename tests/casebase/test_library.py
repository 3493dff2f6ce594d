"""A file and the row that speaks of it come together or not at all."""

import os
import threading
from pathlib import Path

import pytest

from app.upkeep import leftovers
from casebase.errors import DuplicateError
from casebase.library import CaseLibrary
from tests.casebase.made import store
from tests.casebase.sounds import add_sound, write_sound
from tests.casebase.test_identity import copy_of


def files(library: CaseLibrary) -> set[Path]:
    return {path for path in library.audio.folder.rglob("*") if path.is_file()}


def test_a_refused_case_leaves_no_file(library: CaseLibrary, tmp_path: Path) -> None:
    add_sound(library, write_sound(tmp_path / "a.wav", 1), "notch")
    before = files(library)
    with pytest.raises(DuplicateError):
        add_sound(library, copy_of(tmp_path / "a.wav", "a.flac"), "play")
    assert files(library) == before
    assert len(before) == 1


def test_a_file_changed_while_it_was_read_is_not_kept(library: CaseLibrary, tmp_path: Path) -> None:
    content = library.audio.content(write_sound(tmp_path / "a.wav", 1))
    (tmp_path / "a.wav").write_bytes(b"other")
    with pytest.raises(ValueError), library.transaction("test") as session:
        library.audio.keep(session, content)
    assert files(library) == set()


@pytest.mark.parametrize("committed", [True, False])
def test_a_kill_leaves_a_file_with_its_row_alone(sqlite_library: CaseLibrary, tmp_path: Path, committed: bool) -> None:
    library, child = sqlite_library, os.fork()
    if child == 0:
        with library.transaction("test") as session:
            store(library, session, [1.0])
            if committed:
                session.commit()
            os._exit(0)
    os.waitpid(child, 0)
    assert leftovers(library, tmp_path / "incoming", remove=False) == 1
    assert leftovers(library, tmp_path / "incoming", remove=True) == 1
    assert len(files(library)) == committed


def test_a_sweep_waits_for_who_is_naming_a_file(library: CaseLibrary, tmp_path: Path) -> None:
    with library.transaction("test") as session:
        row = store(library, session, [1.0])
        assert leftovers(library, tmp_path / "incoming", remove=False) == 0
        sweeping = threading.Thread(target=library.sweep, args=[[row.file_sha256]])
        sweeping.start()
        sweeping.join(0.2)
        assert sweeping.is_alive()
    sweeping.join()
    assert library.audio.path(row.file_sha256)
