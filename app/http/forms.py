"""Multipart forms as many clients send them: what the header of a part says of a file's name, and of its absence."""

import re
from email.header import decode_header, make_header
from email.message import Message
from email.utils import collapse_rfc2231_value
from urllib.parse import unquote

from starlette.formparsers import MultiPartException, MultiPartParser

FILE_PARTS = frozenset({"file", "sound", "as_new", "telemetry"})
"""Parts that are files and nothing else; without a file's name they would be taken for text."""

ENCODED = re.compile(r"(?:%[89A-Fa-f][0-9A-Fa-f])+|%22")
"""Letters beyond ASCII, and the quotation mark, as browsers and phones write them into a plain file name."""


class FormParser(MultiPartParser):
    """Starlette's parser that understands `filename*` (RFC 8187) and says so where a file has no name."""

    def on_headers_finished(self) -> None:
        part = self._current_part
        header = part.content_disposition or b""
        name = extended_name(header)
        if name is not None:
            quoted = name.replace("\\", "\\\\").replace('"', '\\"').encode(self._charset, "replace")
            part.content_disposition = header + b'; filename="' + quoted + b'"'
        super().on_headers_finished()
        if part.file is None and part.field_name in FILE_PARTS:
            raise MultiPartException(
                f"the part {part.field_name!r} has no file name. Give the part `{part.field_name}` a file name: "
                f'Content-Disposition: form-data; name="{part.field_name}"; filename="recording.wav"'
            )


def extended_name(header: bytes) -> str | None:
    """Return the file name that a Content-Disposition states as `filename*`, or None where there is none.

    >>> extended_name(b"form-data; name=file; filename*=UTF-8''m%C3%BChle.wav")
    'mühle.wav'
    >>> extended_name(b'form-data; name="file"; filename="a.wav"') is None
    True
    """
    message = Message()
    message["Content-Disposition"] = header.decode("latin-1")
    given = message.get_params(failobj=[], header="content-disposition")
    names = [value for key, value in given if key.lower() == "filename" and isinstance(value, tuple)]
    return collapse_rfc2231_value(names[-1]) if names else None


def plain_name(name: str) -> str:
    """Return a file name with the letters that a client could not write as they are.

    >>> plain_name("m%C3%BChle 50%.wav"), plain_name("=?UTF-8?B?bcO8aGxlLndhdg==?=")
    ('mühle 50%.wav', 'mühle.wav')
    """
    if name.startswith("=?") and name.endswith("?="):
        try:
            return str(make_header(decode_header(name)))
        except (ValueError, LookupError):
            return name
    try:
        return ENCODED.sub(lambda found: unquote(found[0], errors="strict"), name)
    except UnicodeDecodeError:
        return name
