"""Logs: one JSON object per line, on stderr or in a folder; of bounded length, with the request's id, without keys."""

import logging
import os
import re
import signal
import sys
import threading
from collections.abc import MutableMapping
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any, NoReturn

import structlog

KEY = re.compile(r"gearcase_[A-Za-z0-9_-]{8,}")
HIDDEN = "gearcase_[hidden]"
LONGEST, LONGEST_TRACE = 2_000, 20_000
"""Characters of one text of an entry, and of the trace of an error."""


FILE_BYTES, FILES = 10_000_000, 3
"""Of a log in a folder: so large, and so many older ones are kept."""


def shown(_: Any, __: str, event: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """Processor: in any text of the entry hide what looks like a key, and shorten what is longer than anybody reads.

    >>> len(shown(None, "", {"path": "/" * 60_000})["path"]) < 2_100
    True
    """
    for name, value in event.items():
        if isinstance(value, str):
            event[name] = _shortened(KEY.sub(HIDDEN, value), LONGEST_TRACE if name == "exception" else LONGEST)
    return event


def _shortened(text: str, longest: int) -> str:
    """Keep both ends: of a trace, the last line says most."""
    if len(text) <= longest:
        return text
    return f"{text[: longest // 2]} [{len(text) - longest} characters left out] {text[-(longest // 2) :]}"


def _file(folder: Path, program: str) -> logging.Handler:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    return RotatingFileHandler(folder / f"{program}.log", maxBytes=FILE_BYTES, backupCount=FILES, encoding="utf-8")


def configure_logs(program: str, folder: Path | None = None, level: int = logging.INFO) -> None:
    """Send structlog's and the standard library's entries (uvicorn, SQLAlchemy) as JSON lines to stderr.

    With a folder they go to files in it that are named after the program, the newest without a number.
    """
    shared: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.stdlib.LoggerFactory(),
        cache_logger_on_first_use=True,
    )
    handler = logging.StreamHandler(sys.stderr) if folder is None else _file(folder, program)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=[structlog.stdlib.ExtraAdder(), *shared],
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                structlog.processors.format_exc_info,
                shown,
                structlog.processors.JSONRenderer(default=str),
            ],
        )
    )
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level)
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
        logging.getLogger(name).handlers = []
        logging.getLogger(name).propagate = True
    logging.getLogger("uvicorn.access").disabled = True  # the request record says more
    logging.getLogger("alembic").setLevel(logging.WARNING)


def stop_on_signals() -> threading.Event:
    """An event that SIGTERM and SIGINT set."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    return stop


def leave(*, again: bool) -> NoReturn:
    """End this process, or begin it anew, without waiting for its threads, nor taking apart what it holds in memory."""
    sys.stdout.flush()
    sys.stderr.flush()
    if again:
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606
    os._exit(0)
