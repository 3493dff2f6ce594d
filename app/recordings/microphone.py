"""A microphone of this machine: recorded without loss, with a level that says where to hold it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from threading import Event
from typing import Any

import numpy as np
import soundfile
from numpy.typing import NDArray

BLOCK_S = 0.1
QUIET_DBFS = 20 * math.log10(10 / 2**15)
"""Quieter is within ten steps of 16 bit, and within ten times the noise of a telephone's microphone [dB]."""
FULL = 0.99
"""Of the largest value: what is louder was probably cut off [1]."""
STOPPED_S = 5.0
"""A microphone that gives nothing for so long has gone [s]."""
Samples = NDArray[np.float32]


class MicrophoneError(Exception):
    """There is no microphone, or it cannot be used; the text says what to do."""


@dataclass(frozen=True)
class Level:
    """How loud a block is: effective value [dB of full scale] and largest value [1]."""

    rms_dbfs: float
    peak: float

    @classmethod
    def of(cls, samples: Samples) -> Level:
        """Of samples of shape (n,), 1 being full scale."""
        rms = float(np.sqrt(np.mean(np.square(samples, dtype=np.float64))))
        return cls(20 * math.log10(max(rms, 1e-6)), float(np.abs(samples).max(initial=0.0)))

    @property
    def advice(self) -> str:
        """Where to hold the microphone."""
        if self.peak >= FULL:
            return "Too loud: hold it farther away."
        return "Too quiet: hold it nearer." if self.rms_dbfs < QUIET_DBFS else "The level is good."


@contextmanager
def opened(device: str | int | None, rate_hz: int) -> Iterator[Iterator[Samples]]:
    """Open a microphone and give its blocks, shape (n,), as they come.

    Args:
        device: name or number, the system's default if None.

    Raises:
        MicrophoneError: if it cannot be opened, or stops.
    """
    sounddevice = _sounddevice()
    blocks: Queue[Samples] = Queue()
    lost = Event()

    def take(samples: Samples, _frames: int, _time: object, status: Any) -> None:
        if status.input_overflow:
            lost.set()
        blocks.put(samples[:, 0].copy())

    def taken() -> Iterator[Samples]:
        while True:
            try:
                yield blocks.get(timeout=STOPPED_S)
            except Empty:
                raise MicrophoneError("the microphone stopped: look whether it is still plugged in") from None
            if lost.is_set():
                raise MicrophoneError("this machine was too slow and lost samples: end other programs, record again")

    try:
        stream = sounddevice.InputStream(
            device=device,
            samplerate=rate_hz,
            channels=1,
            dtype="float32",
            blocksize=round(BLOCK_S * rate_hz),
            callback=take,
        )
        stream.start()
    except (sounddevice.PortAudioError, ValueError) as error:
        raise MicrophoneError(f"the microphone cannot be used: {error}. `gearcase record --list` names them") from None
    try:
        yield taken()
    finally:
        stream.close()


def listed() -> list[str]:
    """Return the microphones of this machine, each with its number. Raises MicrophoneError."""
    return [
        f"{each['index']}: {each['name']}" for each in _sounddevice().query_devices() if each["max_input_channels"] > 0
    ]


def _sounddevice() -> Any:
    try:
        import sounddevice
    except ImportError:
        raise MicrophoneError("recording needs sounddevice: pip install 'gearcase[record]'") from None
    except OSError:
        raise MicrophoneError("recording needs PortAudio: on Debian or Ubuntu, apt install libportaudio2") from None
    return sounddevice


def record(
    blocks: Iterator[Samples],
    target: Path,
    rate_hz: int,
    seconds: float,
    stop: Event,
    tell: Callable[[float, Level], None],
) -> float:
    """Write blocks to a WAV file of 24 bit until there is enough, or until `stop`; return its length [s].

    Args:
        tell: is told how much there is [s], and the level of each block.
    """
    written, wanted = 0, round(seconds * rate_hz)
    with soundfile.SoundFile(target, "w", rate_hz, 1, subtype="PCM_24", format="WAV") as file:
        for block in blocks:
            part = block[: wanted - written]
            file.write(part)
            written += part.size
            tell(written / rate_hz, Level.of(part))
            if written >= wanted or stop.is_set():
                break
    return written / rate_hz
