"""Faults of the recording itself: the hum of the mains, a signal cut at its extremes, samples that are missing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim.discrepancy.acoustic.evidence import FALSE_ALARM, AcousticFinding
from sim.discrepancy.acoustic.operating_states import Mask
from sim.mechanisms import Clipping, ElectricalHum, LostSamples
from sim.torsional.model import Array

MAINS_HZ = (50.0, 60.0)
MULTIPLES = (1, 2, 3, 4, 6)
GRID_TOLERANCE = 0.003  # of the mains frequency: large grids keep 0.15 Hz but for disturbances
NEIGHBOURS_HZ = 5.0
STEADY = 0.8  # share that a steady line has of what stands over the noise within 3 Hz; lines of a motion have company
COMPANY_HZ = 3.0
PIECES = 8
LEAST_S = 2.0
TAIL = 5.0  # a cut signal has more samples in its outermost level than any tail in the next one
LEAST_CUT = 20
HELD_S = 0.005
LEAST_STEPS = 20.0  # of the recorder up to the extreme
MOST_STILL = 0.3  # of the samples; where more repeat the last, a gap is nothing special
HIGHEST_SHARE = 0.45  # of the sample rate


def recording_faults(values: Array, rate_hz: float, moving: Mask | None) -> list[AcousticFinding]:
    """Hum, clipping and lost samples; `moving` (n,) is True where the axis moves, None where that is not known."""
    if values.size < LEAST_S * rate_hz or not np.ptp(values) > 0:
        return []
    return [*_clipping(values), *_lost(values, rate_hz), *_hum(values, rate_hz, moving)]


def recording_hindrances(values: Array, rate_hz: float) -> dict[str, str]:
    """Faults of the recording that cannot be looked for, and why."""
    if values.size < LEAST_S * rate_hz:
        reason = f"the recording is shorter than {LEAST_S:.0f} s"
    elif not np.ptp(values) > 0:
        reason = "the recording is silent"
    else:
        out = {}
        if float(np.abs(values).max()) <= LEAST_STEPS * _step(values):
            out[Clipping.name] = "the recording has too few steps of level"
        if _stills(values, rate_hz)[1] > MOST_STILL:
            out[LostSamples.name] = "the recording is so coarse or so quiet that most samples do not change"
        if max(MAINS_HZ) > HIGHEST_SHARE * rate_hz:
            out[ElectricalHum.name] = f"the sample rate of {rate_hz:.0f} Hz is too low"
        return out
    return dict.fromkeys((ElectricalHum.name, Clipping.name, LostSamples.name), reason)


def _step(values: Array) -> float:
    """Smallest step between samples: the recorder's resolution."""
    steps = np.diff(np.unique(values))
    return float(steps.min())


def _clipping(values: Array) -> list[AcousticFinding]:
    """More samples at an extreme than just below it: the tail of a signal that is not cut thins out outwards.

    They follow each other, or are come to and left in many ways: what is fast is cut for one sample at a time, and a
    sound that repeats has the same extreme in every turn.
    """
    step = _step(values)
    at = np.zeros(values.size, dtype=bool)
    for side in (1.0, -1.0):
        edge = float((side * values).max())
        width = max(1e-3 * edge, 1.5 * step)
        below = edge - side * values
        outer, inner = below <= width, (below > width) & (below <= 2.0 * width)
        pairs = int((outer[1:] & outer[:-1]).sum())
        rows = np.flatnonzero(outer[1:-1])
        ways = np.unique(np.stack([values[rows], values[rows + 2]]), axis=1).shape[1]
        if max(pairs, ways) >= LEAST_CUT and outer.sum() > TAIL * inner.sum() and edge > LEAST_STEPS * step:
            at |= outer
    if not at.any():
        return []
    share = float(at.mean())
    text = f"The sound stays at its extreme in {share:.2%} of all samples: the recording is cut there; lower the gain."
    return [AcousticFinding(Clipping.name, None, 0.97, {"fraction": (share, share, share)}, text)]


def _lost(values: Array, rate_hz: float) -> list[AcousticFinding]:
    """Stretches of 5 ms and more in which not one sample changes, within a recording that otherwise does."""
    long, others = _stills(values, rate_hz)
    share = float(long.sum()) / values.size
    if share == 0.0 or others > MOST_STILL:
        return []
    text = f"{long.size} times the sound does not change at all for 5 ms or more, {share:.2%} of the recording: "
    text += "samples are missing; check cable, driver and noise gate."
    return [AcousticFinding(LostSamples.name, None, 0.97, {"fraction": (share, share, share)}, text)]


def _stills(values: Array, rate_hz: float) -> tuple[NDArray[np.int64], float]:
    """Lengths of long stretches without a change, in samples; share of the recording in short ones."""
    inside = np.abs(values[1:]) < 0.99 * float(np.abs(values).max())  # a cut top is another fault
    still = np.concatenate([[False], (values[1:] == values[:-1]) & inside, [False]])
    edges = np.flatnonzero(np.diff(still.astype(np.int8)))
    lengths = (edges[1::2] - edges[::2]).astype(np.int64)
    long = lengths >= max(16, HELD_S * rate_hz)
    return lengths[long], float(lengths[~long].sum()) / values.size


def _hum(values: Array, rate_hz: float, moving: Mask | None) -> list[AcousticFinding]:
    """Lines of constant frequency at multiples of the mains, as strong at standstill as in motion."""
    spectrum = np.fft.rfft((values - values.mean()) * np.hanning(values.size))
    power = np.abs(spectrum) ** 2
    spacing = rate_hz / values.size
    best: tuple[int, float, AcousticFinding] | None = None
    for mains in MAINS_HZ:
        lines = [_line(power, spacing, mains * k, k) for k in MULTIPLES if mains * k < HIGHEST_SHARE * rate_hz]
        found = [(k, *line) for k, line in zip(MULTIPLES, lines, strict=False) if line is not None]
        found = [f for f in found if _always_there(values, rate_hz, moving, f[1])]
        if len(found) < (1 if found and found[0][0] == 1 and moving is not None else 2):
            continue
        frequency = found[0][1] / found[0][0]
        height = max(f[2] for f in found)
        half = spacing / found[0][0]
        text = (
            f"A hum of {frequency:.2f} Hz with {len(found)} line(s), {height:.0f} dB over the sound beside it, steady "
            "and there at standstill as well: supply or earthing of the recording, not the gear."
        )
        numbers = {"frequency_hz": (frequency, frequency - half, frequency + half)}
        heard = AcousticFinding(ElectricalHum.name, None, 0.97, numbers, text)
        if best is None or (len(found), height) > best[:2]:
            best = (len(found), height, heard)
    return [best[2]] if best else []


def _line(power: Array, spacing: float, nominal_hz: float, multiple: int) -> tuple[float, float] | None:
    """Frequency and height [dB] of a line near a nominal frequency, if it is one and keeps its strength.

    A line that comes and goes with the motion has others beside it, one over the motion's period away.

    Noise has exponential power: the largest of n bins exceeds the mean by ln(n / alpha) with probability alpha.
    """
    reach = max(GRID_TOLERANCE * nominal_hz, 2.0 * spacing)
    near = slice(round((nominal_hz - reach) / spacing), round((nominal_hz + reach) / spacing) + 1)
    peak = near.start + int(np.argmax(power[near]))
    around = slice(
        max(round((nominal_hz - NEIGHBOURS_HZ) / spacing), 1), round((nominal_hz + NEIGHBOURS_HZ) / spacing) + 1
    )
    mean = float(np.median(power[around])) / math.log(2.0)
    beside = power[max(peak - round(COMPANY_HZ / spacing), 1) : peak + round(COMPANY_HZ / spacing) + 1]
    line = float(power[peak - 2 : peak + 3].sum())
    share = line / max(line, float((beside - mean).sum()))
    limit = math.log((near.stop - near.start) * len(MAINS_HZ) * len(MULTIPLES) / FALSE_ALARM)
    if power[peak] < limit * mean or share < STEADY:
        return None
    left, middle, right = (math.log(power[peak + k] + 1e-300) for k in (-1, 0, 1))
    offset = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return (peak + offset) * spacing, 10.0 * math.log10(float(power[peak]) / mean)


def _always_there(values: Array, rate_hz: float, moving: Mask | None, frequency_hz: float) -> bool:
    """Whether it is one and the same sine from beginning to end, at standstill (where that is known) and in motion."""
    wave = values * np.exp(-2j * math.pi * frequency_hz / rate_hz * np.arange(values.size))
    pieces = [abs(piece.mean()) for piece in np.array_split(wave, PIECES)]
    if min(pieces) < 0.25 * max(pieces):
        return False
    if moving is None or min(moving.sum(), (~moving).sum()) < LEAST_S * rate_hz:
        return True
    there, here = wave[~moving].mean(), wave[moving].mean()
    return bool(abs(there - here) < 0.5 * max(abs(there), abs(here)))
