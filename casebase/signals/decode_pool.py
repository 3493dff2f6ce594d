"""Worker processes for decoding: started when needed, reused, killed when they overrun."""

import atexit
import contextlib
import json
import os
import select
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from casebase.signals.errors import (
    BrokenAudioError,
    ChannelError,
    DecoderUnavailableError,
    NotAudioError,
    RecordingTooLargeError,
    SignalError,
)

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = "import sys; sys.path.append(sys.argv[1]); from casebase.signals.decode_worker import main; main()"
START_SECONDS = 60.0
FILES_PER_WORKER = 500
ERRORS: Mapping[str, type[SignalError]] = {
    "not_audio": NotAudioError,
    "broken": BrokenAudioError,
    "channel": ChannelError,
    "too_large": RecordingTooLargeError,
}


class WorkerGoneError(Exception):
    """The worker ended, or overran its time and was killed."""


class DecodeWorker:
    """One worker process; used by one thread at a time.

    Raises:
        DecoderUnavailableError: if the process does not come up.
    """

    def __init__(self) -> None:
        environment = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        for name in ("LD_LIBRARY_PATH", "SYSTEMROOT"):
            if name in os.environ:
                environment[name] = os.environ[name]
        self.process = subprocess.Popen(  # noqa: S603 - our own program, no shell
            [sys.executable, "-I", "-c", PROGRAM, str(ROOT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            cwd="/",
            env=environment,
        )
        self.files = 0
        try:
            kind, _ = self._block(time.monotonic() + START_SECONDS, 0)
        except WorkerGoneError as error:
            self.close()
            raise DecoderUnavailableError(f"the decoding worker did not start: {error}") from error
        if kind != b"H":
            self.close()
            raise DecoderUnavailableError("the decoding worker did not start as it should")

    def decode(
        self, path: Path, channel: int | None, limits: Mapping[str, float]
    ) -> tuple[bytearray, Mapping[str, Any]]:
        """Return the samples of one channel (float32 as bytes) and the worker's result.

        Raises:
            SignalError: one of `ERRORS`, as the worker says.
            WorkerGoneError: if it crashed, overran its time or sent more than the limits allow.
        """
        self.files += 1
        deadline = time.monotonic() + limits["seconds"]
        request = {"path": str(path.absolute()), "channel": channel, "limits": limits}
        self._write(json.dumps(request).encode() + b"\n")
        samples = bytearray()
        budget = int(4 * limits["samples"])
        while True:
            kind, content = self._block(deadline, budget - len(samples))
            if kind == b"S":
                samples += content
            elif kind == b"R":
                return samples, json.loads(content)
            else:
                refusal = json.loads(content)
                raise ERRORS[refusal["kind"]](refusal["message"])

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
        try:
            self.process.stdin.write(content)
        except BrokenPipeError as error:
            raise WorkerGoneError("it had ended") from error

    def _block(self, deadline: float, budget: int) -> tuple[bytes, bytearray]:
        head = self._read(5, deadline)
        kind, length = struct.unpack("<cI", head)
        if length > max(budget, 1 << 16):
            raise WorkerGoneError("it sent more than the limits allow")
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
                raise WorkerGoneError("it took more time than allowed")
            count = self.process.stdout.readinto(view[filled:])  # type: ignore[attr-defined]
            if not count:
                raise WorkerGoneError(f"it ended with code {self.process.wait()}")
            filled += count
        return content


class DecodePool:
    """Workers for as many threads as there are processors; a thread beyond that waits."""

    def __init__(self, size: int) -> None:
        self._places = threading.BoundedSemaphore(size)
        self._idle: list[DecodeWorker] = []
        self._lock = threading.Lock()
        self._owner = os.getpid()

    @contextmanager
    def worker(self) -> Iterator[DecodeWorker]:
        """Lend a worker; one that is gone or worn out is not taken back.

        Raises:
            BrokenAudioError: if the worker crashed or overran its limits over the file.
        """
        with self._places:
            worker = self._take()
            try:
                yield worker
            except WorkerGoneError as error:
                worker.close()
                raise BrokenAudioError(
                    f"the decoder gave up on the file ({error}); export it again, for example as WAV"
                ) from error
            except SignalError:
                self._put(worker)
                raise
            except BaseException:
                worker.close()
                raise
            self._put(worker)

    def close(self) -> None:
        """End all idle workers."""
        with self._lock:
            idle, self._idle = self._idle, []
        for worker in idle:
            worker.close()

    def _take(self) -> DecodeWorker:
        with self._lock:
            if self._owner != os.getpid():
                self._idle, self._owner = [], os.getpid()
            while self._idle:
                worker = self._idle.pop()
                if worker.process.poll() is None:
                    return worker
                worker.close()
        return DecodeWorker()

    def _put(self, worker: DecodeWorker) -> None:
        if worker.files >= FILES_PER_WORKER:
            worker.close()
            return
        with self._lock:
            self._idle.append(worker)


POOL = DecodePool(os.cpu_count() or 1)
atexit.register(POOL.close)
