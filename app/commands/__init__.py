"""The verbs of the command line, and what the command line says of itself: exit codes, and where the data are."""

from contextvars import ContextVar
from pathlib import Path

DONE, FAILURE, BAD_INPUT, FAULT_FOUND, STOPPED = 0, 1, 2, 3, 130
DATA_DIR: ContextVar[Path | None] = ContextVar("data_dir", default=None)
"""The folder that `--data-dir` names; that of the settings where it names none."""
