"""The product from outside: its command line in processes of its own."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from benchmarks.field_bank.bank import Known, write

ROOT = Path(__file__).resolve().parents[2]
BATCH = 40


@dataclass(frozen=True)
class Answer:
    """What the product said: a verdict (or `refused`), its label and probability, "" and None where it gave none."""

    verdict: str
    label: str
    probability: float | None


def run(*arguments: str) -> str:
    """Run the product and return what it printed. Raises RuntimeError with its words where it fails."""
    command = [sys.executable, "-m", "app", *arguments]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, check=False)
    if done.returncode not in (0, 1, 2) or (done.returncode and not done.stdout.strip()):
        raise RuntimeError(f"{' '.join(command[:8])} ended with {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout


def version() -> str:
    """Return a hash of the product's sources: a library filled by another version is not used again."""
    digest = hashlib.sha256()
    for folder in ("app", "casebase", "sim", "migrations"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def library(cache: Path, starter: bool, known: Sequence[Known], axis: Path | None) -> Path:
    """Return a data directory with these cases, from the cache where it was filled before.

    It grows by gearboxes from one that is filled already, so that a library of five serves the one of ten.
    """
    digest = hashlib.sha256(f"{version()} {starter} {axis and axis.read_bytes()!r}".encode())
    for k in known:
        digest.update(f"{k.label} {k.gearbox} {k.speed_rad_s} {k.payload_kg_m2}".encode())
        digest.update(k.sound.samples.tobytes())
    done = cache / digest.hexdigest()[:24]
    if done.exists():
        return done
    cache.mkdir(parents=True, exist_ok=True)
    making = Path(tempfile.mkdtemp(dir=cache, prefix="making-"))
    if known:
        last = known[-1].gearbox
        before = [k for k in known if k.gearbox != last]
        shutil.copytree(library(cache, starter, before, axis), making, dirs_exist_ok=True)
        fill(making, [k for k in known if k.gearbox == last], axis)
    elif starter:
        run("--data-dir", str(making), "starter", "--processes", "1")
    else:
        run("--data-dir", str(making), "cases", "list", "--json")
    making.rename(done)
    return done


def fill(data: Path, known: Sequence[Known], axis: Path | None) -> None:
    """Add cases to the library of a data directory."""
    with tempfile.TemporaryDirectory() as folder:
        for i, k in enumerate(known):
            file = write(k.sound, Path(folder) / f"case{i:03d}")
            about = ["--label", k.label, "--gearbox", k.gearbox]
            about += ["--speed", f"{k.speed_rad_s:.3f}", "--payload", f"{k.payload_kg_m2:.2f}"]
            about += ["--axis", str(axis)] if axis else []
            said = run("--data-dir", str(data), "cases", "add", str(file), *about, "--json")
            if '"error"' in said:
                raise RuntimeError(f"a case was refused: {said}")


def diagnose(data: Path, files: list[Path], axis: Path | None, jobs: int) -> dict[Path, Answer]:
    """Return the answers for files, asked in batches of copies of the data directory, which stays as it is."""
    answers: dict[Path, Answer] = {}
    with tempfile.TemporaryDirectory() as folder:
        free: SimpleQueue[Path] = SimpleQueue()
        for i in range(jobs):
            free.put(Path(shutil.copytree(data, Path(folder) / f"data{i}")))

        def ask(batch: list[Path]) -> None:
            copy = free.get()
            try:
                with_axis = ["--axis", str(axis)] if axis else []
                said = run("--data-dir", str(copy), "diagnose", *map(str, batch), *with_axis, "--json")
            finally:
                free.put(copy)
            told = json.loads(said)
            for entry in told if isinstance(told, list) else [told | {"file": str(batch[0])}]:
                answers[Path(entry["file"])] = Answer(
                    entry.get("verdict") or "refused", entry.get("label") or "", entry.get("probability")
                )

        batches = [files[i : i + BATCH] for i in range(0, len(files), BATCH)]
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(ask, batches))
    missing = [f.name for f in files if f not in answers]
    if missing:
        raise RuntimeError(f"no answer for {len(missing)} files: {missing[:5]}")
    return answers
