"""A backup counts when it has been restored."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import select

from casebase.errors import BackupError
from casebase.library import CaseLibrary
from casebase.search.case_filter import CaseFilter
from casebase.store.audio_store import AudioStore, sha256_of
from casebase.store.backup import CHECKSUMS, DATABASE, backup, restore, verify
from casebase.store.database import create_engine_for
from casebase.store.erasing import erase
from casebase.store.models import ApiKey, Base, BrowserSession, StoredRecording, new_id, now
from tests.casebase.sounds import add_sound, write_sound
from tests.signals.test_plain_file import odd


@pytest.fixture
def filled(tmp_path: Path) -> CaseLibrary:
    """A local library with three cases."""
    library = CaseLibrary.open(tmp_path / "live")
    for seed in range(3):
        add_sound(library, write_sound(tmp_path / f"{seed}.wav", seed), "notch")
    return library


def test_a_restored_library_is_the_same_library(filled: CaseLibrary, tmp_path: Path) -> None:
    assert backup(filled.engine, filled.data_dir, tmp_path / "copy") == 3
    assert verify(tmp_path / "copy") == ()
    assert restore(tmp_path / "copy", tmp_path / "restored") == 3
    restored = CaseLibrary.open(tmp_path / "restored")
    with filled.reading() as here, restored.reading() as there:
        before, after = (
            filled.retrieve.cases(here, CaseFilter()).items,
            restored.retrieve.cases(there, CaseFilter()).items,
        )
        assert [(case.id, case.label) for case in before] == [(case.id, case.label) for case in after]
        for case in after:
            assert restored.retrieve.audio_path(case.recording).stat().st_size == case.recording.byte_count
    filled.close()
    restored.close()


def contents(library: CaseLibrary) -> dict[str, list[str]]:
    """All rows of all tables, as words."""
    with library.reading() as session:
        return {
            table.name: sorted(
                json.dumps(dict(row), sort_keys=True, default=lambda each: getattr(each, "tolist", each.__str__)())
                for row in session.execute(select(table)).mappings()
            )
            for table in Base.metadata.sorted_tables
        }


def signed_in(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        key = ApiKey(name="key", role="viewer", key_sha256=new_id(), created_by="test")
        session.add(key)
        session.flush()
        session.add(BrowserSession(token_sha256=new_id(), key_id=key.id, expires_at=now()))


@pytest.mark.postgres
def test_a_backup_moves_between_sqlite_and_postgresql(
    filled: CaseLibrary, postgres_database_url: str, tmp_path: Path
) -> None:
    case = add_sound(filled, write_sound(tmp_path / "again.wav", 9), "play")
    with filled.transaction("anna") as session:
        filled.revise.retire(session, case.id)
    signed_in(filled)
    backup(filled.engine, filled.data_dir, tmp_path / "copy")
    engine = create_engine_for(postgres_database_url)
    restore(tmp_path / "copy", tmp_path / "large", engine)
    large = CaseLibrary(engine, tmp_path / "large")
    assert contents(large) == contents(filled) | {"sessions": []}
    signed_in(large)
    backup(engine, large.data_dir, tmp_path / "second")
    assert verify(tmp_path / "second") == ()
    restore(tmp_path / "second", tmp_path / "local")
    local = CaseLibrary.open(tmp_path / "local")
    assert contents(local) == contents(large) | {"sessions": []}
    with pytest.raises(BackupError, match="not empty"):
        restore(tmp_path / "second", tmp_path / "other", engine)
    assert not (tmp_path / "other").exists()
    add_sound(large, write_sound(tmp_path / "new.wav", 10), "play")
    for each in (filled, large, local):
        each.close()


def test_what_is_erased_during_a_backup_is_not_in_it(
    filled: CaseLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put, hashes = AudioStore.put, list(filled.audio.hashes())

    def meanwhile(store: AudioStore, source: Path | bytes) -> str:
        done = put(store, source)
        with filled.transaction("somebody") as session:  # the one that was just copied, and the last one
            for row in session.scalars(
                select(StoredRecording).where(StoredRecording.file_sha256.in_((hashes[0], hashes[-1])))
            ):
                erase(filled, session, row.id)
        return done

    monkeypatch.setattr(AudioStore, "put", meanwhile)
    assert backup(filled.engine, filled.data_dir, tmp_path / "copy") == 1
    assert verify(tmp_path / "copy") == ()
    assert list(AudioStore(tmp_path / "copy" / "audio").hashes()) == hashes[1:2]


def test_a_backup_is_taken_while_somebody_writes(filled: CaseLibrary, tmp_path: Path) -> None:
    with filled.transaction("anna") as session:
        filled.revise.retire(session, filled.retrieve.cases(session, CaseFilter()).items[0].id)
        backup(filled.engine, filled.data_dir, tmp_path / "copy")
    restore(tmp_path / "copy", tmp_path / "restored")
    restored = CaseLibrary.open(tmp_path / "restored")
    with restored.reading() as session:
        assert len(restored.retrieve.cases(session, CaseFilter()).items) == 3, "an open transaction is not in the copy"
    filled.close()
    restored.close()


@pytest.mark.parametrize("damage", ["flip", "lose", "break off", "database"])
def test_a_damaged_backup_restores_nothing(filled: CaseLibrary, tmp_path: Path, damage: str) -> None:
    copy = tmp_path / "copy"
    backup(filled.engine, filled.data_dir, copy)
    filled.close()
    audio = next(copy.glob("audio/??/*"))
    if damage == "flip":
        audio.write_bytes(audio.read_bytes()[:-1] + b"\x55")
    elif damage == "lose":
        audio.unlink()
    elif damage == "break off":
        (copy / CHECKSUMS).unlink()
    else:
        sums = json.loads((copy / CHECKSUMS).read_text())
        sums["files"].pop(next(name for name in sums["files"] if name != DATABASE))
        (copy / CHECKSUMS).write_text(json.dumps(sums))
    assert verify(copy)
    with pytest.raises(BackupError, match="not whole"):
        restore(copy, tmp_path / "restored")
    assert not (tmp_path / "restored").exists()


def test_nothing_is_overwritten(filled: CaseLibrary, tmp_path: Path) -> None:
    backup(filled.engine, filled.data_dir, tmp_path / "copy")
    with pytest.raises(BackupError, match="not empty"):
        backup(filled.engine, filled.data_dir, tmp_path / "copy")
    with pytest.raises(BackupError, match="not empty"):
        restore(tmp_path / "copy", filled.data_dir)
    filled.close()


@pytest.mark.parametrize("name", [CHECKSUMS, DATABASE, "audio/ab/pipe"])
@pytest.mark.parametrize("kind", ["pipe", "link", "socket"])
def test_a_backup_with_what_is_no_file_is_refused(filled: CaseLibrary, tmp_path: Path, name: str, kind: str) -> None:
    backup(filled.engine, filled.data_dir, tmp_path / "copy")
    path = tmp_path / "copy" / name
    path.parent.mkdir(exist_ok=True)
    if path.exists():
        path.rename(path.parent / "elsewhere")
    odd(path, kind)
    with pytest.raises(BackupError, match=path.name):
        restore(tmp_path / "copy", tmp_path / "restored")
    assert not (tmp_path / "restored").exists()


def test_a_backup_of_a_newer_version_is_refused(filled: CaseLibrary, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    backup(filled.engine, filled.data_dir, copy)
    with closing(sqlite3.connect(copy / DATABASE)) as newer:
        newer.execute("UPDATE alembic_version SET version_num = '9999'")
        newer.commit()
    sums = json.loads((copy / CHECKSUMS).read_text())
    sums["files"][DATABASE] = sha256_of(copy / DATABASE)
    (copy / CHECKSUMS).write_text(json.dumps(sums))
    with pytest.raises(BackupError, match="revision 9999"):
        restore(copy, tmp_path / "restored")
    assert not (tmp_path / "restored").exists()


def test_a_backup_has_no_stray_file_and_a_check_adds_none(filled: CaseLibrary, tmp_path: Path) -> None:
    filled.audio.put(b"nobody's")
    assert backup(filled.engine, filled.data_dir, tmp_path / "copy") == 3
    before = sorted((tmp_path / "copy").rglob("*"))
    assert verify(tmp_path / "copy") == ()
    assert sorted((tmp_path / "copy").rglob("*")) == before
