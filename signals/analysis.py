"""Analysis: what several feature families need of one recording, each computed once, when asked for."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from signals import envelope
from signals.band import Band
from signals.condition import OperatingCondition
from signals.half_cycles import FALSE_ALARM, SMOOTH_S, HalfCycles, average_half_cycles, noise_peak_db
from signals.motion import HOP_HZ, Motion, Span, find_motion, loudness_db, runs_of
from signals.recording import Recording
from signals.spectra import BandEnvelope, LongSpectrum, band_envelope, long_spectrum, low_pass
from signals.transients import LIMITS, SLOW_S, Unrepeated, find_unrepeated

ANALYSIS_RATE_HZ = 8000.0
"""Sample rate that every recording is brought to [Hz]; the paper's."""

IMPULSES_APART_S = 0.05
"""Impulses closer than this are one [s]."""

RAMP_S = 0.005
"""What is left out fades out and in over so long [s], for an edge would be an impulse."""

SHORTEST_WAY_S, LONGEST_WAY_S = 0.1, 2.0
"""A spectrum of less resolves no line; one of more is not averaged enough where an axis does not reverse [s]."""

EMPTY = 1e-9
"""Share of the power below which a band holds nothing [1]."""

USABLE_SHARE = 0.95
"""Share of the band up to half the original sample rate that anti-aliasing filters leave whole."""


@dataclass(frozen=True, eq=False)
class Analysis:
    """A recording at the analysis rate, with its condition.

    Args:
        left_out: what is not the machine; silenced, and missing from every statistic.
        known_motion: the motion, where it was found before something was left out.
        known_unrepeated: what did not repeat, where it was looked for before something was left out.
    """

    recording: Recording
    condition: OperatingCondition
    left_out: tuple[Span, ...] = ()
    known_motion: Motion | None = None
    known_unrepeated: Unrepeated | None = None

    @cached_property
    def samples(self) -> NDArray[np.float32]:
        """Samples at the analysis rate without their mean, zero where left out, shape (n,) [unit]."""
        samples = self.recording.resampled(ANALYSIS_RATE_HZ).samples
        centred: NDArray[np.float32] = samples - samples.mean()
        if not self.left_out:
            return centred
        ramp = round(RAMP_S * ANALYSIS_RATE_HZ)
        kept = np.repeat(self._kept, round(ANALYSIS_RATE_HZ / HOP_HZ)).astype(np.float32)
        kept = np.pad(kept, (0, max(0, centred.size - kept.size)), mode="edge")[: centred.size]
        faded: NDArray[np.float32] = centred * np.minimum(kept, ndimage.uniform_filter1d(kept, 2 * ramp + 1))
        return faded

    @cached_property
    def _kept(self) -> NDArray[np.bool_]:
        size = int(self.recording.duration_s * HOP_HZ)
        kept = np.ones(max(1, size), dtype=np.bool_)
        for span in self.left_out:
            kept[int(span.start_s * HOP_HZ) : int(np.ceil(span.end_s * HOP_HZ))] = False
        return kept if kept.any() else ~kept  # of nothing nothing can be said

    def is_kept(self, size: int) -> NDArray[np.bool_]:
        """Return what is not left out, `HOP_HZ` values per second, shape (size,)."""
        return np.asarray(np.pad(self._kept, (0, max(0, size - self._kept.size)), mode="edge")[:size])

    def kept(self, values: NDArray[np.float32], rate_hz: float) -> NDArray[np.float32]:
        """Return the values, shape (n,) at any rate [Hz], that are not left out, shape (k,)."""
        if not self.left_out:
            return values
        place = (np.arange(values.size) * (HOP_HZ / rate_hz)).astype(np.intp)
        chosen: NDArray[np.float32] = values[self._kept[np.minimum(place, self._kept.size - 1)]]
        return chosen

    def cycles(self, values: NDArray[np.float32], rate_hz: float) -> list[NDArray[np.float32]]:
        """Return the values, shape (n,) at any rate [Hz], of every whole cycle while the axis moves, shape (k,) each.

        At standstill no tooth strikes: what clicks there is a brake, or the arm that comes to rest. What is left out
        is missing. Without a whole cycle it is all one.
        """
        step = rate_hz / HOP_HZ
        cut = [
            np.concatenate([values[round(first * step) : round(last * step)] for first, last in runs])
            for runs in self._cycle_runs
        ]
        longest = max((each.size for each in cut), default=0)
        return [each for each in cut if each.size and each.size > longest / 2] or [values]

    @cached_property
    def _cycle_runs(self) -> list[list[tuple[int, int]]]:
        """Stretches of every whole cycle in which the axis moves and nothing is left out, first and last [hops]."""
        runs = runs_of(self._counts)
        period_s, times = self.motion.period_s, self.motion.reversal_times_s
        starts = np.arange(times[0] % period_s, self.duration_s, period_s) if period_s and times else np.empty(0)
        if starts.size < 2:
            return [runs]
        hops = np.rint(starts * HOP_HZ).astype(int).tolist()
        cycles = [
            [(max(first, a), min(last, b)) for first, last in runs if first < b and last > a]
            for a, b in itertools.pairwise(hops)
        ]
        return [cycle for cycle in cycles if cycle] or [runs]

    def calmed(self, power: NDArray[np.float32], rate_hz: float) -> NDArray[np.float32]:
        """Return the squared envelope of shape (n,) at any rate [Hz], at standstill at most its own median there."""
        step = rate_hz / HOP_HZ
        still = [slice(round(a * step), round(b * step)) for a, b in runs_of(~self.moves(self._kept.size))]
        if not still:
            return power
        calm, usual = power.copy(), np.median(np.concatenate([power[each] for each in still]))
        for each in still:
            np.minimum(calm[each], usual, out=calm[each])
        return calm

    @cached_property
    def _counts(self) -> NDArray[np.bool_]:
        counts = self._kept & self.moves(self._kept.size)
        return counts if counts.any() else self._kept

    @property
    def duration_s(self) -> float:
        """Length [s]."""
        return self.samples.size / ANALYSIS_RATE_HZ

    @property
    def highest_hz(self) -> float:
        """Up to where the recording can hold sound [Hz]."""
        return USABLE_SHARE * min(self.recording.sample_rate_hz, ANALYSIS_RATE_HZ) / 2

    @cached_property
    def spectrum(self) -> LongSpectrum:
        """Spectrum of the whole record."""
        return long_spectrum(self.samples, ANALYSIS_RATE_HZ)

    @cached_property
    def low_passed(self) -> NDArray[np.float32]:
        """The record below 200 Hz, as in the paper, shape (n,) [unit]."""
        return low_pass(self.spectrum)

    def envelope(self, band: Band) -> BandEnvelope | None:
        """Squared envelope of a band after whitening; None if the recording does not reach there."""
        return self._envelopes[band]

    @cached_property
    def _envelopes(self) -> dict[Band, BandEnvelope | None]:
        found: dict[Band, BandEnvelope | None] = {}
        for band in Band:
            low_hz, high_hz, whiten_hz = band.value
            top_hz = min(high_hz, self.highest_hz)
            whole = top_hz >= low_hz + (high_hz - low_hz) / 4
            found[band] = band_envelope(self.spectrum, low_hz, top_hz, whiten_hz) if whole else None
        return found

    @cached_property
    def loudness_db(self) -> NDArray[np.float32]:
        """Level of the sound above 200 Hz, `HOP_HZ` values per second, shape (k,) [dB]; bridged where left out."""
        return self._bridged(loudness_db(self.samples - self.low_passed, ANALYSIS_RATE_HZ))

    def _bridged(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Draw a straight line over what is left out."""
        kept = self._kept[: values.size]
        if not self.left_out or not kept.any():
            return values
        index = np.arange(values.size)
        bridged: NDArray[np.float32] = np.interp(index, index[: kept.size][kept], values[: kept.size][kept]).astype(
            np.float32
        )
        return bridged

    @cached_property
    def motion(self) -> Motion:
        """Back and forth, as given or as heard; heard above 200 Hz, or below where nothing is heard there."""
        if self.known_motion is not None:
            return self.known_motion
        motion = find_motion(self.loudness_db, self.condition)
        if motion.period_in_sound_s or motion.reversal_times_s:
            return motion
        return find_motion(self._bridged(loudness_db(self.low_passed, ANALYSIS_RATE_HZ)), self.condition)

    def traced(self, band: Band) -> NDArray[np.float32] | None:
        """Smoothed squared envelope of a band, `HOP_HZ` values per second, shape (k,); NaN where left out."""
        return self._traces[band]

    @cached_property
    def _traces(self) -> dict[Band, NDArray[np.float32] | None]:
        return {
            band: self._holed(whole.smoothed(SMOOTH_S, HOP_HZ)) if whole is not None else None
            for band, whole in self._envelopes.items()
        }

    def _holed(self, trace: NDArray[np.float32]) -> NDArray[np.float32]:
        if not self.left_out:
            return trace
        return np.where(self.is_kept(trace.size), trace, np.float32(np.nan))

    def freedom(self, band: Band) -> float:
        """Degrees of freedom of noise in the trace of a band: two per independent value in the triangle."""
        whole = self._envelopes[band]
        return 2 * 1.5 * SMOOTH_S * whole.bandwidth_hz if whole is not None else 0.0

    def noise_peak_db(self, band: Band, alarm: float = FALSE_ALARM) -> float:
        """Height over the median that noise reaches somewhere in the trace of a band [dB], with this probability."""
        return noise_peak_db(1, self.freedom(band), max(1.0, self.duration_s / (2 * SMOOTH_S)), alarm)

    def strongest_db(self, band: Band) -> float:
        """Return the highest point of the trace of a band in the typical cycle above what noise would reach [dB].

        NaN without the band.
        """
        trace = self.traced(band)
        if trace is None:
            return math.nan
        cycles = [known for cycle in self.cycles(trace, HOP_HZ) if (known := cycle[np.isfinite(cycle)]).size]
        if not cycles:
            return math.nan
        positions = max(1.0, float(np.median([cycle.size for cycle in cycles])) / HOP_HZ / (2 * SMOOTH_S))
        heights = [10 * math.log10(float(cycle.max()) / float(np.median(cycle))) for cycle in cycles]
        return float(np.median(heights)) - noise_peak_db(1, self.freedom(band), positions)

    def moves(self, size: int) -> NDArray[np.bool_]:
        """Return where the axis moves, `HOP_HZ` values per second, shape (size,): at standstill no tooth strikes."""
        moves = np.ones(size, dtype=np.bool_)
        start, end = self.motion.quiet_s
        for time in self.motion.reversal_times_s:
            moves[max(0, round((time + start) * HOP_HZ)) : max(0, round((time + end) * HOP_HZ))] = False
        return moves if moves.any() else ~moves

    def ways(self) -> list[Span]:
        """Return where the axis moves at its speed, between reversals and free of what is left out, LONGEST_WAY_S each.

        Without a reversal the whole record counts as one way.
        """
        edges = [0.0, self.duration_s]
        if self.motion.reversal_times_s:
            times = np.array(self.motion.reversal_times_s)
            start, end = self.motion.slow_s
            edges = [0.0, *np.stack([times + start, times + end], axis=1).ravel().clip(0, self.duration_s), edges[1]]
        ways = []
        for start_s, end_s in zip(edges[::2], edges[1::2], strict=True):
            count = max(1, math.ceil((end_s - start_s) / LONGEST_WAY_S))
            cuts = np.linspace(start_s, end_s, count + 1)
            ways += [Span(float(a), float(b)) for a, b in itertools.pairwise(cuts) if b - a >= SHORTEST_WAY_S]
        return [way for way in ways if self._kept[int(way.start_s * HOP_HZ) : int(way.end_s * HOP_HZ)].all()]

    def impulses(self, band: Band) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times [s] and heights above what noise would reach [dB] of the impulses of a band."""
        trace = self.traced(band)
        if trace is None or not np.isfinite(trace).any():
            return np.empty(0), np.empty(0)
        trace = np.where(np.isfinite(trace), trace, np.nanmedian(trace))
        apart = int(IMPULSES_APART_S * HOP_HZ)
        trace = np.where(self.moves(trace.size), trace, np.minimum(trace, np.median(trace)))
        places, heights = envelope.impulses(trace, self.noise_peak_db(band), apart)
        return (places.astype(np.float64) + 0.5) / HOP_HZ, heights

    def folded(self, band: Band) -> HalfCycles | None:
        """The trace of a band folded on the motion; None without a reversal."""
        return self._folds[band]

    @cached_property
    def _folds(self) -> dict[Band, HalfCycles | None]:
        return {
            band: average_half_cycles(trace, self.motion, self.freedom(band)) if trace is not None else None
            for band, trace in self._traces.items()
        }

    @cached_property
    def unrepeated(self) -> Unrepeated | None:
        """What cycles do not have in common; None without a motion of two cycles."""
        if self.known_unrepeated is not None:
            return self.known_unrepeated
        traces = {band: trace for band, trace in self._traces.items() if trace is not None and self._filled(band)}
        peaks_db = {band: self.noise_peak_db(band, LIMITS.false_alarm_of_events) for band in traces}
        changes_db = {band: max(LIMITS.change_db, self._slow_noise_db(band)) for band in traces}
        return find_unrepeated(traces, peaks_db, changes_db, self.motion)

    def _slow_noise_db(self, band: Band) -> float:
        """Height over its median that noise hardly ever reaches in a level averaged over SLOW_S [dB]."""
        freedom = self.freedom(band) * SLOW_S / (1.5 * SMOOTH_S)
        return noise_peak_db(1, freedom, max(1.0, self.duration_s / (2 * SLOW_S)), LIMITS.false_alarm_of_events)

    def _filled(self, band: Band) -> bool:
        """Whether the recording has more in a band than rounding: after a resampling it may not."""
        low_hz, high_hz, _ = band.value
        power = self.spectrum.band_power(low_hz, min(high_hz, self.highest_hz))
        return power > EMPTY * self.spectrum.band_power(Band.LOW.value[0], self.highest_hz)
