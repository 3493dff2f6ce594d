"""When and with what a sound was recorded, as recorders write it into their files."""

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta, timezone

EARLIEST_YEAR = 1990
"""A clock that was never set shows its first day, which tells nothing."""

AUDIOMOTH = re.compile(
    r"Recorded at (\d\d):(\d\d):(\d\d)(?:\.\d+)? (\d\d)/(\d\d)/(\d{4}) \(UTC(?:([+-])(\d{1,2})(?::(\d\d))?)?\)"
)
BY_DEVICE = re.compile(r"\bby ((?:AudioMoth|[A-Z][\w-]*) ?[0-9A-F]{8,16})")
BEXT_DATE = re.compile(r"(\d{4})[-_:/ .](\d\d)[-_:/ .](\d\d)")
BEXT_TIME = re.compile(r"(\d\d)[-_:/ .](\d\d)[-_:/ .](\d\d)")


def from_wav(tags: Mapping[bytes, bytes]) -> tuple[datetime | None, str | None]:
    """Return when and with what, of the chunks of a WAV file; a time without an offset is naive.

    GUANO says most and is believed first, then AudioMoth's comment and BWF.

    Args:
        tags: contents of `guan`, `LIST` and `bext`, as far as there are any.
    """
    found = [
        _guano(_text(tags.get(b"guan", b""))),
        _info(tags.get(b"LIST", b"")),
        _bext(tags.get(b"bext", b"")),
    ]
    when = next((when for when, _ in found if when is not None), None)
    device = next((device for _, device in found if device), None)
    return when, device


def from_container(tags: Mapping[str, str]) -> tuple[datetime | None, str | None]:
    """Return when and with what, of the tags of MP4, MOV, Matroska, FLAC, Ogg and the like."""
    lower = {name.lower(): value for name, value in tags.items()}
    when = None
    for name in ("com.apple.quicktime.creationdate", "creation_time", "date"):
        when = when or moment(lower.get(name, ""))
    made = [lower.get(name) or lower.get(f"com.apple.quicktime.{name}") or "" for name in ("make", "model")]
    return when, _words(" ".join(made))


def moment(text: str) -> datetime | None:
    """Return the moment that a text in ISO 8601 says; None for a mere date and for a clock that was never set."""
    text = text.strip()
    if len(text) < 16:
        return None
    try:
        return _set(datetime.fromisoformat(text))
    except ValueError:
        return None


def _guano(text: str) -> tuple[datetime | None, str | None]:
    fields = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    made = " ".join(fields.get(name, "").strip() for name in ("Make", "Model", "Serial"))
    return moment(fields.get("Timestamp", "")), _words(made)


def _info(chunk: bytes) -> tuple[datetime | None, str | None]:
    """Read AudioMoth's comment and, of others, date and artist of a LIST INFO chunk."""
    if chunk[:4] != b"INFO":
        return None, None
    fields: dict[bytes, str] = {}
    place = 4
    while place + 8 <= len(chunk):
        length = int.from_bytes(chunk[place + 4 : place + 8], "little")
        fields[chunk[place : place + 4]] = _text(chunk[place + 8 : place + 8 + length])
        place += 8 + length + length % 2
    comment = fields.get(b"ICMT", "")
    heard = AUDIOMOTH.search(comment)
    if heard is None:
        return moment(fields.get(b"ICRD", "")), None
    hour, minute, second, day, month, year, sign, hours, minutes = heard.groups()
    offset = timedelta(hours=int(hours or 0), minutes=int(minutes or 0)) * (-1 if sign == "-" else 1)
    device = BY_DEVICE.search(comment)
    try:
        zone = timezone(offset) if offset else UTC
        when = _set(datetime(int(year), int(month), int(day), int(hour), int(minute), int(second), tzinfo=zone))
    except ValueError:
        when = None
    return when, _words(device[1] if device else fields.get(b"IART", ""))


def _bext(chunk: bytes) -> tuple[datetime | None, str | None]:
    """Read originator, date and time of a BWF `bext` chunk (EBU Tech 3285): no offset is part of it."""
    if len(chunk) < 338:
        return None, None
    day, hour = BEXT_DATE.match(_text(chunk[320:330])), BEXT_TIME.match(_text(chunk[330:338]))
    when = moment(f"{'-'.join(day.groups())}T{':'.join(hour.groups())}") if day and hour else None
    return when, _words(_text(chunk[256:288]))


def _set(when: datetime) -> datetime | None:
    return when if when.year >= EARLIEST_YEAR else None


def _text(content: bytes) -> str:
    return content.split(b"\0")[0].decode("utf-8", "replace")


def _words(text: str) -> str | None:
    printable = " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())
    return printable[:100] or None
