"""A process of ours: how it is told to stop, and how it ends."""

import os
import signal
import sys
import threading
from typing import NoReturn


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
