"""Disturbances: what in a recording is not the machine, by name and time, and what is left without it.

A recording is cut to the longest piece of motion, lost samples and what does not repeat from cycle to cycle are left
out, and what is left is analysed. The names tell a technician what to do otherwise next time.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signals.analysis import Analysis
from signals.band import Band
from signals.condition import OperatingCondition
from signals.motion import HOP_HZ, Motion, Span
from signals.recording import Recording
from signals.recording_quality.circumstances import louder_after_start_db, low_band_level_db, standstill_db
from signals.recording_quality.quality import FlagLevel, QualityFlag, assess, constant_stretches
from signals.segments import Segments, find_segments
from signals.transients import Event


@dataclass(frozen=True)
class DisturbanceLimits:
    """When something is a disturbance.

    Args:
        most_left_out: where more than this share would be left out, what is left is the disturbance, and
            nothing is left out [1].
        as_likely_as_not: so many places at which chance puts a disturbance into most cycles at once, and
            nothing that repeats counts [1].
        disturbed_s: how long a disturbance lasts about: places so far apart are disturbed independently [s].
        longest_gap_s: lost samples for longer are silence or a pause [s].
        few_knocks: more are named together [1].
        fewest_for_rhythm, regular: so many events have a rhythm of their own where the times between them scatter
            by less than this share of their mean [1].
        gain_db: so much louder just after a start than before braking is a recorder that had turned up its gain
            [dB].
        gain_fall_db: with such gain it is less than this quieter at standstill: of six such recordings five, of
            good recorders a third.
        missing_db: below 120 Hz so little per hertz, against 250 to 500 Hz, is a high-pass and no gear [dB].
        noisy_fall_db: where it is not even this much quieter at standstill, noise is named [dB].
    """

    most_left_out: float = 0.5
    as_likely_as_not: float = 0.5
    disturbed_s: float = 0.5
    longest_gap_s: float = 0.5
    few_knocks: int = 3
    fewest_for_rhythm: int = 5
    regular: float = 0.1
    gain_db: float = 2.0
    gain_fall_db: float = 13.0
    missing_db: float = -24.0
    noisy_fall_db: float = 10.0


LIMITS = DisturbanceLimits()


@dataclass(frozen=True, eq=False)
class Survey:
    """A recording, divided: what is analysed, and what was left out of it.

    Args:
        recording: as it came.
        analysis: of the piece of motion, without what is not the machine.
        segments: how the recording is divided.
        lost: stretches of lost samples within the piece, from its start.
    """

    recording: Recording
    analysis: Analysis
    segments: Segments
    lost: tuple[Span, ...] = ()

    @property
    def start_s(self) -> float:
        """Where the analysed piece begins in the recording [s]."""
        return self.segments.machine.start_s


def survey(recording: Recording, condition: OperatingCondition) -> Survey:
    """Divide a recording and leave out what is not the machine."""
    lost = _lost(recording)
    whole = Analysis(recording, condition, lost)
    segments = find_segments(whole.loudness_db)
    machine = segments.machine
    if condition.steady or machine.duration_s > recording.duration_s - 2 / HOP_HZ:
        segments = replace(segments, machine=Span(0.0, recording.duration_s))
        piece = whole
    else:
        lost = tuple(_moved(span, -machine.start_s) for span in lost if _overlap(span, machine))
        piece = Analysis(_cut(recording, machine), _shifted(condition, machine), lost)
    unrepeated = piece.unrepeated
    events = () if unrepeated is None else tuple(event.span for event in unrepeated.events)
    left_out = _united((*lost, *events))
    if events and sum(span.duration_s for span in left_out) <= LIMITS.most_left_out * piece.duration_s:
        piece = replace(piece, left_out=left_out, known_motion=piece.motion, known_unrepeated=unrepeated)
    return Survey(recording, piece, segments, lost)


def _lost(recording: Recording) -> tuple[Span, ...]:
    """Return stretches of samples that do not change, short ones: longer ones are silence or a pause."""
    starts, ends = constant_stretches(recording)
    rate_hz, duration_s = recording.sample_rate_hz, recording.duration_s
    spans = [Span(a / rate_hz, b / rate_hz) for a, b in zip(starts.tolist(), ends.tolist(), strict=True)]
    edge_s = 2 / rate_hz
    return tuple(
        Span(max(0.0, span.start_s - 1 / HOP_HZ), min(duration_s, span.end_s + 1 / HOP_HZ))
        for span in spans
        if span.duration_s <= LIMITS.longest_gap_s and span.start_s > edge_s and span.end_s < duration_s - edge_s
    )


def _cut(recording: Recording, span: Span) -> Recording:
    rate_hz = recording.sample_rate_hz
    return replace(recording, samples=recording.samples[round(span.start_s * rate_hz) : round(span.end_s * rate_hz)])


def _shifted(condition: OperatingCondition, span: Span) -> OperatingCondition:
    if not condition.reversal_times_s:
        return condition
    return replace(condition, reversal_times_s=tuple(time - span.start_s for time in condition.reversal_times_s))


def _moved(span: Span, by_s: float) -> Span:
    return Span(max(0.0, span.start_s + by_s), max(0.0, span.end_s + by_s))


def _overlap(span: Span, other: Span) -> bool:
    return span.start_s < other.end_s and span.end_s > other.start_s


def _united(spans: Sequence[Span]) -> tuple[Span, ...]:
    """Return spans in order, those that touch made one."""
    united: list[Span] = []
    for span in sorted(spans, key=lambda each: each.start_s):
        if united and span.start_s <= united[-1].end_s:
            united[-1] = Span(united[-1].start_s, max(united[-1].end_s, span.end_s))
        else:
            united.append(span)
    return tuple(united)


def flags(surveyed: Survey) -> tuple[QualityFlag, ...]:
    """Return what weakens the recording: disturbances by name and time, then the other checks."""
    found = [flag for check in CHECKS for flag in check(surveyed)]
    shifted = [_from_the_start(flag, surveyed) for flag in assess(surveyed.analysis)]
    return tuple(replace(flag, duration_s=surveyed.recording.duration_s) for flag in (*found, *shifted))


def _from_the_start(flag: QualityFlag, surveyed: Survey) -> QualityFlag:
    if flag.start_s is None or flag.end_s is None:
        return flag
    return replace(flag, start_s=flag.start_s + surveyed.start_s, end_s=flag.end_s + surveyed.start_s)


def _flag(kind: str, severity: FlagLevel, span: Span, reason: str) -> QualityFlag:
    return QualityFlag(kind, severity, reason, span.start_s, span.end_s)


def silence(surveyed: Survey) -> Iterator[QualityFlag]:
    """Name quiet before and after the motion."""
    for span in surveyed.segments.silences:
        where = "at the start" if span.start_s < surveyed.start_s else "at the end"
        yield _flag("silence", FlagLevel.NOTE, span, f"{span.duration_s:.1f} s {where} are silent; they are left out")


def pause(surveyed: Survey) -> Iterator[QualityFlag]:
    """Name rests that are no reversals, and what of the motion is not analysed because of them."""
    machine, others = surveyed.segments.machine, sum(span.duration_s for span in surveyed.segments.others)
    for span in surveyed.segments.pauses:
        yield _flag(
            "pause",
            FlagLevel.NOTE,
            span,
            f"the axis rests for {span.duration_s:.1f} s from {span.start_s:.1f} s; analysed is the motion from "
            f"{machine.start_s:.1f} to {machine.end_s:.1f} s, {others:.1f} s of motion beside it are left out",
        )


def unrepeated(surveyed: Survey) -> Iterator[QualityFlag]:
    """Name what some cycles have and others have not."""
    found = surveyed.analysis.unrepeated
    if found is None:
        return
    events, worst = found.events, max(found.share.values())
    left_out = bool(surveyed.analysis.left_out) or not events
    by_chance = _chance_repetitions(surveyed.analysis.motion, worst)
    severity = FlagLevel.POOR if by_chance > LIMITS.as_likely_as_not or not left_out else FlagLevel.NOTE
    knocks = [event for event in events if event.knock]
    changes = [event for event in events if not event.knock and max(map(abs, event.excess_db.values())) > 0]
    low = [event for event in changes if _is_low(event)]
    high = [event for event in changes if not _is_low(event)]
    what_then = "left out" if severity is FlagLevel.NOTE else "too often for what repeats to be the machine's alone"
    if len(knocks) >= LIMITS.fewest_for_rhythm and _regular(knocks):
        every_s = float(np.median(np.diff([event.span.start_s for event in knocks])))
        yield _named(
            "second_machine", severity, knocks, surveyed, f"something strikes every {every_s:.2f} s, {what_then}"
        )
    elif len(knocks) > LIMITS.few_knocks:
        yield _named("handling", severity, knocks, surveyed, f"{len(knocks)} knocks that do not repeat, {what_then}")
    else:
        for event in knocks:
            yield _named("bump", severity, [event], surveyed, f"a knock that does not repeat, {what_then}")
    if low:
        yield _named("wind", severity, low, surveyed, f"a rumble that comes and goes, {what_then}")
    if high:
        yield _named("foreign_sound", severity, high, surveyed, f"a sound that is not in every cycle, {what_then}")


def _chance_repetitions(motion: Motion, share: float) -> float:
    """Return at how many places of a stroke most cycles are disturbed at once, by chance [1].

    Of n cycles, each disturbed for this share q of the time, more than half are at about (n choose k) q^k of the
    places, k = floor(n / 2) + 1: there a disturbance looks like the machine (`signals.half_cycles`).
    """
    if motion.period_s is None:
        return 0.0
    cycles = max(1, round(motion.cycles))
    needed = cycles // 2 + 1
    return math.comb(cycles, needed) * share**needed * motion.period_s / 2 / LIMITS.disturbed_s


def _is_low(event: Event) -> bool:
    above = [abs(excess) for band, excess in event.excess_db.items() if band is not Band.LOW]
    return abs(event.excess_db.get(Band.LOW, 0.0)) > 2 * max(above, default=0.0)


def _regular(events: Sequence[Event]) -> bool:
    apart = np.diff([event.span.start_s for event in events])
    return bool(np.std(apart) < LIMITS.regular * np.mean(apart))


def _named(kind: str, severity: FlagLevel, events: Sequence[Event], surveyed: Survey, what: str) -> QualityFlag:
    start_s = events[0].span.start_s + surveyed.start_s
    span = Span(start_s, max(event.span.end_s for event in events) + surveyed.start_s)
    lasts_s = sum(event.span.duration_s for event in events)
    return _flag(kind, severity, span, f"from {start_s:.1f} s, {lasts_s:.1f} s in all: {what}")


def noise(surveyed: Survey) -> Iterator[QualityFlag]:
    """Name noise under which the motion is hardly heard."""
    if not surveyed.analysis.motion.reversal_times_s:
        return
    fall_db = standstill_db(surveyed.analysis)[0]
    if fall_db < LIMITS.noisy_fall_db:
        yield _flag(
            "noise",
            FlagLevel.NOTE,
            Span(0.0, surveyed.recording.duration_s),
            f"at standstill it is only {fall_db:.1f} dB quieter than in motion: the surroundings are nearly as loud as "
            "the machine; go nearer, or hold the microphone to the gearbox",
        )


def automatic_gain(surveyed: Survey) -> Iterator[QualityFlag]:
    """Name a recorder that turns its gain up at every standstill.

    A gear is louder, too, where it accelerates a load; but with the gain the noise at standstill rises as well.
    """
    louder_db, fall_db = louder_after_start_db(surveyed.analysis), standstill_db(surveyed.analysis)[0]
    if louder_db > LIMITS.gain_db and fall_db < LIMITS.gain_fall_db:
        yield _flag(
            "automatic_gain",
            FlagLevel.NOTE,
            Span(0.0, surveyed.recording.duration_s),
            f"after every standstill it is {louder_db:.1f} dB louder than later on the way, and at standstill only "
            f"{fall_db:.1f} dB quieter than in motion, as with automatic gain control; switch that off, for it changes "
            "what an impact sounds like",
        )


def low_band_missing(surveyed: Survey) -> Iterator[QualityFlag]:
    """Name a high-pass that takes what tells a fault."""
    level_db = low_band_level_db(surveyed.analysis)
    if level_db < LIMITS.missing_db:
        yield _flag(
            "low_band_missing",
            FlagLevel.POOR,
            Span(0.0, surveyed.recording.duration_s),
            f"below 120 Hz there is {-level_db:.0f} dB less than at 250 to 500 Hz, as through a telephone; impacts of "
            "gears lie there, so record with a recorder that does not filter",
        )


CHECKS: tuple[Callable[[Survey], Iterator[QualityFlag]], ...] = (
    silence,
    pause,
    unrepeated,
    noise,
    automatic_gain,
    low_band_missing,
)
"""The catalogue of disturbances; a new one is a function above and a line here."""
