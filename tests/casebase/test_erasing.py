"""Erased audio is gone and stays gone; what was learned from it stays."""

import json
import zipfile
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import update

from casebase.description import RecordingDescription
from casebase.errors import ErasedError, NotFoundError
from casebase.library import CaseLibrary
from casebase.search.case_filter import CaseFilter
from casebase.store import audit
from casebase.store.backup import backup, erased_in, restore, verify
from casebase.store.bundle import MANIFEST, export_cases, import_cases
from casebase.store.erasing import erase, expire
from casebase.store.models import StoredRecording, now
from signals.condition import OperatingCondition
from signals.features import extract
from signals.reading.decode import read_recording
from tests.casebase.sounds import add_sound, write_sound
from tests.casebase.test_identity import copy_of


def stored(library: CaseLibrary, path: Path, gearbox: str = "g0") -> StoredRecording:
    """Store a recording that is no case."""
    recording = read_recording(path)
    extraction = extract(recording, OperatingCondition(speed_rad_s=2.5))
    with library.transaction("otto") as session:
        description = RecordingDescription(path.name, gearbox=gearbox)
        return library.retain.recording(session, path, recording, extraction, description)


def gone(library: CaseLibrary, recording_id: str) -> bool:
    """Whether the audio is erased by the rows and by the disk."""
    with library.reading() as session:
        row = library.retrieve.recording(session, recording_id)
    there = library.audio.path_of(row.file_sha256).exists()
    assert there == (row.erased_at is None)
    return not there


def test_audio_goes_and_all_else_stays(library: CaseLibrary, tmp_path: Path) -> None:
    case = add_sound(library, write_sound(tmp_path / "a.wav", 1), "notch")
    other = stored(library, tmp_path / "a.wav", gearbox="g7")
    alike = stored(library, copy_of(tmp_path / "a.wav", "a.flac"))
    with library.transaction("anna") as session:
        done = erase(library, session, case.recording_id)
        assert library.audio.path_of(case.recording.file_sha256).exists(), "not before the commit"
    assert (done.id, done.erased_by) == (case.recording_id, "anna")
    assert set(done.recordings) == {case.recording_id, other.id, alike.id}
    assert all(gone(library, each) for each in done.recordings)
    with library.reading() as session:
        row = library.retrieve.recording(session, case.recording_id)
        with pytest.raises(ErasedError, match="anna"):
            library.retrieve.audio_path(row)
        assert [len(library.retrieve.recording(session, each).features) for each in (case.recording_id, other.id)] == [
            1,
            1,
        ]
        assert library.retrieve.table(session).ids.tolist() == [case.id]
        actions = [entry.action for entry in audit.history(session, "recording", case.recording_id)]
    assert actions == ["recording.stored", "recording.erased"]


def test_erasing_again_changes_nothing(library: CaseLibrary, tmp_path: Path) -> None:
    row = stored(library, write_sound(tmp_path / "a.wav", 1))
    with library.transaction("anna") as session:
        first = erase(library, session, row.id)
    with library.transaction("bert") as session:
        again = erase(library, session, row.id)
        assert (again.erased_at, again.erased_by) == (first.erased_at, "anna")
        assert len(audit.history(session, "recording", row.id)) == 2
        with pytest.raises(NotFoundError):
            erase(library, session, "no such id")


def test_a_rolled_back_erasure_erases_nothing(library: CaseLibrary, tmp_path: Path) -> None:
    row = stored(library, write_sound(tmp_path / "a.wav", 1))

    def fails() -> None:
        with library.transaction("anna") as session:
            erase(library, session, row.id)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fails()
    assert not gone(library, row.id)


@pytest.mark.parametrize("gearbox", ["g0", "g1"])
def test_bytes_that_were_erased_are_not_kept_when_they_come_again(
    library: CaseLibrary, tmp_path: Path, gearbox: str
) -> None:
    path = write_sound(tmp_path / "a.wav", 1)
    first = stored(library, path)
    with library.transaction("anna") as session:
        erase(library, session, first.id)
    again = stored(library, path, gearbox)
    assert (again.id == first.id) == (gearbox == "g0")
    assert gone(library, again.id)
    assert list(library.audio.hashes()) == []


def test_what_is_old_and_no_case_is_erased(library: CaseLibrary, tmp_path: Path) -> None:
    case = add_sound(library, write_sound(tmp_path / "case.wav", 1), "notch")
    same_file = stored(library, tmp_path / "case.wav", gearbox="g9")
    old, kept, young = (stored(library, write_sound(tmp_path / f"{seed}.wav", seed)) for seed in (2, 3, 4))
    young_again = stored(library, write_sound(tmp_path / "5.wav", 5))
    with library.transaction("test") as session:
        session.execute(update(StoredRecording).values(created_at=now() - timedelta(days=31)))
        session.execute(update(StoredRecording).where(StoredRecording.id == young.id).values(created_at=now()))
    newer = stored(library, tmp_path / "5.wav", gearbox="g5")
    assert expire(library, "retention", 30, keep=[kept.id]) == [old.id]
    ids = (case.recording_id, same_file.id, old.id, kept.id, young.id, young_again.id, newer.id)
    assert [gone(library, each) for each in ids] == [False, False, True, False, False, False, False]
    assert expire(library, "retention", 30, keep=[kept.id]) == []


def test_bytes_that_a_crash_left_go_with_the_next_look(library: CaseLibrary, tmp_path: Path) -> None:
    row = stored(library, write_sound(tmp_path / "a.wav", 1))
    with library.transaction("anna") as session:
        erase(library, session, row.id)
    library.audio.put(tmp_path / "a.wav")
    expire(library, "retention", 30)
    assert gone(library, row.id)


def test_a_bundle_says_which_cases_have_no_audio(library: CaseLibrary, tmp_path: Path) -> None:
    erased = add_sound(library, write_sound(tmp_path / "a.wav", 1), "notch")
    add_sound(library, write_sound(tmp_path / "b.wav", 2), "notch")
    with library.transaction("anna") as session:
        erase(library, session, erased.recording_id)
    with library.reading() as session:
        done = export_cases(library, session, tmp_path / "all.zip", CaseFilter())
    assert (done.cases, done.without_audio) == (2, 1)
    with zipfile.ZipFile(tmp_path / "all.zip") as bundle:
        entries = json.loads(bundle.read(MANIFEST))["cases"]
        assert len(bundle.namelist()) == 2
    assert [entry["audio"] is None for entry in entries] == [entry["erased_at"] is not None for entry in entries]
    other = CaseLibrary.open(tmp_path / "other")
    imported = import_cases(other, tmp_path / "all.zip", "bert")
    assert len(imported.case_ids) == 1
    assert ["erased" in reason for reason in imported.refused.values()] == [True]
    other.close()


def test_a_backup_says_what_was_erased_and_misses_nothing(library: CaseLibrary, tmp_path: Path) -> None:
    row = stored(library, write_sound(tmp_path / "a.wav", 1))
    stored(library, write_sound(tmp_path / "b.wav", 2))
    backup(library.engine, library.data_dir, tmp_path / "before")
    with library.transaction("anna") as session:
        erase(library, session, row.id)
    assert backup(library.engine, library.data_dir, tmp_path / "after") == 1
    assert verify(tmp_path / "after") == ()
    assert (erased_in(tmp_path / "before"), erased_in(tmp_path / "after")) == ((), (row.id,))
    restore(tmp_path / "after", tmp_path / "restored")
    restored = CaseLibrary.open(tmp_path / "restored")
    assert gone(restored, row.id)
    restored.close()
