"""Pages that say for a while that they are being worked out."""

import time
from collections.abc import Callable

import httpx

WORKING = "Being worked out"
PATIENCE_S = 60.0


def worked_out(get: Callable[[str], httpx.Response], path: str, patience_s: float = PATIENCE_S) -> str:
    """Ask for a page until it is there; return it."""
    until = time.monotonic() + patience_s
    while WORKING in (page := get(path).raise_for_status().text):
        assert time.monotonic() < until, f"{path} was not worked out in time"
        time.sleep(0.05)
    return page
