"""What a recording looks like: documents to plot and a spectrogram drawn here, since browsers resample sound."""

import io
import math
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from signals.crest import WINDOW_S, crest_trace
from signals.reading.decode import read_recording
from signals.recording import Recording
from signals.recording_quality.disturbances import Survey
from signals.spectra import PAPER_CUTOFF_HZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes  # slow to import

Value = TypeVar("Value")
SPECTROGRAM_WINDOW = 512
SHORTEST_WINDOW = 256
AT_ONCE = 1 << 20
"""Samples that are transformed together: what a transform needs besides grows with them alone."""
FLOOR_DB = -160.0
SHOWN_DB = 80.0


class Waveform(BaseModel):
    """Lowest and highest sample of each interval: what a screen can show, with no peak lost."""

    unit: str
    sample_rate_hz: float
    duration_s: float
    interval_s: float
    time_s: list[float] = Field(description="start of each interval [s]")
    low: list[float]
    high: list[float]


class Spectrum(BaseModel):
    """Averaged power spectrum (Welch, Hann window)."""

    unit: str
    detector: str = "rms"
    resolution_hz: float
    frequency_hz: list[float]
    level_db: list[float] = Field(description="of the squared unit in the resolution's noise bandwidth [dB]")


class Spectrogram(BaseModel):
    """Level over time and frequency; `level_db[i][j]` is at `frequency_hz[i]` and `time_s[j]`."""

    unit: str
    time_s: list[float]
    frequency_hz: list[float]
    level_db: list[list[float]]


class CrestFactor(BaseModel):
    """Crest factor over time, beside RMS and peak, without which it misleads; null for silence."""

    unit: str
    window_s: float
    low_pass_hz: float = Field(description="all that follows is of the sound below it [Hz]; 0: of the whole sound")
    whole_record: float | None = Field(description="peak over RMS of the whole record: the largest of the trace [1]")
    mean: float | None = Field(description="mean of the trace [1]")
    whole_rms: float
    whole_peak: float
    time_s: list[float] = Field(description="middle of each window [s]")
    crest_factor: list[float | None] = Field(description="the trace: peak of each window over `whole_rms` [1]")
    rms: list[float]
    peak: list[float]


class Kept(Generic[Value]):
    """The values used last, so many bytes of them, for whoever asks again.

    Args:
        most: bytes of all values together.
        size: bytes of a value.
    """

    def __init__(self, most: int, size: Callable[[Value], int]) -> None:
        self._most, self._size = most, size
        self._values: OrderedDict[Hashable, Value] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the value of a key, made where it is not kept."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        value = make()
        with self._lock:
            self._values[key] = value
            while sum(map(self._size, self._values.values())) > self._most:
                self._values.popitem(last=False)
        return value

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._values.clear()


DECODED: Kept[Recording] = Kept(32 << 20, lambda recording: recording.samples.nbytes)
"""Ten minutes at 48 kHz, or many short ones."""
ANSWERS: Kept[bytes] = Kept(16 << 20, len)
SURVEYED: Kept[Survey] = Kept(32 << 20, lambda survey: 4 * survey.recording.samples.nbytes)
"""A recording with the analysed piece of it, and about as much again that was worked out of that."""


def decoded(path: Path, channel: int) -> Recording:
    """The recording behind a content-addressed file, kept for the next plot of the same page."""
    return DECODED.get((path, channel), lambda: read_recording(path, channel=channel))


def kept(key: Hashable, make: Callable[[], bytes]) -> bytes:
    """What was computed of a content-addressed file, kept for who looks next."""
    return ANSWERS.get(key, make)


def forget() -> None:
    """Keep nothing of what was decoded or computed: something was erased."""
    DECODED.clear()
    ANSWERS.clear()
    SURVEYED.clear()


def waveform(recording: Recording, points: int) -> Waveform:
    """Return the envelope of the samples in at most `points` intervals."""
    size = recording.samples.size
    width = math.ceil(size / points)
    starts = np.arange(0, size, width)
    return Waveform(
        unit=recording.unit,
        sample_rate_hz=recording.sample_rate_hz,
        duration_s=recording.duration_s,
        interval_s=width / recording.sample_rate_hz,
        time_s=(starts / recording.sample_rate_hz).tolist(),
        low=np.minimum.reduceat(recording.samples, starts).tolist(),
        high=np.maximum.reduceat(recording.samples, starts).tolist(),
    )


def spectrum(recording: Recording, resolution_hz: float) -> Spectrum:
    """Return the averaged power spectrum, resolved to about `resolution_hz` or as fine as the length allows.

    It is no coarser than that of `SHORTEST_WINDOW` samples: shorter windows cost the more, the less they show.
    """
    window = min(recording.samples.size, max(SHORTEST_WINDOW, round(recording.sample_rate_hz / resolution_hz)))
    power = np.zeros(window // 2 + 1)
    windows = 0
    for block in short_powers(recording.samples, window, window - window // 2):
        power += block.sum(axis=0, dtype=np.float64)
        windows += len(block)
    power /= windows
    frequency = np.fft.rfftfreq(window, 1 / recording.sample_rate_hz)
    return Spectrum(
        unit=recording.unit,
        resolution_hz=recording.sample_rate_hz / window,
        frequency_hz=frequency.tolist(),
        level_db=_decibel(power).tolist(),
    )


def spectrogram(recording: Recording, columns: int) -> Spectrogram:
    """Return the level over time and frequency, in at most `columns` intervals of time."""
    frequency, time, level = _spectrogram(recording, columns)
    return Spectrogram(
        unit=recording.unit, time_s=time.tolist(), frequency_hz=frequency.tolist(), level_db=level.tolist()
    )


def crest(recording: Recording, window_s: float = WINDOW_S, low_pass_hz: float = PAPER_CUTOFF_HZ) -> CrestFactor:
    """Return `crest_trace` of a recording; its document has null where the trace is NaN."""
    found = crest_trace(recording.samples, recording.sample_rate_hz, window_s, low_pass_hz)
    silent = found.whole_rms == 0
    return CrestFactor(
        unit=recording.unit,
        window_s=window_s,
        low_pass_hz=low_pass_hz,
        whole_record=None if silent else found.largest,
        mean=None if silent else found.mean,
        whole_rms=found.whole_rms,
        whole_peak=float(found.peak.max()),
        time_s=found.middle_s.tolist(),
        crest_factor=[None] * found.peak.size if silent else found.values.tolist(),
        rms=found.rms.tolist(),
        peak=found.peak.tolist(),
    )


def spectrogram_png(
    recording: Recording,
    columns: int,
    dark: bool = False,
    marked: Sequence[tuple[float, float, str]] = (),
    top_hz: float = 0.0,
) -> bytes:
    """Return the spectrogram as a PNG with labelled axes, 80 dB below the loudest point downwards left out.

    Args:
        marked: stretches between two lines, from [s], to [s], and their words.
        top_hz: where it ends, and then it is the picture alone, which lies below a waveform; 0 for all of it.
    """
    from matplotlib.figure import Figure  # a second to import, which only the first picture need wait for

    frequency, _, level = _spectrogram(recording, columns)
    ink, paper = ("#e6e6e6", "#14181d") if dark else ("#1c2126", "#ffffff")
    figure = Figure(figsize=(9, 3.6), dpi=110, facecolor=paper, layout=None if top_hz else "constrained")
    axes = figure.add_axes((0, 0, 1, 1)) if top_hz else figure.subplots()
    image = axes.imshow(
        level,
        origin="lower",
        aspect="auto",
        extent=(0.0, recording.duration_s, float(frequency[0]), float(frequency[-1])),
        vmin=float(level.max()) - SHOWN_DB,
        vmax=float(level.max()),
        cmap="cividis",
        interpolation="nearest",
    )
    if top_hz:
        axes.set_ylim(0.0, min(top_hz, float(frequency[-1])))
    else:
        bar = figure.colorbar(image, ax=axes, pad=0.01)
        bar.set_label(f"level [dB re {recording.unit}², rms]", color=ink)
        axes.set_xlabel("time [s]", color=ink)
        axes.set_ylabel("frequency [Hz]", color=ink)
        for part in (axes, bar.ax):
            part.tick_params(colors=ink)
        mark_stretches(axes, marked)
    target = io.BytesIO()
    figure.savefig(target, format="png", facecolor=paper)
    return target.getvalue()


def mark_stretches(axes: "Axes", marked: Sequence[tuple[float, float, str]], ink: str = "#ffffff") -> None:
    """Put lines around stretches of time, from [s], to [s], with their words; readable on any colour."""
    halo = {"facecolor": "#000000" if ink == "#ffffff" else "#ffffff", "alpha": 0.7, "edgecolor": "none", "pad": 1.5}
    worded = [text for _, _, text in marked if text]
    for start_s, end_s, text in marked:
        axes.axvspan(start_s, end_s, facecolor=ink, alpha=0.15)
        for edge_s in (start_s, end_s):
            axes.axvline(edge_s, color=ink, linestyle="--", linewidth=0.8)
        if text:
            height = 0.93 - 0.09 * (worded.index(text) % 4)
            late = start_s > 0.8 * axes.get_xlim()[1]
            axes.annotate(
                text,
                (start_s, height),
                xycoords=("data", "axes fraction"),
                xytext=(-3 if late else 3, 0),
                textcoords="offset points",
                ha="right" if late else "left",
                fontsize=8,
                color=ink,
                bbox=halo,
            )


def short_powers(samples: NDArray[np.float32], window: int, step: int) -> Iterator[NDArray[np.float32]]:
    """Yield mean squares per line of successive windows, in blocks of shape (windows, lines) [unit²].

    Hann window, the mean of each window taken off, one side; a sine of amplitude a on a line has a²/2 there (Heinzel,
    Rüdiger, Schilling, Spectrum and spectral density estimation by the DFT, 2002, section 9, there PS).

    >>> samples = np.sin(2 * np.pi * 5 * np.arange(64) / 64).astype(np.float32)
    >>> next(short_powers(samples, 64, 32))[0, 5].round(4)
    np.float32(0.5)
    """
    from scipy import fft  # slow to import

    hann = (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(window) / window)).astype(np.float32)
    if window == 1:
        hann[:] = 1
    both_sides = np.full(window // 2 + 1, 2.0 / hann.sum(dtype=np.float64) ** 2, dtype=np.float32)
    both_sides[0] /= 2
    if window % 2 == 0:
        both_sides[-1] /= 2
    starting = np.lib.stride_tricks.sliding_window_view(samples, window)[::step]
    together = max(1, AT_ONCE // window)
    for first in range(0, len(starting), together):
        block = starting[first : first + together]
        lines = fft.rfft((block - block.mean(axis=1, keepdims=True)) * hann, axis=1)
        yield (lines.real**2 + lines.imag**2) * both_sides


def _spectrogram(
    recording: Recording, columns: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    size = recording.samples.size
    window = min(SPECTROGRAM_WINDOW, size)
    hop = max(1, window // 4)
    windows = (size - window) // hop + 1
    width = math.ceil(windows / columns)
    loudest = np.zeros((math.ceil(windows / width), window // 2 + 1), dtype=np.float32)
    done = 0
    for power in short_powers(recording.samples, window, hop):
        # the loudest of what shares a column: an impact must not be averaged away
        column = (done + np.arange(len(power))) // width
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        part = loudest[column[0] : column[-1] + 1]
        np.maximum(part, np.maximum.reduceat(power, starts, axis=0), out=part)
        done += len(power)
    time = (np.arange(0, windows, width) * hop + window / 2) / recording.sample_rate_hz
    frequency = np.fft.rfftfreq(window, 1 / recording.sample_rate_hz)
    return frequency.astype(np.float64), time.astype(np.float64), _decibel(loudest.T)


def _decibel(power: NDArray[np.float32] | NDArray[np.float64]) -> NDArray[np.float64]:
    floor = 10 ** (FLOOR_DB / 10)
    level: NDArray[np.float64] = 10 * np.log10(np.maximum(power.astype(np.float64), floor))
    return level.round(2)
