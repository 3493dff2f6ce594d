"""Quality: what in a recording weakens the diagnosis, or forbids it."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from signals import crest
from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.motion import CONTRADICTS, runs_of
from signals.reading.live_channel import MAINS_HZ
from signals.recording import Recording
from signals.spectra import band_envelope

STEEP = 0.005
DROPOUT_S = 0.005
FEWEST_STEPS = 10
FACTORS = (
    (2.0, "was the time of one way given? A period is back and forth"),
    (0.5, "were two cycles taken for one?"),
    (1000.0, "was it given in thousands of seconds?"),
    (0.001, "was it given in milliseconds?"),
)
"""What is heard over what was given, and what that comes from."""
SHARE_MISSING = 0.1
FOR_SPEECH = {"AMR", "AMR-WB", "GSM", "Speex"}
HUM_HZ = (*MAINS_HZ, *(2.0 * mains for mains in MAINS_HZ))


DISTURBANCES = (
    "silence",
    "pause",
    "bump",
    "handling",
    "wind",
    "foreign_sound",
    "automatic_gain",
    "low_band_missing",
    "dropouts",
    "second_machine",
    "noise",
    "clipping",
    "hum",
    "lossy",
    "truncated",
    "dead_channel",
)
"""What a disturbance may be."""
KINDS = {"clipped": "clipping", "unsteady_hum": "hum"}
"""Checks that are named otherwise than the disturbance they find."""


class FlagLevel(StrEnum):
    """How much a quality flag matters: a note changes nothing, of a poor recording no label is said with confidence."""

    NOTE = "note"
    POOR = "poor"
    UNUSABLE = "unusable"


@dataclass(frozen=True)
class QualityFlag:
    """Something about the recording that weakens what can be said.

    Args:
        name: name of the check, such as clipped.
        severity: note, poor (diagnosed nevertheless) or unusable.
        reason: one sentence with numbers, and what would be right.
        start_s, end_s: when, from the start of the recording [s]; None where it is the whole recording.
    """

    name: str
    severity: FlagLevel
    reason: str
    start_s: float | None = None
    end_s: float | None = None
    duration_s: float = 0.0

    @property
    def disturbance(self) -> dict[str, object] | None:
        """The flag as a disturbance of the contract; None if it is none."""
        kind = KINDS.get(self.name, self.name)
        if kind not in DISTURBANCES:
            return None
        return {
            "kind": kind,
            "start_s": 0.0 if self.start_s is None else self.start_s,
            "end_s": self.duration_s if self.end_s is None else self.end_s,
            "severity": "info" if self.severity is FlagLevel.NOTE else "poor",
        }

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {name: value for name, value in asdict(self).items() if name != "duration_s"}


def clipped(analysis: Analysis) -> QualityFlag | None:
    """Flag flat tops: two or more samples at an extreme, entered or left by a step of over 0.5 % of the peak.

    The top of a slow sine is flat, too, but not entered by a step; of a sound of only some steps all is flat.
    """
    count = cut_samples(analysis.recording)
    if count == 0 or steps(analysis) < FEWEST_STEPS:
        return None
    share = count / analysis.recording.samples.size
    severity = FlagLevel.UNUSABLE if share > 0.1 else FlagLevel.NOTE
    return QualityFlag(
        "clipped",
        severity,
        f"{count} samples ({100 * share:.2g} %) stand at the limit of the recorder; lower the gain, for clipping "
        "makes impulses smaller and new ones",
    )


def cut_samples(recording: Recording) -> int:
    """Return how many samples stand at a limit of the recorder."""
    samples = recording.samples
    return sum(_flat_tops(samples, extreme) for extreme in (samples.max(), samples.min()))


def _flat_tops(samples: NDArray[np.float32], extreme: np.float32) -> int:
    if extreme == 0:
        return 0
    starts, ends = _edges(samples == extreme)
    before = np.abs(samples[np.maximum(starts - 1, 0)] - extreme)
    after = np.abs(samples[np.minimum(ends, samples.size - 1)] - extreme)
    flat = (ends - starts >= 2) & (np.maximum(before, after) > STEEP * abs(extreme))
    return int((ends - starts)[flat].sum())


def dropouts(analysis: Analysis) -> QualityFlag | None:
    """Flag stretches of at least 5 ms in which the samples do not change at all; at the ends they are silence."""
    recording = analysis.recording
    starts, ends = lost_stretches(recording)
    if not starts.size:
        return None
    lost_s = float((ends - starts).sum()) / recording.sample_rate_hz
    share = lost_s / recording.duration_s
    return QualityFlag(
        "dropouts",
        FlagLevel.UNUSABLE if share > 0.5 else FlagLevel.NOTE,
        f"{starts.size} stretches, {lost_s:.3g} s in all, without any change of the samples; check cable, driver "
        "and noise gate, and record again",
    )


def constant_stretches(recording: Recording) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return first and last (exclusive) sample of stretches of 5 ms and more without any change, shape (k,) each."""
    samples = recording.samples
    shortest = max(16, int(DROPOUT_S * recording.sample_rate_hz))
    starts, ends = _edges(samples[1:] == samples[:-1])
    long = ends - starts >= shortest - 1
    return starts[long], ends[long] + 1


def lost_stretches(recording: Recording) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return those stretches that lie inside the recording, shape (k,) each: at its ends they are silence."""
    starts, ends = constant_stretches(recording)
    inside = (starts > 1) & (ends < recording.samples.size - 1)
    return starts[inside], ends[inside]


def dc_offset(analysis: Analysis) -> QualityFlag | None:
    """Flag a mean above a tenth of the effective value of the rest."""
    mean = float(analysis.recording.samples.mean())
    effective = crest.root_mean_square(analysis.samples)
    if effective == 0 or abs(mean) <= 0.1 * effective:
        return None
    return QualityFlag(
        "dc_offset",
        FlagLevel.NOTE,
        f"the mean is {mean:.3g}, the effective value around it {effective:.3g}; it was removed, but the recorder "
        "has less headroom on one side",
    )


def too_quiet(analysis: Analysis) -> QualityFlag | None:
    """Flag a level of only some steps of the recorder's quantisation."""
    size = steps(analysis)
    if size == 0:
        return QualityFlag("too_quiet", FlagLevel.UNUSABLE, "the recording is silent; check the microphone")
    if size >= FEWEST_STEPS:
        return None
    return QualityFlag(
        "too_quiet",
        FlagLevel.UNUSABLE if size < 2 else FlagLevel.POOR,
        f"the effective value is only {size:.1f} steps of the recorder's resolution, at least {FEWEST_STEPS} are "
        "needed; raise the gain or go nearer",
    )


def steps(analysis: Analysis) -> float:
    """Return the effective value over the recorder's resolution, the smallest difference of two samples [1]."""
    differences = np.abs(np.diff(analysis.recording.samples))
    differences = differences[differences > 0]
    return crest.root_mean_square(analysis.samples) / float(differences.min()) if differences.size else 0.0


def too_short_for_motion(analysis: Analysis) -> QualityFlag | None:
    """Flag fewer than three cycles of the motion, or none heard."""
    motion, name = analysis.motion, "too_short_for_motion"
    if analysis.condition.steady:
        return None
    if not motion.reversal_times_s and motion.period_s is None:
        return QualityFlag(
            name,
            FlagLevel.NOTE,
            "no reversal is heard, so features that follow the motion are missing; if the axis moves back and forth, "
            "record three cycles or more",
        )
    if motion.cycles >= 3 or (len(motion.reversal_times_s) > 2 and motion.period_s is None):
        return None
    cycles = f"{motion.cycles:.1f} cycles" if motion.period_s else "less than one cycle"
    return QualityFlag(
        name,
        FlagLevel.NOTE if motion.cycles >= 1.5 else FlagLevel.POOR,
        f"the recording covers {cycles} of the motion; record three or more",
    )


def irregular_motion(analysis: Analysis) -> QualityFlag | None:
    """Flag reversals that do not repeat."""
    times = analysis.motion.reversal_times_s
    if analysis.motion.period_s is not None or len(times) < 3:
        return None
    return QualityFlag(
        "irregular_motion",
        FlagLevel.POOR,
        f"{len(times)} reversals are heard, but no period; only what happens at the reversals can be compared, so move "
        "the axis between the same two positions at the same speed",
    )


def motion_contradicts(analysis: Analysis) -> QualityFlag | None:
    """Flag a given period that the loudness does not have."""
    heard, given = analysis.motion.period_in_sound_s, analysis.condition.motion_period_s
    if heard is None or given is None or abs(heard / given - 1) <= CONTRADICTS:
        return None
    factor = heard / given
    known = next((words for value, words in FACTORS if abs(factor / value - 1) <= CONTRADICTS), "check the metadata")
    used = " and is used" if analysis.motion.period_s == heard else ""
    return QualityFlag(
        "motion_contradicts",
        FlagLevel.POOR,
        f"the motion period was given as {given:.3f} s, but the loudness repeats every {heard:.3f} s (back and forth)"
        f"{used}; {known}",
    )


def bandwidth_too_low(analysis: Analysis) -> QualityFlag | None:
    """Flag a sample rate below what all features need, or a content that ends below 1 kHz."""
    highest = analysis.highest_hz
    spectrum = analysis.spectrum
    total = spectrum.band_power(10.0, highest)
    if highest > 1000 and total > 0 and spectrum.band_power(1000.0, highest) < 1e-9 * total:
        empty = [f for f in (200.0, 400.0, 1000.0) if spectrum.band_power(f, highest) < 1e-9 * total]
        highest = empty[0]
    rate_hz, whole_hz = analysis.recording.sample_rate_hz, analysis.highest_hz
    if rate_hz >= ANALYSIS_RATE_HZ and highest == whole_hz:
        return None
    slow = f"the sample rate is {rate_hz:.0f} Hz, so " if rate_hz < ANALYSIS_RATE_HZ else ""
    return QualityFlag(
        "bandwidth_too_low",
        FlagLevel.UNUSABLE if highest < 200 else FlagLevel.POOR if highest < 400 else FlagLevel.NOTE,
        f"{slow}the recording holds nothing above {highest:.0f} Hz, and all features of higher bands are missing; "
        "record at 8 kHz or more without a telephone's filter",
    )


def unsteady_hum(analysis: Analysis) -> QualityFlag | None:
    """Flag a mains line that carries much of the sound below 200 Hz and swells by more than 6 dB."""
    spectrum = analysis.spectrum
    whole = spectrum.band_power(12.0, 200.0)
    for line in HUM_HZ:
        power, around = spectrum.band_power(line - 1, line + 1), spectrum.band_power(line - 5, line + 5)
        if analysis.duration_s < 3 or power < 0.2 * whole or power < 0.8 * around:
            continue
        swell = band_envelope(spectrum, line - 2, line + 2)
        if swell is None:
            continue
        low, high = np.percentile(swell.inside(), [10, 90])
        if high > 4 * low:
            return QualityFlag(
                "unsteady_hum",
                FlagLevel.NOTE,
                f"hum at {line:.0f} Hz carries {100 * power / whole:.0f} % of the sound below 200 Hz and swells by "
                f"{10 * np.log10(high / max(low, 1e-30)):.0f} dB; find the loose shield or another mains circuit",
            )
    return None


def channel_choice(analysis: Analysis) -> QualityFlag | None:
    """Say which channel of several was used."""
    recording = analysis.recording
    if recording.channels == 1:
        return None
    return QualityFlag(
        "channel_choice",
        FlagLevel.NOTE,
        f"channel {recording.channel} of 0 to {recording.channels - 1} was used; name another to use that",
    )


def lossy(analysis: Analysis) -> QualityFlag | None:
    """Say that the sound was stored with loss."""
    codec = analysis.recording.source.lossy
    if codec is None:
        return None
    if codec in FOR_SPEECH:
        return QualityFlag(
            "lossy",
            FlagLevel.POOR,
            f"the sound was stored by a codec made for speech ({codec}), which can hide faults; record as WAV or FLAC",
        )
    return QualityFlag(
        "lossy",
        FlagLevel.NOTE,
        f"the sound was stored with loss ({codec}), which leaves out what an ear would miss; record as WAV or FLAC to "
        "keep all of it",
    )


def truncated(analysis: Analysis) -> QualityFlag | None:
    """Flag a file that ends before its header says, or whose header was never finished."""
    missing_s, name = analysis.recording.source.missing_s, "truncated"
    if missing_s == 0:
        return None
    if missing_s is None:
        return QualityFlag(
            name,
            FlagLevel.NOTE,
            "the header does not say how long the recording is, so it was read to the end of the file; whether more "
            "was recorded is not known",
        )
    present_s = analysis.recording.duration_s
    return QualityFlag(
        name,
        FlagLevel.POOR if missing_s > SHARE_MISSING * (present_s + missing_s) else FlagLevel.NOTE,
        f"{missing_s:.3g} s are missing of the {present_s + missing_s:.4g} s that the header says; the other "
        f"{present_s:.4g} s were used, so copy the file again if there is more of it",
    )


def dead_channel(analysis: Analysis) -> QualityFlag | None:
    """Say which channels carry no machine; forbid the diagnosis of one that was asked for."""
    recording, source = analysis.recording, analysis.recording.source
    if not source.dead:
        return None
    asked = recording.channel in source.dead
    names = f"channel {recording.channel}" if asked else _channels(source.dead)
    louder_db = min(source.below_db[channel] for channel in ([recording.channel] if asked else source.dead))
    how = f"is {louder_db:.0f} dB louder away from the mains" if louder_db < 200 else "has sound"
    verb = "carries" if asked or len(source.dead) == 1 else "carry"
    if asked:
        reason = f"{names} {verb} no machine, channel {source.loudest} {how}; use channel {source.loudest}"
    else:
        reason = (
            f"{names} {verb} no machine, channel {recording.channel} {how} and was used; check the other microphone"
        )
    return QualityFlag("dead_channel", FlagLevel.UNUSABLE if asked else FlagLevel.NOTE, reason)


def _channels(numbers: tuple[int, ...]) -> str:
    if len(numbers) == 1:
        return f"channel {numbers[0]}"
    return f"channels {', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"


def wrong_tag(analysis: Analysis) -> QualityFlag | None:
    """Forbid samples that are tagged as integers and can only be floating point."""
    if not analysis.recording.source.float_tag:
        return None
    return QualityFlag(
        "wrong_tag",
        FlagLevel.UNUSABLE,
        "the samples look like floating point with an integer tag; export the recording again, or set the format tag "
        "of the WAV header to 3",
    )


CHECKS: tuple[Callable[[Analysis], QualityFlag | None], ...] = (
    clipped,
    dropouts,
    dc_offset,
    too_quiet,
    too_short_for_motion,
    irregular_motion,
    motion_contradicts,
    bandwidth_too_low,
    unsteady_hum,
    channel_choice,
    lossy,
    truncated,
    dead_channel,
    wrong_tag,
)
"""The catalogue of checks; a new one is a function above and a line here."""


def assess(analysis: Analysis) -> tuple[QualityFlag, ...]:
    """Return the flags of all checks that found something."""
    found = (check(analysis) for check in CHECKS)
    return tuple(replace(flag, duration_s=analysis.duration_s) for flag in found if flag is not None)


def _edges(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return starts and ends (exclusive) of the stretches where a mask is true, shape (k,) each."""
    runs = np.array(runs_of(mask), np.intp).reshape(-1, 2)
    return runs[:, 0], runs[:, 1]
