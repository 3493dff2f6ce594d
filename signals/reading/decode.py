"""Decoding of audio files in a separate process with limits, since decoders are what attackers aim at."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from signals.errors import (
    BrokenAudioError,
    ChannelError,
    NotAudioError,
    RecordingTooLargeError,
    SignalError,
)
from signals.reading.limited_pool import SOUNDS, GaveUpError, OutOfMemoryError, RefusedError
from signals.recording import SHORTEST_S, Recording, Source


@dataclass(frozen=True)
class DecodeLimits:
    """What decoding one file may cost and yield.

    Args:
        seconds: time on the clock [s].
        cpu_seconds: processor time [s].
        memory_bytes: address space of the worker [byte].
        samples: decoded samples of all channels together [1].
        duration_s: longest recording [s].
        shortest_s: shortest recording [s].
        lowest_rate_hz: lowest sample rate [Hz].
        highest_rate_hz: highest sample rate [Hz].
        channels: most channels [1].
        lossy: whether sound that was stored with loss is taken.
    """

    seconds: float = 30.0
    cpu_seconds: float = 20.0
    memory_bytes: int = 1 << 30
    samples: int = 48_000_000
    duration_s: float = 600.0
    shortest_s: float = SHORTEST_S
    lowest_rate_hz: float = 1000.0
    highest_rate_hz: float = 192_000.0
    channels: int = 16
    lossy: bool = True


LIMITS = DecodeLimits()
TASK = "signals.reading.decode_worker:decode"
ERRORS: Mapping[str, type[SignalError]] = {
    "not_audio": NotAudioError,
    "broken": BrokenAudioError,
    "channel": ChannelError,
    "too_large": RecordingTooLargeError,
}


def read_recording(path: Path, *, channel: int | None = None, limits: DecodeLimits = LIMITS) -> Recording:
    """Decode one channel of a sound file in a worker process.

    Without `channel` it is the first, or the loudest where the first is dead. A file that ends early is read as far
    as it goes; what is missing, lossy or dead stands in the recording's `source`. Everything is counted while
    reading, whatever the header says.

    Raises:
        NotAudioError: if the file is no sound file, or a lossy one and these are not taken.
        BrokenAudioError: if no sound can be read from it, a sample is not finite, it is silent, too short, of an
            impossible sample rate, or makes the decoder crash or run out of time.
        ChannelError: if the channel is not in the file.
        RecordingTooLargeError: if it has more channels, samples or seconds than the limits allow.
        FileNotFoundError: if there is no such file.
        DecoderUnavailableError: if the worker cannot be started.
    """
    if not path.exists():
        raise FileNotFoundError(f"no such file: {path}")
    if not path.is_file():
        raise NotAudioError(f"{path.name} is no regular file; send a sound file")
    path.open("rb").close()
    content, result = _decoded(path, channel, limits)
    samples = np.frombuffer(content, dtype="<f4").astype(np.float32, copy=False)
    rate_hz, used, source = float(result["rate_hz"]), int(result["channel"]), source_of(result)
    shortest = int(np.ceil(limits.shortest_s * rate_hz))
    if samples.size < shortest:
        raise BrokenAudioError(
            f"{samples.size} samples ({1000 * samples.size / rate_hz:.1f} ms) could be read; at least "
            f"{1000 * limits.shortest_s:g} ms are needed, and several cycles of the motion are better"
        )
    recording = Recording(samples, rate_hz, used, int(result["channels"]), source=source)
    if samples.min() == samples.max():
        advice = f"channel {source.loudest} carries sound, use that" if used in source.dead else "check the microphone"
        raise BrokenAudioError(f"channel {used} is silent: every sample is {samples[0]:g}; {advice}")
    return recording


def _decoded(path: Path, channel: int | None, limits: DecodeLimits) -> tuple[bytearray, Mapping[str, Any]]:
    asked = {"path": str(path.absolute()), "channel": channel}
    try:
        return SOUNDS.perform(TASK, asked, asdict(limits), 4 * limits.samples)
    except RefusedError as refused:
        raise ERRORS[refused.kind](str(refused)) from None
    except OutOfMemoryError:
        raise RecordingTooLargeError(
            f"decoding needs more than {limits.memory_bytes >> 20} MiB of memory; send fewer channels or a "
            "shorter piece"
        ) from None
    except GaveUpError as error:
        raise BrokenAudioError(
            f"the decoder gave up on the file ({error}); export it again, for example as WAV"
        ) from error


def source_of(result: Mapping[str, Any]) -> Source:
    """Return what the worker says of the file."""
    recorded_at = result["recorded_at"]
    return Source(
        codec=str(result["codec"]),
        lossy=result["lossy"],
        missing_s=result["missing_s"],
        dead=tuple(result.get("dead", ())),
        loudest=result.get("loudest", 0),
        below_db=tuple(result.get("below_db", ())),
        float_tag=result["float_tag"],
        recorded_at=recorded_at and datetime.fromisoformat(recorded_at),
        device=result["device"],
    )


def warm_up() -> None:
    """Start a worker, so that the first recording need not wait for it.

    Raises:
        DecoderUnavailableError: if it cannot be started.
    """
    with SOUNDS.worker():
        pass
