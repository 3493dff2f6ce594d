"""What is said of a recording and of a case when it comes in."""

import unicodedata
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from typing import Any

from casebase.errors import InvalidRequestError
from casebase.store.models import CASE_STATES, ORIGINS, VERIFICATIONS
from signals.condition import OperatingCondition
from signals.motion_profile import MotionProfile


@dataclass(frozen=True)
class RecordingDescription:
    """How a recording was taken; every field but the file's name may be absent.

    Args:
        file_name: as it was sent; kept as text, never used as a path.
        media_type: as it was sent.
        axis: name of the axis type.
        gearbox: serial number of the physical unit; cross-validation groups by it.
        condition: speed, payload and motion, SI.
        recorded_at: when, with offset.
        extra: anything else, JSON.
    """

    file_name: str = "recording.wav"
    media_type: str = "audio/wav"
    axis: str | None = None
    gearbox: str | None = None
    condition: OperatingCondition = field(default_factory=OperatingCondition)
    recorded_at: datetime | None = None
    extra: Mapping[str, object] = field(default_factory=dict)

    def to_document(self) -> dict[str, object]:
        """Return it as JSON; `condition_of` reads the condition back."""
        document = asdict(self)
        document["recorded_at"] = None if self.recorded_at is None else self.recorded_at.isoformat()
        document["condition"] = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in document["condition"].items()
            if value not in (None, ())
        }
        document["extra"] = dict(self.extra)
        return document


def condition_of(document: Mapping[str, object]) -> OperatingCondition:
    """Return the operating condition kept in a recording's description."""
    stored = document.get("condition", {})
    if not isinstance(stored, Mapping):
        raise InvalidRequestError("condition must be a table of quantities")
    known = {each.name for each in fields(OperatingCondition)}
    given: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in stored.items() if name in known
    }
    if "motion" in given:
        given["motion"] = MotionProfile(**given["motion"])
    return OperatingCondition(**given)


@dataclass(frozen=True)
class Labelling:
    """What a recording is a case of, and who says so.

    Args:
        label: normal, play, notch or any other.
        origin: measured or simulated.
        state: proposed cases wait for an admin; only confirmed ones are searched.
        mechanism, location, severity, parameters, model_version: of a simulated case, contract names, SI.
        verified_by: how the label was verified, in any words.
        verification: the same as one of VERIFICATIONS.
        key: given by a generator, so that the same case twice is one.
        batch: the job or import that brings it.

    Raises:
        InvalidRequestError: if a field is empty or not one of its values.
    """

    label: str
    origin: str = "measured"
    state: str = "confirmed"
    mechanism: str | None = None
    location: str | None = None
    severity: float | None = None
    parameters: Mapping[str, object] = field(default_factory=dict)
    model_version: str | None = None
    verified_by: str | None = None
    verification: str | None = None
    quarantine_reason: str | None = None
    note: str | None = None
    key: str | None = None
    batch: str | None = None

    def __post_init__(self) -> None:
        check_label(self.label)
        check_choice("origin", self.origin, ORIGINS)
        check_choice("state", self.state, CASE_STATES)
        check_verification(self.verification)


LONGEST_NAME = 200
BREAKING = ("Cc", "Cs", "Zl", "Zp")
"""Unicode's categories of control characters, half characters and separators of lines."""


def check_name(what: str, name: str) -> None:
    """Raise InvalidRequestError unless a name can stand in an address: in any script, but one part of a path.

    >>> check_name("name", "Ось 4, 轴")
    >>> check_name("name", "../keys")
    Traceback (most recent call last):
    casebase.errors.InvalidRequestError: name: 1 to 200 characters of any script without '/', '..', control \
characters and blanks at its ends, such as 'axis 4'; got '../keys'
    """
    fits = name == name.strip() and 0 < len(name) <= LONGEST_NAME and name != "."
    if not fits or "/" in name or ".." in name or any(unicodedata.category(each) in BREAKING for each in name):
        raise InvalidRequestError(
            f"{what}: 1 to {LONGEST_NAME} characters of any script without '/', '..', control characters and blanks at "
            f"its ends, such as 'axis 4'; got {name[:60]!r}"
        )


def check_label(label: str) -> None:
    """Raise InvalidRequestError unless the label is a word of 1 to 100 characters."""
    if not label or label != label.strip() or len(label) > 100 or not label.isprintable():
        raise InvalidRequestError(
            f"a label is 1 to 100 printable characters without blanks at its ends, got {label[:120]!r}"
        )


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise InvalidRequestError unless the value is one of the choices."""
    if value not in choices:
        raise InvalidRequestError(f"{name} must be one of {', '.join(choices)}, got {value!r}")


def check_verification(value: str | None) -> None:
    """Raise InvalidRequestError unless the value is one of VERIFICATIONS, or None for not said."""
    if value is not None:
        check_choice("verification", value, VERIFICATIONS)
