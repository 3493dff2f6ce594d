"""A folder of recordings: which files are finished, and which were sent, remembered in a file that survives a kill."""

import json
import os
import shutil
import struct
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from app.recordings.sound_files import SUFFIX
from casebase.store.audio_store import sha256_of
from signals.reading.plain_file import plain_bytes

MEMORY = ".gearcase-watch.jsonl"
SETTLED_S = 2 * 65536 / (8000 * 2)
"""A file that has not grown for so long is finished [s]: a recorder that gathers 64 KiB of the slowest sound that is
taken, 8 kHz of 16 bit, writes every 4 s; twice that."""
OPEN_ENDED = 0x7FFF0000
"""A size in a header from here on stands for one that is not known yet."""


@dataclass(frozen=True)
class Sent:
    """A recording that was sent, or that the service will never take.

    Args:
        name, size, changed_ns: of the file, by which it is known without being read again.
        sha256: of its bytes, by which it is known under another name.
        diagnosis_id: what was answered; None where it was refused.
        refused: why it was refused.
    """

    name: str
    size: int
    changed_ns: int
    sha256: str
    diagnosis_id: str | None = None
    refused: str | None = None


class Memory:
    """What was sent: a file with a line for each, on the disk before the next one is sent."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._by_file: dict[tuple[str, int, int], Sent] = {}
        self._by_content: dict[str, Sent] = {}
        if path.exists():
            for line in plain_bytes(path).decode("utf-8", "replace").splitlines():
                try:
                    self._keep(Sent(**json.loads(line)))
                except (ValueError, TypeError):
                    continue  # the line at which a kill or a full disk broke off

    def _keep(self, sent: Sent) -> None:
        self._by_file[sent.name, sent.size, sent.changed_ns] = sent
        self._by_content[sent.sha256] = sent

    def by_file(self, name: str, size: int, changed_ns: int) -> Sent | None:
        return self._by_file.get((name, size, changed_ns))

    def by_content(self, sha256: str) -> Sent | None:
        return self._by_content.get(sha256)

    def add(self, sent: Sent) -> None:
        """Remember it for good."""
        with self.path.open("ab+") as file:
            if file.seek(0, os.SEEK_END) > 0:
                file.seek(-1, os.SEEK_END)
                whole = file.read(1) == b"\n"
                file.write(b"" if whole else b"\n")
            file.write(json.dumps(asdict(sent), ensure_ascii=False).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._keep(sent)


@dataclass
class WatchFolder:
    """A folder that is looked at again and again; its sub-folders are not.

    Args:
        settled_s: a file that has not changed for so long is finished [s].
        move_to: where files go that were sent; they stay where they are if None.
    """

    folder: Path
    memory: Memory
    settled_s: float = SETTLED_S
    move_to: Path | None = None
    unsettled: int = 0
    """Files that had changed shortly before the last look."""
    incomplete: set[str] = field(default_factory=set)
    """Names of files that do not change any more and have fewer bytes than their headers say."""
    _seen: dict[Path, tuple[int, int, float]] = field(default_factory=dict)

    def look(self) -> Iterator[tuple[Path, Sent]]:
        """Yield what is finished and was not sent, the oldest first, with what to remember; move what was sent."""
        self.unsettled, self.incomplete = 0, set()
        found = []
        for entry in os.scandir(self.folder):
            if SUFFIX.search(entry.name) and not entry.name.startswith(".") and entry.is_file():
                about = entry.stat()
                found.append((about.st_mtime_ns, Path(entry.path), about.st_size))
        self._seen = {path: seen for path, seen in self._seen.items() if path in {each[1] for each in found}}
        for changed_ns, path, size in sorted(found):
            known = self.memory.by_file(path.name, size, changed_ns)
            if known is None and not self._is_finished(path, size, changed_ns):
                continue
            sha256 = known.sha256 if known else sha256_of(path)
            before = self.memory.by_content(sha256)
            if before is None:
                yield path, Sent(path.name, size, changed_ns, sha256)
            elif known is None:
                self.memory.add(replace(before, name=path.name, size=size, changed_ns=changed_ns))
            if (now := self.memory.by_content(sha256)) is not None and now.refused is None:
                self._move(path, sha256)

    def _is_finished(self, path: Path, size: int, changed_ns: int) -> bool:
        seen = self._seen.get(path)
        if seen is None or seen[:2] != (size, changed_ns):
            self._seen[path] = seen = (size, changed_ns, time.monotonic())
        if time.monotonic() - seen[2] < self.settled_s:
            self.unsettled += 1
            return False
        if size == 0 or not is_whole(path, size):
            self.incomplete.add(path.name)
            return False
        return True

    def _move(self, path: Path, sha256: str) -> None:
        if self.move_to is None:
            return
        self.move_to.mkdir(parents=True, exist_ok=True)
        target = self.move_to / path.name
        if target.exists():
            target = self.move_to / f"{path.stem}-{sha256[:8]}{path.suffix}"
        shutil.move(path, target)


def is_whole(path: Path, size: int) -> bool:
    """Whether as many bytes are there as the header of a WAV file says; other files are taken as they are."""
    with path.open("rb") as file:
        head = file.read(28)
    if head[:4] == b"RIFF" and len(head) >= 8:
        (said,) = struct.unpack("<I", head[4:8])
        return bool(said >= OPEN_ENDED or size >= said + 8)
    if head[:4] in (b"RF64", b"BW64") and len(head) == 28 and head[12:16] == b"ds64":
        (said,) = struct.unpack("<Q", head[20:28])
        return bool(size >= said + 8)
    return True
