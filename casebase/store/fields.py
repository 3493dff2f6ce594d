"""What the texts and numbers of a description may be: the same over HTTP, on the command line and in bundles."""

from datetime import UTC, datetime, timedelta
from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, Field, FiniteFloat, StringConstraints

from casebase.description import check_name
from casebase.errors import InvalidRequestError

CONTROL = r"\x00-\x1f\x7f-\x9f\u2028\u2029"
CONTROL_BUT_BREAKS = r"\x00-\x08\x0b\x0c\x0e-\x1f\x7f"
"""Databases and terminals take no control characters; a text may have tabs and line breaks."""


def _text(longest: int, control: str) -> StringConstraints:
    pattern = rf"^[^{control}]*[^\s{CONTROL}][^{control}]*$"
    return StringConstraints(strip_whitespace=True, min_length=1, max_length=longest, pattern=pattern)


Word = Annotated[str, _text(200, CONTROL)]
Short = Annotated[str, _text(100, CONTROL)]
FileName = Annotated[str, _text(255, CONTROL)]
Text = Annotated[str, _text(4000, CONTROL_BUT_BREAKS)]
Verification = Annotated[str, _text(500, CONTROL_BUT_BREAKS)]
"""How a label was verified, as long as the library keeps it."""
Verified = Literal["opened", "measured", "heard", "unverified"]
"""The same in one word: opened and seen, measured, by ear only, not at all."""


def _name(value: str) -> str:
    try:
        check_name("the name of an axis", value)
    except InvalidRequestError as error:
        raise ValueError(str(error)) from None
    return value


AxisName = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=200),
    AfterValidator(_name),
    Field(json_schema_extra={"pattern": rf"^[^/{CONTROL}]+$"}),
]


def is_ahead(value: datetime) -> bool:
    """Whether a time lies in the future, by more than two clocks and a forgotten time zone may differ."""
    return value > datetime.now(UTC) + timedelta(days=1)


def _past(value: datetime) -> datetime:
    if value.timestamp() <= 0:
        raise ValueError("lies before 1970, as of a clock that was never set; leave it out where it is not known")
    if is_ahead(value):
        raise ValueError("lies in the future; give the time at which it was recorded, or leave it out")
    return value


Moment = Annotated[AwareDatetime, AfterValidator(_past)]
"""When something was recorded, with an offset."""
Label = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_.-]{0,99}$")]
Positive = Annotated[FiniteFloat, Field(ge=1e-9, le=1e9)]
