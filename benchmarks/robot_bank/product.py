"""The product from outside: its command line and nothing else."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
COMMAND = str(Path(sys.executable).parent / "gearcase")
TIME_LIMIT_S = 600


@dataclass(frozen=True)
class Answer:
    """What the product printed, its exit code (None: it was stopped) and how long it took [s]."""

    stdout: str
    stderr: str
    code: int | None
    seconds: float

    @property
    def document(self) -> dict[str, Any] | None:
        """The document on stdout; None where there is none."""
        if self.code not in (0, 3):
            return None
        try:
            document = json.loads(self.stdout)
        except json.JSONDecodeError:
            return None
        return document if isinstance(document, dict) else None

    @property
    def failure(self) -> str | None:
        """Why there is no document; None where there is one."""
        if self.code is None:
            return f"took longer than {TIME_LIMIT_S} s"
        return None if self.document is not None else f"exit code {self.code}: {self.stderr.strip()[-600:]}"


def _run(arguments: list[str]) -> Answer:
    with tempfile.TemporaryDirectory() as data:
        environment = os.environ | {"GEARCASE_DATA_DIR": data, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        start = time.perf_counter()
        try:
            done = subprocess.run(
                [COMMAND, *arguments],
                cwd=ROOT, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return Answer("", "", None, float(TIME_LIMIT_S))
        return Answer(done.stdout, done.stderr, done.returncode, time.perf_counter() - start)


def investigate(folder: Path) -> Answer:
    """Let the product investigate robot.toml, log.csv and channels.toml of a folder."""
    files = {"--robot": "robot.toml", "--telemetry": "log.csv", "--channels": "channels.toml"}
    options = [part for option, name in files.items() for part in (option, str(folder / name))]
    return _run(["investigate", *options, "--json"])


def peak_mib() -> float:
    """Largest memory that any run started from this process has held [MiB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
