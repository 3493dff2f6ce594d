"""WAV as recorders write it: the sound is found in spite of wrong sizes, missing pads and unfinished headers."""

import io
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

FORMS = (b"RIFF", b"RIFX", b"RF64", b"BW64")
TAGS = (b"bext", b"iXML", b"guan", b"LIST")
KNOWN = (
    *TAGS,
    b"fmt ",
    b"data",
    b"fact",
    b"ds64",
    b"JUNK",
    b"junk",
    b"PAD ",
    b"FLLR",
    b"cue ",
    b"smpl",
    b"id3 ",
    b"ID3 ",
)
PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
UNSTATED = 0x7FFF0000
"""From here on a size that the file does not have is what a recorder writes before it knows the length [byte]."""

FEWEST_VALUES = 1000
LONGEST_TAG = 1 << 16
LONGEST_SEARCH = 1 << 20


class WavError(Exception):
    """There is no sound to be found in the file; the text says what is missing."""


@dataclass(frozen=True)
class Wav:
    """What a WAV file holds and where.

    Args:
        form: content of its `fmt ` chunk.
        code: format tag, that of the sub-format where it is extensible.
        channels: how many.
        rate_hz: samples per second [Hz].
        bits: of one sample.
        width: of one sample where it lies [byte].
        big_endian: whether numbers have their largest byte first.
        start: where the sound begins [byte].
        length: how much of it is there [byte].
        claimed: how much the header claims [byte]; None where it states no length.
        tags: contents of the chunks of `TAGS`; of several with one name the last.
    """

    form: bytes
    code: int
    channels: int
    rate_hz: int
    bits: int
    width: int
    big_endian: bool
    start: int
    length: int
    claimed: int | None
    tags: Mapping[bytes, bytes] = field(default_factory=dict)

    @property
    def is_plain(self) -> bool:
        """Whether the samples are integers or floating point as they are, which `samples` reads."""
        return (self.code == PCM and self.width in (1, 2, 3, 4)) or (self.code == FLOAT and self.width in (4, 8))

    @property
    def missing_bytes(self) -> int | None:
        """How much of the sound is missing [byte]; None where the header states no length."""
        return None if self.claimed is None else max(0, self.claimed - self.length)


def read_wav(file: BinaryIO, size: int) -> Wav:
    """Find the sound in a file of `size` bytes that begins with one of `FORMS`.

    Raises:
        WavError: if it has no usable `fmt ` or no `data` chunk.
    """
    file.seek(0)
    order = ">" if file.read(4) == b"RIFX" else "<"
    chunks = _Chunks(file, size, order)
    offset = 12
    while offset + 8 <= size:
        name, claimed = _head(file, offset, order)
        start = offset + 8
        claimed = chunks.take(name, start, claimed)
        if start + claimed > size or not name.isascii():
            break
        offset = start + claimed
        if claimed % 2 and not (offset < size and _is_chunk(file, offset, size, order)):
            offset += 1
    form, data = chunks.form, chunks.data
    if not form or data is None:
        form, data = _search(file, min(offset, size), order, form, data)
    if len(form) < 16:
        raise WavError("it has no 'fmt ' chunk, so nothing says how its samples are stored")
    if data is None:
        raise WavError("it has no 'data' chunk, so no sound")
    return _wav(form, data, size, chunks.tags, big_endian=order == ">")


@dataclass
class _Chunks:
    """What the chunks of a file have said so far."""

    file: BinaryIO
    size: int
    order: str
    form: bytes = b""
    data: tuple[int, int] | None = None
    tags: dict[bytes, bytes] = field(default_factory=dict)
    _long_data: int | None = None

    def take(self, name: bytes, start: int, claimed: int) -> int:
        """Keep what the chunk at `start` says; return how long it is [byte], which `claimed` may leave open."""
        if name == b"data" and self.data is None:
            if claimed == 0xFFFFFFFF and self._long_data is not None:
                claimed = self._long_data
            if claimed == 0 and not _is_chunk(self.file, start, self.size, self.order):
                claimed = UNSTATED
            self.data = start, claimed
        elif name == b"fmt " and not self.form:
            self.form = _content(self.file, start, min(claimed, LONGEST_TAG))
        elif name == b"ds64":
            self._long_data = int.from_bytes(_content(self.file, start, 24)[8:16], "little") or None
        elif name in TAGS and claimed <= LONGEST_TAG:
            content = _content(self.file, start, claimed)
            if name != b"LIST" or content.startswith(b"INFO"):
                self.tags[name] = content
        return claimed


def samples(wav: Wav, content: bytes) -> NDArray[np.float32]:
    """Return samples, shape (frames, channels) [1], of the bytes of whole frames of a plain WAV file."""
    order = ">" if wav.big_endian else "<"
    if wav.code == FLOAT:
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.frombuffer(content, dtype=f"{order}f{wav.width}").astype(np.float32)
    elif wav.width == 1:
        values = (np.frombuffer(content, dtype=np.uint8).astype(np.float32) - np.float32(128)) / np.float32(128)
    elif wav.width == 3:
        parts = np.frombuffer(content, dtype=np.uint8).reshape(-1, 3)
        wide = np.zeros((len(parts), 4), dtype=np.uint8)
        wide[:, 1:] = parts[:, ::-1] if wav.big_endian else parts
        values = wide.view("<i4").ravel().astype(np.float32) / np.float32(2**31)
    else:
        whole = np.frombuffer(content, dtype=f"{order}i{wav.width}").astype(np.float32)
        values = whole / np.float32(2 ** (8 * wav.width - 1))
    return values.reshape(-1, wav.channels)


def looks_like_float(wav: Wav, content: bytes) -> bool:
    """Whether samples tagged as 32-bit integers can be nothing but 32-bit floating point.

    Sound in integers crosses zero in steps, so that many are small; read as floating point, small negative ones are
    no numbers. Floating point between -1 and 1 read as integers is never small, zero apart.
    """
    if wav.code != PCM or wav.width != 4:
        return False
    order = ">" if wav.big_endian else "<"
    values = np.frombuffer(content, dtype=f"{order}f4")
    values = values[values != 0]
    if values.size < FEWEST_VALUES or not np.isfinite(values).all():
        return False
    magnitude = np.abs(values)
    negative = np.count_nonzero(values < 0) / values.size
    small, large = float(np.quantile(magnitude, 0.05)), float(magnitude.max())
    return bool(0.05 < negative < 0.95 and large <= 16 and 1e-12 < small < large / 16)


def repaired(wav: Wav, file: BinaryIO) -> io.BytesIO:
    """Return the sound under a right header, for decoders that trust headers."""
    form = wav.form + bytes(len(wav.form) % 2)
    body = b"WAVEfmt " + struct.pack("<I", len(form)) + form + b"data" + struct.pack("<I", wav.length)
    head = b"RIFF" + struct.pack("<I", min(len(body) + wav.length, 0xFFFFFFFF)) + body
    return io.BytesIO(head + _content(file, wav.start, wav.length))


def _head(file: BinaryIO, offset: int, order: str) -> tuple[bytes, int]:
    file.seek(offset)
    head = file.read(8)
    name, claimed = struct.unpack(order + "4sI", head) if len(head) == 8 else (b"", 0)
    return name, claimed


def _content(file: BinaryIO, start: int, count: int) -> bytes:
    file.seek(start)
    return file.read(count)


def _is_chunk(file: BinaryIO, offset: int, size: int, order: str) -> bool:
    """Whether a chunk of a known name begins here."""
    return offset + 8 <= size and _head(file, offset, order)[0] in KNOWN


def _search(
    file: BinaryIO, offset: int, order: str, form: bytes, data: tuple[int, int] | None
) -> tuple[bytes, tuple[int, int] | None]:
    """Look for what is missing behind a chunk whose size is wrong."""
    window = _content(file, offset, LONGEST_SEARCH)
    place = window.find(b"fmt ")
    if not form and 0 <= place <= len(window) - 24:
        form = window[place + 8 : place + 8 + min(struct.unpack_from(order + "I", window, place + 4)[0], 64)]
    place = window.find(b"data", max(place, 0))
    if data is None and 0 <= place <= len(window) - 8:
        data = offset + place + 8, struct.unpack_from(order + "I", window, place + 4)[0] or UNSTATED
    return form, data


def _wav(form: bytes, data: tuple[int, int], size: int, tags: Mapping[bytes, bytes], *, big_endian: bool) -> Wav:
    code, channels, rate_hz, _, align, bits = struct.unpack_from(">HHIIHH" if big_endian else "<HHIIHH", form)
    if code == EXTENSIBLE and len(form) >= 26:
        code = int.from_bytes(form[24:26], "big" if big_endian else "little")
    if channels == 0:
        raise WavError("its header says that it has 0 channels")
    width = (bits + 7) // 8
    if align % channels == 0 and width <= align // channels <= 4:
        width = align // channels
    start, claimed = data
    length = min(claimed, size - start)
    stated = claimed <= size - start or claimed < UNSTATED
    return Wav(form, code, channels, rate_hz, bits, width, big_endian, start, length, claimed if stated else None, tags)
