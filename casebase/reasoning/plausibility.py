"""Plausibility: what was typed of a recording, held against its sound, its axis and the library.

What an axis does differs from one recording to the next, so a value is doubted only where it lies beyond all that is
known of the axis by more than a factor: 5 for speed and period, 100 for the payload, since a gripper may be empty.
A speed is also doubted that the motor cannot reach, or that turns a joint more than ten times each way in the period
that is heard. A doubted value is not used, and where one mistaken unit explains it, the flag names its factor.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from casebase.store.models import Case, FeatureRow, StoredRecording
from signals.condition import OperatingCondition
from signals.features import EXTRACTOR_VERSION
from signals.motion import Motion
from signals.recording_quality.quality import FlagLevel, QualityFlag

FEWEST_CASES = 3
NEAR = 1.15
"""How exactly a factor must explain a contradiction, and by how much a data sheet may be off."""

MOST_TURNS = 10
PER_MINUTE, DEGREES = 60 / math.tau, 360 / math.tau
Factor = tuple[float, str]


@dataclass(frozen=True)
class Known:
    """Smallest and largest value of a quantity, and who knows that, in words."""

    low: float
    high: float
    source: str

    def joined(self, other: "Known | None") -> "Known":
        """Return what both know together."""
        if other is None:
            return self
        return Known(min(self.low, other.low), max(self.high, other.high), f"{self.source} and {other.source}")

    def beyond(self, value: float, factor: float) -> bool:
        return not self.low / factor <= value <= self.high * factor


@dataclass(frozen=True)
class Expected:
    """What is known of the motion of an axis; what is not known is None.

    Args:
        speed_rad_s, payload_kg_m2, motion_period_s: as in an operating condition.
        top_speed_rad_s: largest speed of the output that the motor allows [rad/s].
        ratio: turns of the motor per turn of the output [1].
    """

    speed_rad_s: Known | None = None
    payload_kg_m2: Known | None = None
    motion_period_s: Known | None = None
    top_speed_rad_s: float | None = None
    ratio: float = 1.0

    def joined(self, other: "Expected") -> "Expected":
        """Return what both know together; motor and gears are this one's."""
        return replace(
            self,
            speed_rad_s=_joined(self.speed_rad_s, other.speed_rad_s),
            payload_kg_m2=_joined(self.payload_kg_m2, other.payload_kg_m2),
            motion_period_s=_joined(self.motion_period_s, other.motion_period_s),
        )


def _joined(one: Known | None, other: Known | None) -> Known | None:
    return other if one is None else one.joined(other)


def measured(session: Session, axis: str) -> Expected:
    """Return what the searchable measured cases of an axis have, of each quantity that three or more have."""
    heard = FeatureRow.motion["period_in_sound_s"].as_float()
    columns = (StoredRecording.speed_rad_s, StoredRecording.payload_kg_m2, heard)
    statement = (
        select(*(of(column) for column in columns for of in (func.count, func.min, func.max)))
        .select_from(Case)
        .join(StoredRecording, StoredRecording.id == Case.recording_id)
        .join(FeatureRow, FeatureRow.recording_id == Case.recording_id)
        .where(
            (Case.state == "confirmed") & Case.quarantine_reason.is_(None) & (Case.origin == "measured"),
            StoredRecording.axis == axis,
            FeatureRow.extractor_version == EXTRACTOR_VERSION,
        )
    )
    found = session.execute(statement).one()

    def known(first: int) -> Known | None:
        count, low, high = found[first : first + 3]
        return Known(low, high, f"the {count} measured cases of {axis!r}") if count >= FEWEST_CASES else None

    return Expected(known(0), known(3), known(6))


def held_against(
    condition: OperatingCondition, motion: Motion, expected: Expected
) -> tuple[OperatingCondition, tuple[QualityFlag, ...]]:
    """Return the condition without what is contradicted, and a flag for each of that.

    Args:
        motion: as it was heard in the sound.
    """
    judged = {
        "speed_rad_s": _speed(condition, motion, expected),
        "payload_kg_m2": _payload(condition, expected),
        "motion_period_s": _period(condition, motion, expected),
    }
    doubted = {name: flag for name, flag in judged.items() if flag is not None}
    without: dict[str, Any] = dict.fromkeys(doubted)
    return replace(condition, **without), tuple(doubted.values())


def _speed(condition: OperatingCondition, motion: Motion, expected: Expected) -> QualityFlag | None:
    value, known = condition.speed_rad_s, expected.speed_rad_s
    if value is None:
        return None
    heard_s = None if condition.steady else motion.period_in_sound_s
    least_turns = value * (heard_s or 0.0) / 4 / math.tau  # at half the largest speed on average, for half the period
    if known and known.beyond(value, 5):
        reason = _apart(value, known, "rad/s")
    elif expected.top_speed_rad_s is not None and value > NEAR * expected.top_speed_rad_s:
        reason = f"the motor's speed limit allows {_words(expected.top_speed_rad_s)} rad/s"
    elif least_turns > MOST_TURNS:
        reason = f"with the period of {heard_s:.3g} s that is heard it would be {_words(least_turns)} turns each way"
    else:
        return None
    ratio = expected.ratio
    factors = [
        (DEGREES, "degrees per second"),
        (PER_MINUTE, "turns per minute"),
        (ratio, "rad/s of the motor"),
        (ratio * PER_MINUTE, "turns per minute of the motor"),
        (ratio * DEGREES, "degrees per second of the motor"),
        (1000.0, "thousandths of rad/s"),
        (60.0, "rad per minute"),
        (1 / math.tau, "turns per second"),
        (2.0, "rad/s from one direction to the other"),
    ]
    hint = _explained(value, known, factors, "rad/s")
    right = "give the largest speed of the output in rad/s"
    return _flag("speed", f"{value:.9g} rad/s", reason, hint, right, FlagLevel.NOTE)


def _payload(condition: OperatingCondition, expected: Expected) -> QualityFlag | None:
    value, known = condition.payload_kg_m2, expected.payload_kg_m2
    if value is None or known is None or not known.beyond(value, 100):
        return None
    factors = [
        (1000.0, "g m2"),
        (1e4, "kg cm2"),
        (1e6, "kg mm2"),
        (expected.ratio**-2, "kg m2 as felt at the motor"),
    ]
    hint = _explained(value, known, factors, "kg m2")
    reason = _apart(value, known, "kg m2")
    right = "give the inertia that the output carries in kg m2"
    return _flag("payload", f"{value:.9g} kg m2", reason, hint, right, FlagLevel.NOTE)


def _period(condition: OperatingCondition, motion: Motion, expected: Expected) -> QualityFlag | None:
    """Judge a period of which the sound says nothing; where it does, quality's `motion_contradicts` has the word."""
    value, known = condition.motion_period_s, expected.motion_period_s
    if value is None or known is None or motion.period_in_sound_s is not None or not known.beyond(value, 5):
        return None
    hint = _explained(value, known, [(1000.0, "milliseconds"), (1 / 60, "minutes")], "s")
    reason = _apart(value, known, "s")
    return _flag("period", f"{value:.9g} s", reason, hint, "give one full cycle of the motion in s", FlagLevel.POOR)


def _flag(name: str, given: str, reason: str, hint: str, right: str, severity: FlagLevel) -> QualityFlag:
    parts = (f"the {name} was given as {given}, but {reason}", hint, right, "the value is not used")
    return QualityFlag(f"{name}_contradicts", severity, "; ".join(filter(None, parts)))


def _apart(value: float, known: Known, unit: str) -> str:
    low, high = known.low, known.high
    times = f"{_words(value / high)} times the largest" if value > high else f"{_words(value / low)} of the smallest"
    span = _words(low) if low == high else f"{_words(low)} to {_words(high)}"
    return f"that is {times} of {known.source} ({span} {unit})"


def _explained(value: float, known: Known | None, factors: Iterable[Factor], unit: str) -> str:
    """Name the first factor that leads from what is known to the value, and others that are clearly not the same."""
    if known is None:
        return ""
    fitting: list[Factor] = []
    for factor, words in factors:
        new = all(not 1 / NEAR < factor / other < NEAR for other, _ in fitting)
        if new and known.low / NEAR <= value / factor <= known.high * NEAR:
            fitting.append((factor, words))
    shown = [f"{_by(value, factor)} = {_words(value / factor)} {unit} if it is in {words}" for factor, words in fitting]
    return " or ".join(shown)


def _by(value: float, factor: float) -> str:
    return f"{value:.9g} / {_words(factor)}" if factor >= 1 else f"{value:.9g} * {_words(1 / factor)}"


def _words(value: float) -> str:
    return f"{value:.0f}" if 1000 <= value < 1e12 else f"{value:.3g}"
