"""What stands for sound files on the command line: files, folders, patterns, standard input."""

import os
import re
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import BinaryIO

SUFFIX = re.compile(
    r"\.(wav|wave|bwf|rf64|w64|flac|aiff?|aifc|caf|au|snd|ogg|oga|opus|mp3|m4a|aac|amr|3gp|mka|wma)", re.IGNORECASE
)
"""A folder means its files with these endings; what of them is not taken is named with the reason."""

STANDARD_INPUT = ("-", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0")
OPENED = ("/dev/fd/", "/proc/self/fd/")
"""Files of this process alone; another one that opens them gets its own."""

MEANT = "sound files (WAV, FLAC, AIFF), folders of them, or - for standard input"
KINDS = {b"RIFF": ".wav", b"RIFX": ".wav", b"RF64": ".wav", b"BW64": ".wav", b"fLaC": ".flac", b"FORM": ".aiff"}
BLOCK = 1 << 20


class NoSoundError(ValueError):
    """Something on the command line that is no sound file, nor stands for some."""


@dataclass(frozen=True)
class Sound:
    """One sound of the command line.

    Args:
        shown: what it is called in the answer: the path, or `-`.
        path: where its bytes are while the command runs.
        name: its file's name.
        problem: why there is none, one sentence; empty where there is one.
    """

    shown: str
    path: Path
    name: str
    problem: str = ""


@contextmanager
def sounds(given: Sequence[Path], limit: int) -> Iterator[list[Sound]]:
    """Give the sounds that are meant; what was streamed is gone afterwards.

    Args:
        given: files; folders, for the sound files in them but not in their sub-folders; patterns such as `*.wav`,
            which not every shell expands; `-` or a pipe, which is read to its end.
        limit: most bytes of one stream.
    """
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for number, path in enumerate(given):
            try:
                found += _meant(path, Path(folder) / str(number), limit)
            except (NoSoundError, OSError) as error:
                found.append(Sound(str(path), path, path.name, str(error)))
        yield found


def _meant(path: Path, kept: Path, limit: int) -> list[Sound]:
    if str(path) in STANDARD_INPUT:
        if sys.stdin.isatty():
            raise NoSoundError("standard input is a terminal; send a sound file into it: < recording.wav")
        return [_streamed(path, "standard input", sys.stdin.buffer, kept, limit)]
    if not path.exists():
        return _files(Path(each) for each in sorted(glob(str(path)))) or [Sound(str(path), path, path.name)]
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        inside = sorted(each for each in path.iterdir() if SUFFIX.fullmatch(each.suffix))
        if not _files(inside):
            raise NoSoundError(
                "there is no sound file in this folder (sub-folders are not searched); name a folder that has some, "
                "ending in .wav or .flac for example, or the files themselves"
            )
        return _files(inside)
    if stat.S_ISFIFO(mode) or str(path).startswith(OPENED):
        # without O_NONBLOCK, to open a pipe that nobody writes to would never end
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as stream:
            os.set_blocking(stream.fileno(), True)
            return [_streamed(path, "this pipe", stream, kept, limit)]
    if not stat.S_ISREG(mode):
        raise NoSoundError("this is a device or a socket and no file; name a sound file, or - for standard input")
    return [Sound(str(path), path, path.name)]


def _files(paths: Iterable[Path]) -> list[Sound]:
    """Return the files of these, without the hidden ones that some systems lay beside them."""
    return [Sound(str(path), path, path.name) for path in paths if path.is_file() and not path.name.startswith(".")]


def _streamed(path: Path, words: str, stream: BinaryIO, kept: Path, limit: int) -> Sound:
    size, start = 0, b""
    with kept.open("wb") as target:
        while block := stream.read(BLOCK):
            start, size = start or block[:4], size + len(block)
            if size > limit:
                raise NoSoundError(f"more than {limit} bytes came from {words}; GEARCASE_UPLOAD_BYTES is the limit")
            target.write(block)
    if size == 0:
        raise NoSoundError(f"nothing came from {words}; send a sound file into it")
    return Sound(str(path), kept, "stdin" + KINDS.get(start, ""))
