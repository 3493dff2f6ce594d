"""Decoding of audio files in a separate process with limits, since decoders are what attackers aim at."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from casebase.signals.decode_pool import POOL
from casebase.signals.errors import BrokenAudioError, NotAudioError
from casebase.signals.recording import SHORTEST_S, Recording


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


LIMITS = DecodeLimits()


def read_recording(path: Path, *, channel: int | None = None, limits: DecodeLimits = LIMITS) -> Recording:
    """Decode one channel of a sound file in a worker process; without `channel`, the first is used.

    Any lossless format of libsndfile. The header is held against the length of the file and against what was
    really decoded (where the format states a length), and everything is counted while reading.

    Raises:
        NotAudioError: if the file is no sound file or a lossy one.
        BrokenAudioError: if it is truncated, its header lies, a sample is not finite, it is silent, too short,
            of an impossible sample rate, or makes the decoder crash or run out of time.
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
    with POOL.worker() as worker:
        content, result = worker.decode(path, channel, asdict(limits))
    samples = np.frombuffer(content, dtype="<f4").astype(np.float32, copy=False)
    rate_hz = float(result["rate_hz"])
    shortest = int(np.ceil(limits.shortest_s * rate_hz))
    if samples.size < shortest:
        raise BrokenAudioError(
            f"the recording has {samples.size} samples ({1000 * samples.size / rate_hz:.1f} ms); at least "
            f"{1000 * limits.shortest_s:g} ms are needed, and several cycles of the motion are better"
        )
    recording = Recording(samples, rate_hz, int(result["channel"]), int(result["channels"]))
    if samples.min() == samples.max():
        raise BrokenAudioError(
            f"channel {recording.channel} is silent: every sample is {samples[0]:g}; check the microphone and the "
            "channel"
        )
    return recording


def warm_up() -> None:
    """Start a worker, so that the first recording need not wait for it.

    Raises:
        DecoderUnavailableError: if it cannot be started.
    """
    with POOL.worker():
        pass
