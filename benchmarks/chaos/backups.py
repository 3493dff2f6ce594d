"""Backups during writes: each, restored into either database, is one library and gives the same answers."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from sqlalchemy import select

from benchmarks.chaos.kills import Load
from benchmarks.harness import postgres
from benchmarks.harness.live import started
from benchmarks.harness.sounds import sound
from casebase.store.database import create_engine_for, sqlite_url
from casebase.store.models import Case, StoredDiagnosis

RECORDINGS = 10
KNOWN_CASES = 12
WRITES = ("cases", "diagnoses")


def run(folder: Path, database: str, *, backups: int, seed: int) -> tuple[str, list[str]]:
    """Back up so many times while clients write to this database; what was done in words, and what was wrong."""
    with ExitStack() as stack:
        server_url = stack.enter_context(postgres.running_server())
        url = postgres.create_database(server_url, "written") if database == "postgresql" else None
        environment = {} if url is None else {"GEARCASE_DATABASE_URL": url}
        server = started(folder / "data", **environment)
        load = Load(server, seed, kinds=WRITES)
        clients = [threading.Thread(target=load.order, args=(number,)) for number in range(3)]
        copies: list[tuple[Path, frozenset[str]]] = []
        try:
            for client in clients:
                client.start()
            while len(load.acknowledged) < KNOWN_CASES:
                time.sleep(0.1)
            for number in range(backups):
                before = frozenset(load.acknowledged)
                copy = folder / f"backup_{number}"
                _gearcase("backup", copy, data_dir=folder / "data", environment=environment)
                copies.append((copy, before))
        finally:
            load.stop.set()
            for client in clients:
                client.join()
            server.stop()
        recordings = [folder / f"asked_{number}.wav" for number in range(RECORDINGS)]
        for number, path in enumerate(recordings):
            path.write_bytes(sound(10_000 + number, seconds=2.0, impacts=number % 2 == 0))
        last = folder / "backup_last"
        _gearcase("backup", last, data_dir=folder / "data", environment=environment)
        copies.append((last, frozenset(load.acknowledged)))
        here = _answers(recordings, folder / "data", environment)
        wrong = list(load.refused)
        for copy, before in copies:
            kept = {}
            for kind in ("sqlite", "postgresql"):
                data_dir = folder / f"{copy.name}_{kind}"
                to = (
                    {}
                    if kind == "sqlite"
                    else {"GEARCASE_DATABASE_URL": postgres.create_database(server_url, data_dir.name)}
                )
                _gearcase("restore", copy, data_dir=data_dir, environment=to)
                wrong += _missing(load, before, data_dir, to.get("GEARCASE_DATABASE_URL"), f"{copy.name} into {kind}")
                kept[kind] = _answers(recordings, data_dir, to)
            wrong += _differences(kept["sqlite"], kept["postgresql"], f"{copy.name}: SQLite and PostgreSQL")
            if copy == last:
                wrong += _differences(here, kept["postgresql"], "the library and its last backup")
    words = f"{len(load.acknowledged)} acknowledged, {len(copies)} backups, {2 * len(copies) * RECORDINGS} answers"
    return words, wrong


def _gearcase(*words: str | Path, data_dir: Path, environment: Mapping[str, str]) -> str:
    command = [sys.executable, "-m", "app", "--data-dir", str(data_dir), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
    if done.returncode:
        raise AssertionError(f"{words}: {done.returncode} {done.stdout} {done.stderr[-2000:]}")
    return done.stdout


def _answers(recordings: list[Path], data_dir: Path, environment: Mapping[str, str]) -> list[dict[str, Any]]:
    """The answers, without when they were given and as what they were stored."""
    said: list[dict[str, Any]] = json.loads(
        _gearcase("diagnose", *recordings, "--json", data_dir=data_dir, environment=environment)
    )
    for answer in said:
        for place, name in ((answer, "id"), (answer, "created_at"), (answer["recording"], "id")):
            assert place.pop(name)
        assert answer["provenance"].pop("given_at")
    return said


def _differences(here: list[dict[str, Any]], there: list[dict[str, Any]], what: str) -> Iterator[str]:
    for number, (one, other) in enumerate(zip(here, there, strict=True)):
        for name in sorted(one.keys() | other.keys()):
            if one.get(name) != other.get(name):
                yield f"{what}: recording {number}: {name} {one.get(name)} and {other.get(name)}"


def _missing(load: Load, before: frozenset[str], data_dir: Path, url: str | None, what: str) -> Iterator[str]:
    """What was acknowledged before the backup began is in it."""
    engine = create_engine_for(url or sqlite_url(data_dir / "gearcase.db"))
    with engine.connect() as connection:
        there = {*connection.scalars(select(Case.id)), *connection.scalars(select(StoredDiagnosis.id))}
    engine.dispose()
    for key in sorted(before):
        kind, location = load.acknowledged[key]
        if location.rsplit("/", 1)[1] not in there:
            yield f"{what}: {kind} {key} is not in it"
