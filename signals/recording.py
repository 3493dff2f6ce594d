"""Recording: one channel of sound or vibration as it was decoded."""

import hashlib
import math
from dataclasses import dataclass, replace
from datetime import datetime
from fractions import Fraction
from functools import cached_property

import numpy as np
import soxr
from numpy.typing import NDArray

from signals.errors import BrokenAudioError

EXTENSION_S = 0.02
LARGEST = 1e12
"""Largest magnitude of a sample [unit]; its square must not leave float32."""

SHORTEST_S = 0.05
"""Shortest recording of which anything can be said [s]."""


@dataclass(frozen=True)
class Source:
    """What is known of the file that a recording was decoded from.

    Args:
        codec: how the samples were stored, by the decoder's name; "" where nothing was decoded.
        lossy: name of a codec that stores with loss, as MP3; None where nothing was lost.
        missing_s: how much less there is than the header says [s]; None where the header should say how long the
            sound is and does not.
        dead: channels that carry no machine while another one does, from 0.
        loudest: the channel with most sound away from the lines of the mains.
        below_db: how far each channel is below the loudest there [dB]; empty for one channel.
        float_tag: whether the samples are tagged as integers and can only be floating point.
        recorded_at: when, by the recorder's clock; naive where it says no offset.
        device: the recorder, as it calls itself.
    """

    codec: str = ""
    lossy: str | None = None
    missing_s: float | None = 0.0
    dead: tuple[int, ...] = ()
    loudest: int = 0
    below_db: tuple[float, ...] = ()
    float_tag: bool = False
    recorded_at: datetime | None = None
    device: str | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """One channel as decoded, before any resampling.

    Args:
        samples: finite samples, shape (n,) [unit]; 1 is full scale where the unit is "1".
        sample_rate_hz: samples per second [Hz].
        channel: index, from 0, of the channel used.
        channels: how many channels the file has.
        unit: UCUM code of the samples; "1" for an uncalibrated microphone.
        name: what to call it in words, as its file name; "" where it has none.
        source: what is known of the file.

    Raises:
        BrokenAudioError: if there are no samples, a sample is not finite or beyond 1e12, or the rate is not
            positive.
    """

    samples: NDArray[np.float32]
    sample_rate_hz: float
    channel: int = 0
    channels: int = 1
    unit: str = "1"
    name: str = ""
    source: Source = Source()

    def __post_init__(self) -> None:
        samples = np.ascontiguousarray(self.samples, dtype=np.float32)
        if samples.ndim != 1 or samples.size == 0:
            raise BrokenAudioError(
                f"a recording is one channel of samples, shape (n,), n > 0; got shape {samples.shape}"
            )
        if not np.isfinite(self.sample_rate_hz) or self.sample_rate_hz <= 0:
            raise BrokenAudioError(f"the sample rate must be positive, got {self.sample_rate_hz} Hz")
        if not (samples.min() >= -LARGEST and samples.max() <= LARGEST):
            bad = int(np.count_nonzero(~(np.abs(samples) <= LARGEST)))
            raise BrokenAudioError(
                f"{bad} of {samples.size} samples are not finite numbers of at most {LARGEST:g}; export them again"
            )
        samples.flags.writeable = False
        object.__setattr__(self, "samples", samples)

    @property
    def duration_s(self) -> float:
        """Length of the recording [s]."""
        return self.samples.size / self.sample_rate_hz

    @cached_property
    def sha256(self) -> str:
        """Hexadecimal SHA-256 of the sample rate and the little-endian float32 samples."""
        digest = hashlib.sha256(f"{self.sample_rate_hz!r}\n".encode())
        digest.update(self.samples.astype("<f4", copy=False).data)
        return digest.hexdigest()

    def resampled(self, rate_hz: float) -> "Recording":
        """Return the recording at another sample rate [Hz], band-limited by soxr.

        The record is mirrored at both ends first, for soxr takes the outside as silence, and a signal that does not
        start from zero would start with an impulse.
        """
        if rate_hz == self.sample_rate_hz:
            return self
        step = Fraction(rate_hz / self.sample_rate_hz).limit_denominator(200_000).denominator
        lead = step * math.ceil(EXTENSION_S * self.sample_rate_hz / step)
        extended = np.pad(self.samples, lead, mode="symmetric")
        resampled = soxr.resample(extended, self.sample_rate_hz, rate_hz, quality="HQ")
        first = round(lead * rate_hz / self.sample_rate_hz)
        count = max(1, round(self.samples.size * rate_hz / self.sample_rate_hz))
        return replace(self, samples=resampled[first : first + count], sample_rate_hz=float(rate_hz))
