"""The limited process: a program of its own that reads what strangers send and trusts none of it.

It is started as a plain subprocess by `signals.reading.limited_pool` and speaks over pipes: one JSON line per task
in; out come blocks, each a kind byte and a length (uint32, little-endian) before its bytes: `S` bytes of the answer,
then one `R` result or `E` refusal (JSON), or `M` where memory did not suffice. `H` says that it is up.

Whatever else goes wrong in a task ends the process: to the one who asked it gave up.
"""

import contextlib
import json
import os
import resource
import struct
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, BinaryIO

Send = Callable[[bytes | memoryview], None]


class RefusedError(Exception):
    """What a task was given is refused; `kind` names the error on the other side."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


def confine() -> None:
    """Give up what reading does not need: writing files, core dumps, many open files."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (16, 16))


def allow(memory_bytes: int, cpu_seconds: float) -> None:
    """Allow this much address space, and this much processor time from now on."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    until = int(used.ru_utime + used.ru_stime + cpu_seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (until, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, resource.RLIM_INFINITY))


def send(out: BinaryIO, kind: bytes, content: bytes | memoryview) -> None:
    """Write one block."""
    length = content.nbytes if isinstance(content, memoryview) else len(content)
    out.write(kind + struct.pack("<I", length))
    out.write(content)
    out.flush()


def main(modules: Sequence[str]) -> None:
    """Import modules, then perform tasks until standard input ends.

    A task is a function of its arguments, its limits, and of what sends bytes; it returns JSON or raises
    `RefusedError`.
    """
    for module in modules:
        import_module(module)
    confine()
    requests, out = sys.stdin.buffer, sys.stdout.buffer
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # others set address space aside that they may never use
    send(out, b"H", b"")
    with contextlib.suppress(BrokenPipeError, KeyboardInterrupt):
        while line := requests.readline():
            request: dict[str, Any] = json.loads(line)
            module, name = request["task"].split(":")
            task, limits = getattr(import_module(module), name), request["limits"]
            allow(int(limits["memory_bytes"]), limits["cpu_seconds"])
            try:
                result = task(request["arguments"], limits, lambda content: send(out, b"S", content))
                send(out, b"R", json.dumps(result).encode())
            except RefusedError as refused:
                send(out, b"E", json.dumps({"kind": refused.kind, "message": str(refused)}).encode())
            except MemoryError:
                send(out, b"M", b"")
