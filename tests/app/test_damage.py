"""A disk that spoils what is stored is found out and said with the way out; what is ours is for our eyes alone."""

import io
import json
import os
import random
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text

from app.commands import FAILURE
from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.live import gearcase
from benchmarks.harness.sounds import sound
from casebase.library import CaseLibrary
from casebase.store.database import LARGEST_LOG, create_engine_for, sqlite_url
from casebase.store.integrity import cut_logs, faults_of
from casebase.store.stale_locks import hold

API = "/api/v1"
PAGE = 4096


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Inside]:
    with inside(tmp_path / "data") as found:
        yield found


def filled(data_dir: Path) -> Path:
    """A library with rows on many pages; return the path of its database."""
    library = CaseLibrary.open(data_dir)
    with library.engine.begin() as connection:
        connection.execute(text("CREATE TABLE filling (id INTEGER PRIMARY KEY, words TEXT)"))
        connection.execute(text("CREATE INDEX by_words ON filling (words)"))
        rows = [{"words": f"{number * 7919 % 10_007:06d}" * 20} for number in range(3000)]
        connection.execute(text("INSERT INTO filling (words) VALUES (:words)"), rows)
    library.close()
    cut_logs(data_dir)
    return data_dir / "gearcase.db"


def spoil(path: Path, seed: int, pages: int) -> None:
    dice = random.Random(seed)
    with path.open("r+b") as file:
        for _ in range(pages):
            file.seek(PAGE * dice.randrange(2, path.stat().st_size // PAGE))
            file.write(dice.randbytes(PAGE))


@pytest.mark.parametrize("pages", [1, 3, 20])
def test_spoilt_pages_are_found_by_doctor_and_at_the_start_with_the_way_out(tmp_path: Path, pages: int) -> None:
    database = filled(tmp_path / "data")
    assert gearcase("doctor", data_dir=tmp_path / "data").stdout.startswith("good   database")
    spoil(database, pages, pages)
    for words in (("doctor",), ("doctor", "--thorough"), ("serve", "--port", "0")):
        done = gearcase(*words, data_dir=tmp_path / "data")
        assert done.code == FAILURE
        assert "restore BACKUP" in done.stdout + done.stderr
        assert "Traceback" not in done.stderr


def test_a_file_that_is_no_database_any_more_is_said(tmp_path: Path) -> None:
    database = filled(tmp_path / "data")
    with database.open("r+b") as file:
        file.write(bytes(200))
    for words in (("cases", "list"), ("doctor",), ("serve", "--port", "0")):
        done = gearcase(*words, data_dir=tmp_path / "data")
        assert (done.code, "Traceback" in done.stderr) == (FAILURE, False)
        assert "the database is damaged" in done.stderr
        assert "restore BACKUP" in done.stderr


def test_a_database_that_is_spoilt_while_it_is_served_is_said(service: Inside) -> None:
    library = service.service.library
    with library.engine.begin() as connection:
        connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)")
    library.engine.dispose()
    with (library.data_dir / "gearcase.db").open("r+b") as file:
        file.seek(PAGE)
        file.write(b"\xff" * (library.data_dir / "gearcase.db").stat().st_size)
    answer = service.ask("GET", f"{API}/cases")
    assert (answer.status_code, answer.json()["type"]) == (500, "damaged")
    assert "restore BACKUP" in answer.json()["detail"]


def test_a_flipped_byte_of_audio_is_not_served(service: Inside) -> None:
    files = {"file": ("a.wav", sound(3, seconds=1.0), "audio/wav")}
    made = service.ask("POST", f"{API}/diagnoses", files=files).json()
    path = f"{API}/recordings/{made['recording']['id']}"
    assert service.ask("GET", f"{path}/audio").status_code == 200
    library = service.service.library
    (sha256,) = library.audio.hashes()
    content = bytearray(library.audio.path(sha256).read_bytes())
    content[1000] ^= 1
    library.audio.path(sha256).write_bytes(content)
    for part in ("audio", "waveform", "spectrogram"):
        answer = service.ask("GET", f"{path}/{part}")
        assert (answer.status_code, answer.json()["type"]) == (500, "damaged")
        assert f"audio/{sha256[:2]}/{sha256[2:]}" in answer.json()["detail"]
    done = gearcase("doctor", "--thorough", data_dir=library.data_dir)
    assert "1 changed" in done.stdout


def test_an_export_leaves_nothing_behind_even_where_it_fails(service: Inside) -> None:
    files = {"file": ("a.wav", sound(5, seconds=1.0))}
    service.ask("POST", f"{API}/cases", files=files, data={"metadata": '{"label": "normal"}'}).raise_for_status()
    library = service.service.library
    there = set(library.data_dir.iterdir())
    whole = service.browse("GET", "/library/export.zip")
    assert zipfile.ZipFile(io.BytesIO(whole.content)).testzip() is None
    (sha256,) = library.audio.hashes()
    library.audio.discard(sha256)
    assert service.browse("GET", "/library/export.zip").status_code == 404
    assert set(library.data_dir.iterdir()) == there


def test_the_data_folder_is_for_its_owner_alone(service: Inside) -> None:
    service.ask("POST", f"{API}/diagnoses", files={"file": ("a.wav", sound(4, seconds=1.0))}).raise_for_status()
    folder = service.service.library.data_dir
    assert folder.stat().st_mode & 0o777 == 0o700
    for path in folder.rglob("*"):
        assert path.stat().st_mode & 0o077 == 0, path


def test_an_open_folder_of_an_earlier_version_is_closed(tmp_path: Path) -> None:
    database = filled(tmp_path / "data")
    database.chmod(0o644)
    database.parent.chmod(0o755)
    CaseLibrary.open(database.parent).close()
    assert (database.stat().st_mode & 0o777, database.parent.stat().st_mode & 0o777) == (0o600, 0o700)


def test_the_log_beside_the_database_shrinks_again(tmp_path: Path) -> None:
    engine = create_engine_for(sqlite_url(tmp_path / "large.db"))
    log = tmp_path / "large.db-wal"
    with engine.begin() as connection:
        connection.execute(text("CREATE TABLE filling (content BLOB)"))
        connection.execute(text("INSERT INTO filling VALUES (randomblob(:size))"), {"size": 2 * LARGEST_LOG})
    assert log.stat().st_size > LARGEST_LOG
    for _ in range(2):
        with engine.begin() as connection:
            connection.execute(text("INSERT INTO filling VALUES ('after it')"))
    assert log.stat().st_size <= LARGEST_LOG
    cut_logs(tmp_path)
    assert log.stat().st_size == 0
    assert faults_of(engine, thorough=True) == ()
    engine.dispose()


def leftovers(data_dir: Path, *words: str) -> tuple[str, bool]:
    """What doctor says of them, and whether it is wrong."""
    found = json.loads(gearcase("doctor", *words, "--json", data_dir=data_dir).stdout)[-1]
    return found["found"], found["fault"] is not None


def test_doctor_offers_to_remove_what_no_row_speaks_of(tmp_path: Path) -> None:
    library = CaseLibrary.open(tmp_path / "data")
    library.audio.put(b"left by an older version")
    library.close()
    found, wrong = leftovers(tmp_path / "data")
    assert ("1 files of audio that no row speaks of" in found, wrong) == (True, True)
    assert not leftovers(tmp_path / "data", "--sweep")[1]
    assert list(library.audio.hashes()) == []


def everything(folder: Path) -> dict[Path, tuple[int, bytes]]:
    return {path: (path.stat().st_mode, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("state", ["whole", "killed", "newer", "other mode"])
def test_doctor_changes_nothing(tmp_path: Path, state: str) -> None:
    database = filled(tmp_path / "data")
    with closing(sqlite3.connect(database)) as connection:
        if state == "newer":
            connection.execute("UPDATE alembic_version SET version_num = '9999'")
            connection.commit()
    if state == "other mode":
        database.chmod(0o644)
    if state == "killed":
        child = os.fork()
        if child == 0:
            sqlite3.connect(database).executescript("INSERT INTO filling (words) VALUES ('killed')")
            os._exit(0)
        os.waitpid(child, 0)
    before = everything(tmp_path / "data")
    done = gearcase("doctor", data_dir=tmp_path / "data")
    after = everything(tmp_path / "data")
    assert {path: after[path] for path in after if path.suffix != ".db-shm"} == {
        path: before[path] for path in before if path.suffix != ".db-shm"
    }
    assert ("9999" in done.stdout, "Traceback" in done.stderr) == (state == "newer", False)


def test_doctor_counts_what_the_next_start_removes_and_nothing_that_is_under_way(service: Inside) -> None:
    library, incoming = service.service.library, service.service.settings.incoming
    library.audio.folder.mkdir()
    (library.audio.folder / ".part-1-a").write_bytes(b"half")
    for name in ("left", "held"):
        (incoming / name).mkdir(parents=True)
    descriptor = os.open(incoming / "held", os.O_RDONLY)
    hold(descriptor)
    left = []
    for _ in range(2):
        left.append(gearcase("doctor", data_dir=library.data_dir).stdout.partition("leftovers: ")[2])
        service.service.tidy()
    os.close(descriptor)
    assert [each.partition(" ")[0] for each in left] == ["2", "0"]
    assert [path.name for path in incoming.iterdir()] == ["held"]
