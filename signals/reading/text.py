"""Text as other programs write it: UTF-8 with or without a byte order mark, or UTF-16 that says so."""

import codecs

from signals.errors import TextError

MARK = "\ufeff"


def is_whole(text: str) -> bool:
    """Whether a text has neither NUL nor half a character (a lone surrogate): no database and no file takes those.

    >>> is_whole("Ось 轴"), is_whole("a\\ud800"), is_whole("a\\0")
    (True, False, False)
    """
    return not any(character == "\0" or "\ud800" <= character <= "\udfff" for character in text)


def text_of(content: bytes | str) -> str:
    """Return a text without the byte order mark that editors and shells of Windows put before it.

    >>> text_of(b"\\xef\\xbb\\xbfa = 1"), text_of(b"\\xff\\xfea\\x00"), text_of("\\ufeff{}")
    ('a = 1', 'a', '{}')

    Raises:
        TextError: if the bytes are no such text.
    """
    if isinstance(content, bytes):
        wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        try:
            content = content.decode("utf-16" if wide else "utf-8")
        except UnicodeDecodeError as error:
            raise TextError(f"this is no UTF-8 text: {error}") from None
    return content.removeprefix(MARK)
