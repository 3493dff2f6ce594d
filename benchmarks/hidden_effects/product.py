"""The product under test, from outside: its command line and nothing else."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.hidden_effects.generator import Scenario, write

ROOT = Path(__file__).resolve().parents[2]
COMMAND = (sys.executable, "-m", "app")
TIME_LIMIT_S = 300
FILES = (
    ("--telemetry", "telemetry.csv"),
    ("--telemetry", "telemetry_2.csv"),
    ("--sound", "sound.wav"),
    ("--as-new", "as_new.wav"),
)
SEVERAL = "import json, sys; from app.cli import run; [run(arguments) for arguments in json.loads(sys.argv[1])]"


@dataclass(frozen=True)
class Answer:
    """What `investigate --json` said of one recording, or why it failed, and how long it took [s]."""

    document: dict[str, Any] | None
    failure: str | None
    seconds: float


def peak_mib() -> float:
    """Largest memory that any run of the product started from this process has held [MiB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0


def _run(command: Sequence[str], folder: Path, limit_s: float = TIME_LIMIT_S) -> subprocess.CompletedProcess[str]:
    """Run a command with its data in `folder`; what it prints is text."""
    data = str(folder / "data")
    environment = {**os.environ, "GEARCASE_DATA_DIR": data, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=limit_s, check=False
    )


def investigate(scenario: Scenario) -> Answer:
    """Write a scenario's files and let the product investigate them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(scenario, folder)
        return investigate_folder(folder)


def investigate_together(scenarios: Sequence[Scenario]) -> list[dict[str, Any]]:
    """Documents of several scenarios by one process, which starts once; telemetry only."""
    with tempfile.TemporaryDirectory() as name:
        verbs = []
        for place, scenario in enumerate(scenarios):
            folder = Path(name) / str(place)
            write(scenario, folder)
            files = ["--axis", str(folder / "axis.toml"), "--telemetry", str(folder / "telemetry.csv")]
            verbs.append(["investigate", *files, "--json"])
        return together(verbs, Path(name))


def together(verbs: Sequence[Sequence[str]], folder: Path) -> list[dict[str, Any]]:
    """Documents of several commands by one process, which starts once; its data are in `folder`."""
    done = _run([sys.executable, "-c", SEVERAL, json.dumps(verbs)], folder, TIME_LIMIT_S * len(verbs))
    done.check_returncode()
    documents, rest, decoder = [], done.stdout.strip(), json.JSONDecoder()
    while rest:
        document, end = decoder.raw_decode(rest)
        documents.append(document)
        rest = rest[end:].strip()
    return documents


def investigate_folder(folder: Path) -> Answer:
    """Let the product investigate axis.toml with whichever recordings the folder holds."""
    arguments = ["investigate", "--axis", str(folder / "axis.toml"), "--json"]
    for option, file in FILES:
        if (folder / file).exists():
            arguments += [option, str(folder / file)]
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as own:
        try:
            done = _run([*COMMAND, *arguments], Path(own))
        except subprocess.TimeoutExpired:
            return Answer(None, f"took longer than {TIME_LIMIT_S} s", float(TIME_LIMIT_S))
    seconds = time.perf_counter() - start
    if done.returncode not in (0, 3):
        return Answer(None, f"exit code {done.returncode}: {done.stderr.strip()[-800:]}", seconds)
    return Answer(json.loads(done.stdout), None, seconds)
