"""Backups of a service under load, some killed midway; each whole one is restored and held against what was known."""

import os
import random
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import func, select

from app.recordings.bundle_import import imports
from benchmarks.harness import postgres
from casebase.library import CaseLibrary
from casebase.recordings import IMPORTS
from casebase.store.models import Case, StoredDiagnosis, StoredInvestigation, StoredJob, StoredRecording

TABLES = {
    "cases": Case, "diagnoses": StoredDiagnosis, "simulations": StoredJob, "investigations": StoredInvestigation,
}  # fmt: skip
BETWEEN_S, UNTIL_KILLED_S = (5.0, 20.0), (0.8, 5.0)
KILLED = 0.4
PIECE = 48
"""Bytes of samples by which a sound is known."""


@dataclass
class Acknowledged:
    """What the service has answered for.

    Args:
        made: by key, the kind and the id; of an import, the hashes of its sounds.
        erased: by the id of a recording, its file.
    """

    made: dict[str, tuple[str, list[str]]] = field(default_factory=dict)
    erased: dict[str, bytes] = field(default_factory=dict)

    def so_far(self) -> "Acknowledged":
        return Acknowledged(dict(self.made), dict(self.erased))

    def count(self, kind: str) -> int:
        return sum(kind == each for each, _ in self.made.values())

    def missing(self, library: CaseLibrary) -> Iterator[str]:
        """What a library lacks of it, has twice, or has although it was erased."""
        with library.reading() as session:
            for key, (kind, ids) in self.made.items():
                for each in ids:
                    of_sound = (
                        select(func.count(Case.id)).join(Case.recording).where(StoredRecording.file_sha256 == each)
                    )
                    imported = kind == "imports"
                    there = session.scalar(of_sound) if imported else int(session.get(TABLES[kind], each) is not None)
                    if there != 1:
                        yield f"{'lost' if not there else 'doubled'}: {kind} {key}, {each}"
            for each in self.erased:
                row = session.get(StoredRecording, each)
                if row is None or row.erased_at is None:
                    yield f"not erased: recording {each}"
        yield from (
            f"bytes of the erased recording {each} are in {path}" for each, path in self.showing([library.data_dir])
        )

    def showing(self, folders: Iterable[Path]) -> Iterator[tuple[str, Path]]:
        """Yield erased recordings and the files that have samples of them."""
        for path in files(folders):
            content = path.read_bytes()
            for each, sound in self.erased.items():
                places = (len(sound) // 4, len(sound) // 2, 3 * len(sound) // 4)
                if any(sound[at : at + PIECE] in content for at in places):
                    yield each, path


def files(folders: Iterable[Path]) -> Iterator[Path]:
    return (path for folder in folders for path in folder.rglob("*") if path.is_file())


def command(data_dir: Path, url: str | None, *words: str | Path, killed_after: float | None = None) -> tuple[int, str]:
    """Run the command line in a process of its own; its exit code and what it wrote."""
    environment = {**os.environ} | ({} if url is None else {"GEARCASE_DATABASE_URL": url})
    process = subprocess.Popen(
        [sys.executable, "-m", "app", *map(str, words), "--data-dir", str(data_dir)],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        written, _ = process.communicate(timeout=killed_after)
    except subprocess.TimeoutExpired:
        process.kill()
        written, _ = process.communicate()
    return process.returncode, written


@dataclass
class Copies:
    """Backups that are made one after the other until told to stop.

    Args:
        server: of PostgreSQL, and `url` the database on it; None for SQLite.
    """

    data_dir: Path
    server: str | None
    url: str | None
    known: Acknowledged
    chance: random.Random
    stop: threading.Event
    made: list[tuple[Path, Acknowledged, bool]] = field(default_factory=list)
    """The folder, what was acknowledged before, and whether the backup ended well."""
    wrong: list[str] = field(default_factory=list)
    done: Counter[str] = field(default_factory=Counter)

    def keep_on(self) -> None:
        while not self.stop.wait(self.chance.uniform(*BETWEEN_S)):
            known = self.known.so_far()
            if not known.count("cases"):
                continue
            target = self.data_dir.parent / f"backup_{len(self.made)}"
            code, written = command(self.data_dir, self.url, "backup", target, killed_after=self._until_killed())
            self.made.append((target, known, code == 0))
            self.done["backups" if code == 0 else "backups killed"] += 1
            if code > 0:
                self.wrong.append(f"{target.name}: {written[-1000:]}")

    def restored(self) -> Iterator[str]:
        """Restore all of them; what is wrong with what comes back."""
        yield from self.wrong
        for folder, known, whole in self.made:
            after = self._until_killed()
            if after is not None:
                yield from self._restored(folder, known, whole, f"killed_{folder.name}", after)
            yield from self._restored(folder, known, whole, f"restored_{folder.name}", None)

    def _restored(
        self, folder: Path, known: Acknowledged, whole: bool, name: str, after: float | None
    ) -> Iterator[str]:
        data_dir = folder.with_name(name)
        url = None if self.server is None else postgres.create_database(self.server, name)
        code, written = command(data_dir, url, "restore", folder, killed_after=after)
        self.done["restores" if code == 0 else "restores killed" if code < 0 else "restores refused"] += 1
        if code > 0 and (whole or data_dir.exists()):
            yield f"{folder.name} cannot be restored: {written[-1000:]}"
        if code == 0:
            yield from (f"{name}: {each}" for each in checked(data_dir, url, known))
        if self.server is not None:
            postgres.drop_database(self.server, name)

    def _until_killed(self) -> float | None:
        return self.chance.uniform(*UNTIL_KILLED_S) if self.chance.random() < KILLED else None


def checked(data_dir: Path, url: str | None, known: Acknowledged) -> Iterator[str]:
    """What `gearcase doctor --thorough` finds, and what is missing of what was acknowledged."""
    code, written = command(data_dir, url, "doctor", "--thorough")
    if code:
        yield f"doctor: {written[-1000:]}"
    library = CaseLibrary.open(data_dir, url)
    with library.reading() as session:
        ordered = StoredJob.kind == IMPORTS, StoredJob.finished_at.is_(None)
        waiting = session.scalars(select(StoredJob.parameters).where(*ordered)).all()
    for asked in waiting:  # a backup has the bundles of imports that were ordered: a worker would do them
        imports(library).run(dict(asked), lambda _stage, _fraction: None)
    yield from known.missing(library)
    library.close()
