"""Limited processes, in which what strangers send is read: started when needed, reused, killed when they overrun.

What they do is in `signals.reading.limited_worker`; a task is a function of a module, named by us and never by what
is read.
"""

import atexit
import contextlib
import json
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from signals.errors import DecoderUnavailableError
from signals.reading.limited_worker import RefusedError

__all__ = [
    "PAPERS",
    "SOUNDS",
    "GaveUpError",
    "LimitedPool",
    "LimitedWorker",
    "OutOfMemoryError",
    "RefusedError",
    "refusals_as",
]

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = (
    "import sys; sys.path.append(sys.argv[1]); from signals.reading.limited_worker import main; main(sys.argv[2:])"
)
START_SECONDS = 60.0
OVERRUN = "it took more time than allowed"
TASKS_PER_WORKER = 500
LONGEST_RESULT = 1 << 16
"""Bytes of the result, or of a message, of a task that is allowed no more."""


class GaveUpError(Exception):
    """The process ended, or overran its limits and was killed; the text says which."""


class OutOfMemoryError(GaveUpError):
    """The task needs more memory than it is allowed."""


@contextmanager
def refusals_as(error: type[Exception], given_up: str) -> Iterator[None]:
    """Raise what a limited process refuses, or gives up (the reason stands for `{}` in `given_up`), as this error."""
    try:
        yield
    except RefusedError as refused:
        raise error(str(refused)) from None
    except GaveUpError as reason:
        raise error(given_up.format(reason)) from reason


class LimitedWorker:
    """One limited process; used by one thread at a time.

    Args:
        modules: what it imports before limits count.

    Raises:
        DecoderUnavailableError: if the process does not come up.
    """

    def __init__(self, *modules: str) -> None:
        environment = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        environment["MALLOC_MMAP_THRESHOLD_"] = str(128 * 1024)  # or what is freed stays with the process, in pieces
        for name in ("LD_LIBRARY_PATH", "SYSTEMROOT", "NUMBA_CACHE_DIR"):
            if name in os.environ:
                environment[name] = os.environ[name]
        self.process = subprocess.Popen(  # noqa: S603 - our own program, no shell
            [sys.executable, "-I", "-c", PROGRAM, str(ROOT), *modules],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            cwd="/",
            env=environment,
        )
        self.tasks = 0
        try:
            kind, _ = self._block(time.monotonic() + START_SECONDS, 0)
        except GaveUpError as error:
            self.close()
            raise DecoderUnavailableError(f"the limited process for reading files did not start: {error}") from error
        if kind != b"H":
            self.close()
            raise DecoderUnavailableError("the limited process for reading files did not start as it should")

    def perform(
        self, task: str, arguments: Mapping[str, object], limits: Mapping[str, float], largest: int
    ) -> tuple[bytearray, Any]:
        """Return the bytes that a task sent, and its result.

        Args:
            task: `module:function`, taken by `signals.reading.limited_worker`.
            arguments: JSON.
            limits: `seconds`, `cpu_seconds`, `memory_bytes`, and what else the task looks at.
            largest: how many bytes it may send in all, and its result may have.

        Raises:
            RefusedError: if the task refuses what it was given.
            GaveUpError: if it crashed, overran its limits or sent more than allowed.
        """
        self.tasks += 1
        deadline = time.monotonic() + limits["seconds"]
        self._write(json.dumps({"task": task, "arguments": arguments, "limits": limits}).encode() + b"\n")
        sent = bytearray()
        while True:
            kind, content = self._block(deadline, largest - len(sent))
            if kind == b"S":
                sent += content
            elif kind == b"R":
                return sent, json.loads(content)
            elif kind == b"M":
                raise OutOfMemoryError(f"it needs more than {int(limits['memory_bytes']) >> 20} MiB of memory")
            else:
                refusal = json.loads(content)
                raise RefusedError(refusal["kind"], refusal["message"])

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()

    def _write(self, content: bytes) -> None:
        assert self.process.stdin is not None
        view = memoryview(content)
        try:
            while view:
                view = view[self.process.stdin.write(view) :]
        except BrokenPipeError as error:
            raise GaveUpError("it had ended") from error

    def _block(self, deadline: float, budget: int) -> tuple[bytes, bytearray]:
        head = self._read(5, deadline)
        kind, length = struct.unpack("<cI", head)
        if length > max(budget, LONGEST_RESULT):
            raise GaveUpError("it sent more than the limits allow")
        return kind, self._read(length, deadline)

    def _read(self, length: int, deadline: float) -> bytearray:
        assert self.process.stdout is not None
        descriptor = self.process.stdout.fileno()
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        content = bytearray(length)
        view, filled = memoryview(content), 0
        while filled < length:
            left_s = deadline - time.monotonic()
            if left_s <= 0 or not poll.poll(left_s * 1000):
                raise GaveUpError(OVERRUN)
            count = self.process.stdout.readinto(view[filled:])  # type: ignore[attr-defined]
            if not count:
                code = self.process.wait()
                out_of_time = code == -signal.SIGXCPU
                raise GaveUpError(OVERRUN if out_of_time else f"it ended with code {code}")
            filled += count
        return content


class LimitedPool:
    """Limited processes for as many threads as there are processors; a thread beyond that waits."""

    def __init__(self, size: int, *modules: str) -> None:
        self._modules = modules
        self._places = threading.BoundedSemaphore(size)
        self._idle: list[LimitedWorker] = []
        self._lock = threading.Lock()
        self._owner = os.getpid()
        atexit.register(self.close)

    def perform(
        self, task: str, arguments: Mapping[str, object], limits: Mapping[str, float], largest: int = LONGEST_RESULT
    ) -> tuple[bytearray, Any]:
        """Perform a task in one of the processes; see `LimitedWorker.perform`."""
        with self.worker() as worker:
            return worker.perform(task, arguments, limits, largest)

    @contextmanager
    def worker(self) -> Iterator[LimitedWorker]:
        """Lend a process; one that is gone, killed or worn out is not taken back."""
        with self._places:
            worker = self._take()
            try:
                yield worker
            except (RefusedError, OutOfMemoryError):
                self._put(worker)
                raise
            except BaseException:
                worker.close()
                raise
            self._put(worker)

    def close(self) -> None:
        """End all idle processes."""
        with self._lock:
            idle, self._idle = self._idle, []
        for worker in idle:
            worker.close()

    def _take(self) -> LimitedWorker:
        with self._lock:
            if self._owner != os.getpid():
                self._idle, self._owner = [], os.getpid()
            while self._idle:
                worker = self._idle.pop()
                if worker.process.poll() is None:
                    return worker
                worker.close()
        return LimitedWorker(*self._modules)

    def _put(self, worker: LimitedWorker) -> None:
        if worker.tasks >= TASKS_PER_WORKER:
            worker.close()
            return
        with self._lock:
            self._idle.append(worker)


SOUNDS = LimitedPool(os.cpu_count() or 1, "signals.reading.decode_worker")
PAPERS = LimitedPool(os.cpu_count() or 1)
"""For tables and documents; apart, since what reads tables takes a fifth of the address space a sound may have."""
