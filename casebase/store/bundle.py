"""Case bundles: a ZIP of `manifest.json` and the audio it names, to carry cases from one library to another.

A bundle from elsewhere is not trusted: it is opened in the limited process, and what it says is held to the rules that
hold over HTTP.
"""

import hashlib
import json
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import IO, Any

from pydantic import ValidationError
from sqlalchemy.orm import Session

from casebase.errors import BundleError, DuplicateError, InvalidRequestError
from casebase.library import CaseLibrary
from casebase.search.case_filter import CaseFilter
from casebase.store.audio_store import Content
from casebase.store.bundle_entry import BundledCase
from casebase.store.bundle_worker import MANIFEST
from casebase.store.counter import library_version
from casebase.store.models import Case
from casebase.store.pagination import LARGEST_PAGE
from signals.errors import SignalError
from signals.features import Extraction, extract
from signals.reading.decode import read_recording
from signals.reading.limited_pool import PAPERS, refusals_as
from signals.reading.plain_file import open_plain
from signals.recording import Recording

SCHEMA = "gearcase-bundle/1"


@dataclass(frozen=True)
class BundleLimits:
    """What a bundle may cost: entries, and as many cases; bytes when unpacked, times its packed size, bytes of the
    manifest; time of the whole import [s]; of each entry that is read time and processor time [s] and memory [byte]."""

    entries: int = 10_000
    total_bytes: int = 10 * 2**30
    file_bytes: int = 200 * 2**20
    ratio: float = 100.0
    manifest_bytes: int = 64 * 2**20
    total_seconds: float = 3600.0
    seconds: float = 60.0
    cpu_seconds: float = 30.0
    memory_bytes: int = 1 << 30


@dataclass(frozen=True)
class Imported:
    """What became of a bundle: ids of new cases, how many were here already, and why others were refused."""

    case_ids: tuple[str, ...]
    known: int
    refused: Mapping[str, str]


@dataclass(frozen=True)
class Exported:
    """How many cases a bundle holds, and how many of them without audio, for it was erased."""

    cases: int
    without_audio: int


def export_cases(library: CaseLibrary, session: Session, target: Path | IO[bytes], wanted: CaseFilter) -> Exported:
    """Write a bundle of the cases wanted; those whose audio was erased are in it without audio, and say so."""
    entries: list[dict[str, object]] = []
    written: set[str] = set()
    with zipfile.ZipFile(target, "x", zipfile.ZIP_DEFLATED) as bundle:
        for case in _all_cases(library, session, wanted):
            erased = case.recording.erased_at is not None
            name = None if erased else f"audio/{case.recording.file_sha256}"
            if name is not None and name not in written:
                bundle.write(library.retrieve.audio_path(case.recording), name)
                written.add(name)
            entries.append(_entry(case, name))
        manifest = {"schema": SCHEMA, "cases": entries}
        bundle.writestr(MANIFEST, json.dumps(manifest, allow_nan=False, indent=1))
    return Exported(len(entries), sum(entry["audio"] is None for entry in entries))


def _all_cases(library: CaseLibrary, session: Session, wanted: CaseFilter) -> Iterator[Case]:
    cursor = None
    while True:
        page = library.retrieve.cases(session, wanted, limit=LARGEST_PAGE, cursor=cursor)
        yield from page.items
        cursor = page.next_cursor
        if cursor is None:
            return


def _entry(case: Case, name: str | None) -> dict[str, object]:
    row = case.recording
    return {
        "audio": name,
        "sha256": row.file_sha256,
        "erased_at": None if row.erased_at is None else row.erased_at.isoformat(),
        "bytes": row.byte_count,
        "channel": row.channel,
        "recording": row.description,
        "label": case.label,
        "origin": case.origin,
        "state": case.state,
        "mechanism": case.mechanism,
        "location": case.location,
        "severity": case.severity,
        "parameters": case.parameters,
        "model_version": case.model_version,
        "labelled_by": case.labelled_by,
        "verified_by": case.verified_by,
        "verification": case.verification,
        "quarantine_reason": case.quarantine_reason,
        "note": case.note,
        "key": case.key,
    }


def import_cases(
    library: CaseLibrary,
    source: Path,
    actor: str,
    *,
    name: str = "",
    limits: BundleLimits | None = None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Imported:
    """Take the cases of a bundle into the library, each in a transaction of its own; what is here already stays.

    Cases of one sound are taken together, for it is read once for all of them.

    Args:
        source: path of the ZIP.
        name: of the bundle, which stands in the cases; by default that of the file.
        progress: called with the number of cases done and in all.

    Raises:
        BundleError: if the bundle breaks a rule; nothing that was read before is lost, nothing of the rest is kept.
    """
    limits = limits or BundleLimits()
    new: list[str] = []
    known = 0
    refused: dict[str, str] = {}
    began = time.monotonic()
    entries = _manifest(source, limits)
    sound = lru_cache(maxsize=1)(partial(_sound, library, source, limits))
    features = lru_cache(maxsize=1)(lambda condition, *asked: extract(sound(*asked)[1], condition))
    first: dict[object, int] = {}
    together = sorted(enumerate(entries), key=lambda each: first.setdefault((each[1].sha256, each[1].channel), each[0]))
    names: dict[str, str] = {}
    seen: dict[str, bool] = {}
    for done, (number, entry) in enumerate(together):
        progress(done, len(entries))
        document = entry.model_dump_json(exclude={"audio"})
        if entry.audio is None:
            refused[f"case {number}"] = "its audio was erased where it comes from, so there is nothing to compare"
        elif document in seen:
            known += seen[document]
        elif time.monotonic() - began > limits.total_seconds:
            refused[entry.audio] = f"the import had taken {limits.total_seconds:g} s by then: split the bundle"
        else:
            seen[document] = False
            asked = names.setdefault(entry.sha256, entry.audio), entry.sha256, entry.channel
            try:
                description = entry.recording.description()
                extraction = features(description.condition, *asked)
                case, fresh = _take(
                    library, entry, *sound(*asked), extraction, actor, f"import {name or source.name}"[:100]
                )
            except BundleError:
                raise
            except (SignalError, DuplicateError, InvalidRequestError) as error:
                refused[entry.audio] = str(error)
            else:
                seen[document] = True
                known += not fresh
                new += [case.id] if fresh else []
    progress(len(entries), len(entries))
    return Imported(tuple(new), known, refused)


def check_bundle(source: Path) -> None:
    """Raise BundleError if a bundle does not say what is in it, or more than may be; its sounds are not read."""
    _manifest(source, BundleLimits())


def _manifest(source: Path, limits: BundleLimits) -> list[BundledCase]:
    manifest = json.loads(_asked("manifest", {}, source, limits, 2 * limits.manifest_bytes))
    if not isinstance(manifest, dict) or manifest.get("schema") != SCHEMA:
        raise BundleError(f'{MANIFEST} must be an object with "schema": "{SCHEMA}"')
    entries = manifest.get("cases")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise BundleError(f'{MANIFEST} must have a list of objects under "cases"')
    if len(entries) > limits.entries:
        raise BundleError(f"{len(entries)} cases; at most {limits.entries} are allowed: split the bundle")
    return [_case(number, entry) for number, entry in enumerate(entries)]


def _case(number: int, entry: Mapping[str, Any]) -> BundledCase:
    missing = [name for name in ("audio", "sha256", "label", "recording") if name not in entry]
    if missing:
        raise BundleError(f"case {number} of {MANIFEST} lacks {', '.join(missing)}")
    told = {name: value for name, value in entry.items() if value is not None or name == "audio"}
    try:
        return BundledCase.model_validate(told)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise BundleError(f"case {number} of {MANIFEST}: {place}: {first['msg']}") from None


def _audio(source: Path, name: str, sha256: str, limits: BundleLimits) -> bytes:
    audio = _asked("entry", {"name": name}, source, limits, limits.file_bytes)
    if hashlib.sha256(audio).hexdigest() != sha256:
        raise BundleError(f"{name[:100]!r} is not what {MANIFEST} declares: its SHA-256 differs")
    return audio


def _asked(task: str, about: Mapping[str, object], source: Path, limits: BundleLimits, largest: int) -> bytes:
    """Have the bundle opened in the limited process; raises BundleError."""
    open_plain(source).close()
    asked = {"path": str(source.absolute()), **about}
    with refusals_as(BundleError, "reading the bundle was given up ({}): split it, or export it again"):
        content, _ = PAPERS.perform(f"casebase.store.bundle_worker:{task}", asked, asdict(limits), largest)
    return bytes(content)


def _sound(
    library: CaseLibrary, source: Path, limits: BundleLimits, name: str, sha256: str, channel: int
) -> tuple[Content, Recording]:
    """Read one channel of a sound of the bundle."""
    audio = _audio(source, name, sha256, limits)
    with library.audio.unnamed(audio) as (path, _):
        return Content(audio, sha256, len(audio)), read_recording(path, channel=channel)


def _take(
    library: CaseLibrary,
    entry: BundledCase,
    content: Content,
    recording: Recording,
    extraction: Extraction,
    actor: str,
    batch: str,
) -> tuple[Case, bool]:
    """Store and retain one case; whether it is new."""
    with library.transaction(actor) as session:
        before = library_version(session)
        row = library.retain.recording(session, content, recording, extraction, entry.recording.description())
        case = library.retain.case(session, row, entry.labelling(batch))
        return case, case.library_version > before
