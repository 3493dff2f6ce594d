"""Faults of the recording itself: a signal cut at its extremes, samples that are missing, the hum of the mains;
and whether it belongs to the telemetry beside it."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import uniform_filter1d

from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.condition import UNKNOWN
from signals.motion import HOP_HZ, SMOOTH_HOPS
from signals.reading.live_channel import MAINS_HZ
from signals.recording import Recording
from signals.recording_quality.quality import FEWEST_STEPS, cut_samples, lost_stretches, steps
from sim.chain.model import Array
from sim.investigation.acoustic.evidence import FALSE_ALARM, AcousticFinding
from sim.investigation.acoustic.operating_states import LEAST_CRUISES, Course
from sim.investigation.data.preprocessing import Measurement
from sim.mechanisms import Clipping, ElectricalHum, LostSamples

HUM_MULTIPLES = (1, 2, 3, 4, 6)  # of the mains, which supplies and transformers have
GRID_TOLERANCE = 0.003  # of the mains frequency: large grids keep 0.15 Hz but for disturbances
STEADY, COMPANY_HZ = 0.8, 3.0  # share of a steady line in what stands over the noise so near; others have company
LEAST_S = 2.0
LEAST_CUT = 1e-4  # of the samples: chance leaves less at an extreme
LEAST_CORRELATION = 0.2  # correlation; of 75 pairs that belong together the least has 0.42
SLOW = 0.05  # of the usual speed: below, no axis is quieter
SURE = 0.97  # of a fault that is counted sample by sample


def recording_faults(course: Course) -> list[AcousticFinding]:
    """Clipping, lost samples and hum of a recording."""
    hindered = recording_hindrances(course)
    looks = {Clipping.name: _clipping, LostSamples.name: _lost, ElectricalHum.name: _hum}
    found = [look(course) for name, look in looks.items() if name not in hindered]
    return [one for one in found if one is not None]


def recording_hindrances(course: Course) -> dict[str, str]:
    """Faults of the recording that cannot be looked for, and why."""
    sound, names = course.analysis.recording, (ElectricalHum.name, Clipping.name, LostSamples.name)
    if sound.duration_s < LEAST_S:
        return dict.fromkeys(names, f"the recording is shorter than {LEAST_S:.0f} s")
    if not np.ptp(sound.samples) > 0:
        return dict.fromkeys(names, "the recording is silent")
    out = {}
    if steps(course.analysis) < FEWEST_STEPS:
        out = dict.fromkeys(names[1:], "the recording has too few steps of level")
    if max(MAINS_HZ) > course.analysis.highest_hz:
        out[ElectricalHum.name] = f"the sample rate of {sound.sample_rate_hz:.0f} Hz is too low"
    return out


def _share(name: str, share: float, text: str) -> AcousticFinding:
    return AcousticFinding(name, None, SURE, {"fraction": (share, share, share)}, text)


def _clipping(course: Course) -> AcousticFinding | None:
    sound = course.analysis.recording
    share = cut_samples(sound) / sound.samples.size
    text = f"The sound stays at its extreme in {share:.2%} of all samples: the recording is cut there; lower the gain."
    return _share(Clipping.name, share, text) if share > LEAST_CUT else None


def _lost(course: Course) -> AcousticFinding | None:
    sound = course.analysis.recording
    starts, ends = lost_stretches(sound)
    share = float((ends - starts).sum()) / sound.samples.size
    text = f"{starts.size} times the sound does not change at all for 5 ms or more, {share:.2%} of the recording: "
    text += "samples are missing; check cable, driver and noise gate."
    return _share(LostSamples.name, share, text) if starts.size else None


def _hum(course: Course) -> AcousticFinding | None:
    """Lines of constant frequency at multiples of the mains, as strong at standstill as in motion."""
    best: tuple[int, float, AcousticFinding] | None = None
    values = course.analysis.samples.astype(np.float64)
    power = np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
    spacing = ANALYSIS_RATE_HZ / values.size
    for mains in MAINS_HZ:
        known = [k for k in HUM_MULTIPLES if k * mains < course.analysis.highest_hz]
        lines = [(k, *_line(power, spacing, k * mains)) for k in known]
        found = [line for line in lines if line[2] > 0.0 and _always_there(course, values, line[1])]
        if len(found) < (1 if found and found[0][0] == 1 and course.moving is not None else 2):
            continue
        k, line, _ = found[0]
        frequency, half, height = line / k, spacing / k, max(one[2] for one in found)
        text = (
            f"A hum of {frequency:.2f} Hz with {len(found)} line(s), {height:.0f} dB over the sound beside it, steady "
            "and there at standstill as well: supply or earthing of the recording, not the gear."
        )
        numbers = {"frequency_hz": (frequency, frequency - half, frequency + half)}
        if best is None or (len(found), height) > best[:2]:
            best = (len(found), height, AcousticFinding(ElectricalHum.name, None, SURE, numbers, text))
    return best[2] if best else None


def _line(power: Array, spacing: float, nominal_hz: float) -> tuple[float, float]:
    """Frequency of the strongest line near a nominal one [Hz], and its height [dB]; 0 where noise makes as strong.

    Noise has exponential power: the largest of n bins exceeds the mean by ln(n / alpha) with probability alpha.
    """
    reach = max(GRID_TOLERANCE * nominal_hz, 2.0 * spacing)
    first, last = round((nominal_hz - reach) / spacing), round((nominal_hz + reach) / spacing) + 1
    peak = first + int(np.argmax(power[first:last]))
    wide = round(5.0 / spacing)
    mean = float(np.median(power[max(peak - wide, 1) : peak + wide])) / math.log(2.0)
    limit = math.log((last - first) * len(MAINS_HZ) * len(HUM_MULTIPLES) / FALSE_ALARM)
    beside = power[max(peak - round(COMPANY_HZ / spacing), 1) : peak + round(COMPANY_HZ / spacing) + 1]
    line = float(power[peak - 2 : peak + 3].sum())
    if power[peak] <= limit * mean or line < STEADY * max(line, float((beside - mean).sum())):
        return 0.0, 0.0
    left, middle, right = np.log(power[peak - 1 : peak + 2] + 1e-300)
    place = peak + 0.5 * (left - right) / (left - 2.0 * middle + right)
    return place * spacing, 10.0 * math.log10(power[peak] / mean)


def _always_there(course: Course, values: Array, frequency_hz: float) -> bool:
    """Whether it is one and the same sine from beginning to end, at standstill (where that is known) and in motion."""
    wave = values * np.exp(-2j * math.pi * frequency_hz / ANALYSIS_RATE_HZ * np.arange(values.size))
    pieces = [abs(piece.mean()) for piece in np.array_split(wave, 8)]
    if min(pieces) < 0.25 * max(pieces):
        return False
    if course.moving is None:
        return True
    moving = course.moving_at(np.arange(values.size) / ANALYSIS_RATE_HZ)
    if min(moving.sum(), (~moving).sum()) < LEAST_S * ANALYSIS_RATE_HZ:
        return True
    there, here = wave[~moving].mean(), wave[moving].mean()
    return bool(abs(there - here) < 0.5 * max(abs(there), abs(here)))


def mismatch(sound: Recording, m: Measurement, offset_s: float) -> tuple[str, ...]:
    """A remark where the loudness has standstills of its own and does not follow the measured speed.

    The faster an axis moves, the louder it is.
    """
    analysis = Analysis(sound, UNKNOWN)
    count = len(analysis.motion.reversal_times_s)
    level = uniform_filter1d(analysis.loudness_db.astype(np.float64), SMOOTH_HOPS)
    time = (np.arange(level.size) + 0.5) / HOP_HZ + offset_s
    inside = (time >= m.time_s[0]) & (time <= m.time_s[-1])
    if count < LEAST_CRUISES or inside.mean() < 0.5:
        return ()
    level = np.maximum(level[inside], np.percentile(level, 2))
    speed = np.abs(np.interp(time[inside], m.time_s, m.speed))
    moved = np.log(speed + SLOW * max(float(np.percentile(speed, 90)), 1e-9))
    if (
        np.ptp(moved) == 0.0
        or np.ptp(level) == 0.0
        or (found := float(np.corrcoef(moved, level)[0, 1])) >= LEAST_CORRELATION
    ):
        return ()
    return (
        f"The sound does not follow the measured speed (correlation {found:.2f}, though {count} standstills are heard; "
        "0.4 and more where both are of one motion): is the offset of the sound right, and are they of one motion?",
    )
