"""Documents that people write, TOML or the same as JSON: parsed within limits of size, depth and time."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from signals.errors import TextError
from signals.reading.limited_pool import PAPERS, RefusedError, refusals_as
from signals.reading.limited_worker import Send
from signals.reading.text import is_whole, text_of

LONGEST_BYTES = 1 << 20
DEEPEST = 16
MOST_VALUES = 20_000
LONGEST_NAME = 200
DIGITS = 400
"""Of a whole number; the largest float has 309."""

LIMITS: Mapping[str, float] = {"seconds": 10.0, "cpu_seconds": 1.0, "memory_bytes": 1 << 30}
TASK = "signals.reading.documents:task"
Document = dict[str, object]


def parse_document(text: bytes | str) -> Document:
    """Return the document in a text, TOML or the same as JSON; no TOML document begins with a brace.

    Time may grow with the square of the length; `parse_foreign` bounds it.

    Raises:
        TextError: saying where the text breaks, or that it is longer, deeper or fuller than documents are, or has what
            no database could hold (NUL, half a character).

    >>> parse_document('{"motor": {"inertia_kg_m2": 0.6}}') == parse_document("motor.inertia_kg_m2 = 0.6")
    True
    """
    if len(text) > LONGEST_BYTES:
        raise TextError(f"the document has {len(text)} bytes; it may have {LONGEST_BYTES}")
    try:
        text = text_of(text)
    except TextError as error:
        raise TextError(f"this is no TOML and no JSON: {error}") from None
    kind, read = ("JSON", json.loads) if text.lstrip().startswith("{") else ("TOML", tomllib.loads)
    if "\0" in text or "\\u0000" in text:
        raise TextError("a document cannot have a NUL character")
    try:
        document: Document = read(text)
    except RecursionError:
        raise TextError(f"this is no {kind} that is read here: it nests more than {DEEPEST} deep") from None
    except ValueError as error:
        raise TextError(f"this is no {kind}: {error}") from None
    check_nesting(document, kind, MOST_VALUES)
    return document


def parse_foreign(text: bytes | str) -> Document:
    """Return the document in a text that came from elsewhere, parsed in the limited process; dates come as text.

    Raises:
        TextError: as `parse_document`, or if parsing takes more time or memory than such documents need.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    if len(text) > LONGEST_BYTES:
        raise TextError(f"the document has {len(text)} bytes; it may have {LONGEST_BYTES}")
    given = text.decode("latin-1") if isinstance(text, bytes) else text
    with refusals_as(
        TextError,
        "reading the document was given up ({}): it is written in a way that takes too long, such as a key with very "
        "many dots; write it in plain tables",
    ):
        content, _ = PAPERS.perform(TASK, {"text": given, "bytes": isinstance(text, bytes)}, LIMITS, 8 * LONGEST_BYTES)
    document: Document = json.loads(content)
    return document


def task(request: Mapping[str, Any], _: Mapping[str, float], send: Send) -> None:
    """Task: parse a text and send the document as JSON."""
    text = request["text"]
    try:
        document = parse_document(text.encode("latin-1") if request["bytes"] else text)
    except TextError as error:
        raise RefusedError("text", str(error)[:2000]) from error
    send(json.dumps(document, default=str).encode())


def check_nesting(document: object, kind: str, most: int) -> None:
    """Raise TextError where a document nests too deeply, has more than so many values, or what nobody could store."""
    for number, (value, depth) in enumerate(_values(document)):
        if depth > DEEPEST:
            raise TextError(f"the {kind} nests more than {DEEPEST} deep; a few tables within tables are enough")
        if number > most:
            raise TextError(f"the {kind} has more than {most} values; leave out what is not asked for")
        if isinstance(value, int) and value.bit_length() > DIGITS * 3.33:
            raise TextError(f"the {kind} has a number of more than {DIGITS} digits; write it shorter")
        if isinstance(value, str) and not is_whole(value):
            raise TextError(f"this is no {kind}: a text has half a character, such as \\ud83d without \\ude00")
        for name in value if isinstance(value, dict) else ():
            if len(name) > LONGEST_NAME or not is_whole(name):
                raise TextError(f"the {kind} has a key of {len(name)} characters, {name[:40]!a}; none is so long")


def _values(document: object) -> Iterator[tuple[object, int]]:
    waiting: list[tuple[object, int]] = [(document, 0)]
    while waiting:
        value, depth = waiting.pop()
        yield value, depth
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        waiting += [(each, depth + 1) for each in inner]
