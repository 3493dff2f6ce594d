"""Case bundles: a ZIP of `manifest.json` and the audio it names, to carry cases from one library to another.

A bundle from elsewhere is not trusted: names, counts, sizes and checksums are all checked, on what is really read.
"""

import hashlib
import json
import stat
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Any

from sqlalchemy.orm import Session

from casebase.audio_store import CHUNK
from casebase.case_filter import CaseFilter
from casebase.description import Labelling, RecordingDescription, condition_of
from casebase.errors import BundleError, DuplicateError, InvalidRequestError
from casebase.library import CaseLibrary
from casebase.models import Case
from casebase.pages import LARGEST_PAGE
from casebase.signals.decode import read_recording
from casebase.signals.errors import SignalError
from casebase.signals.features import extract

SCHEMA = "gearcase-bundle/1"
MANIFEST = "manifest.json"


@dataclass(frozen=True)
class BundleLimits:
    """What a bundle may cost: entries, bytes when unpacked, times its packed size, bytes of the manifest."""

    entries: int = 10_000
    total_bytes: int = 10 * 2**30
    file_bytes: int = 200 * 2**20
    ratio: float = 100.0
    manifest_bytes: int = 64 * 2**20


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


def export_cases(library: CaseLibrary, session: Session, target: Path, wanted: CaseFilter) -> Exported:
    """Write a bundle of the cases wanted; those whose audio was erased are in it without audio, and say so."""
    entries: list[dict[str, object]] = []
    written: set[str] = set()
    with zipfile.ZipFile(target, "x", zipfile.ZIP_DEFLATED) as bundle:
        for case in _all_cases(library, session, wanted):
            erased = case.recording.erased_at is not None
            name = None if erased else f"audio/{case.recording.file_sha256}"
            if name is not None and name not in written:
                bundle.write(library.audio_path(case.recording), name)
                written.add(name)
            entries.append(_entry(case, name))
        manifest = {"schema": SCHEMA, "cases": entries}
        bundle.writestr(MANIFEST, json.dumps(manifest, allow_nan=False, indent=1))
    return Exported(len(entries), sum(entry["audio"] is None for entry in entries))


def _all_cases(library: CaseLibrary, session: Session, wanted: CaseFilter) -> Iterator[Case]:
    cursor = None
    while True:
        page = library.cases(session, wanted, limit=LARGEST_PAGE, cursor=cursor)
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
        "quarantine_reason": case.quarantine_reason,
        "note": case.note,
        "key": case.key,
    }


def import_cases(
    library: CaseLibrary,
    source: Path,
    actor: str,
    *,
    limits: BundleLimits | None = None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Imported:
    """Take the cases of a bundle into the library, each in a transaction of its own; what is here already stays.

    Args:
        source: path of the ZIP.
        progress: called with the number of cases done and in all.

    Raises:
        BundleError: if the bundle breaks a rule; nothing that was read before is lost, nothing of the rest is kept.
    """
    limits = limits or BundleLimits()
    new: list[str] = []
    known = 0
    refused: dict[str, str] = {}
    try:
        with zipfile.ZipFile(source) as bundle:
            check_names(bundle, source.stat().st_size, limits)
            entries = _manifest(bundle, limits)
            for number, entry in enumerate(entries):
                if entry["audio"] is None:
                    refused[f"case {number}"] = (
                        "its audio was erased where it comes from, so there is nothing to compare"
                    )
                    progress(number + 1, len(entries))
                    continue
                audio = _audio(bundle, entry, limits)
                try:
                    case, fresh = _take(library, entry, audio, actor, f"import {source.name}"[:100])
                except (SignalError, DuplicateError, InvalidRequestError) as error:
                    refused[str(entry["audio"])] = str(error)
                else:
                    known += not fresh
                    new += [case.id] if fresh else []
                progress(number + 1, len(entries))
    except zipfile.BadZipFile as error:
        raise BundleError(f"this is no readable ZIP: {error}") from error
    return Imported(tuple(new), known, refused)


def check_names(bundle: zipfile.ZipFile, packed_bytes: int, limits: BundleLimits) -> None:
    """Raise BundleError for too many entries, a name that leaves the folder, a link, a name twice, or a bomb."""
    infos = bundle.infolist()
    if len(infos) > limits.entries:
        raise BundleError(f"{len(infos)} entries; at most {limits.entries} are allowed: split the bundle")
    seen: set[str] = set()
    for info in infos:
        path = PurePosixPath(info.filename)
        if path.is_absolute() or ".." in path.parts or "\\" in info.filename or ":" in info.filename:
            raise BundleError(f"the name {info.filename[:100]!r} leads out of the bundle")
        if stat.S_ISLNK(info.external_attr >> 16):
            raise BundleError(f"{info.filename[:100]!r} is a link; a bundle holds plain files only")
        if path.as_posix() in seen:
            raise BundleError(f"{info.filename[:100]!r} is there twice")
        seen.add(path.as_posix())
    declared = sum(info.file_size for info in infos)
    if declared > limits.total_bytes or declared > limits.ratio * max(packed_bytes, 1):
        raise BundleError(
            f"{packed_bytes} bytes claim to hold {declared}; at most {limits.ratio:.0f} times as much and "
            f"{limits.total_bytes} bytes are allowed"
        )


def read_entry(bundle: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Return what an entry really holds; raises BundleError once it is more than allowed or than declared."""
    try:
        declared = bundle.getinfo(name).file_size
    except KeyError as error:
        raise BundleError(f"the bundle has no {name[:100]!r}") from error
    parts: list[bytes] = []
    count = 0
    with bundle.open(name) as file:
        while part := file.read(CHUNK):
            count += len(part)
            if count > min(most, declared):
                raise BundleError(f"{name[:100]!r} holds more than the {min(most, declared)} bytes allowed")
            parts.append(part)
    return b"".join(parts)


def _manifest(bundle: zipfile.ZipFile, limits: BundleLimits) -> list[dict[str, Any]]:
    try:
        manifest = json.loads(read_entry(bundle, MANIFEST, limits.manifest_bytes))
    except ValueError as error:
        raise BundleError(f"{MANIFEST} is no JSON: {error}") from error
    if not isinstance(manifest, dict) or manifest.get("schema") != SCHEMA:
        raise BundleError(f'{MANIFEST} must be an object with "schema": "{SCHEMA}"')
    entries = manifest.get("cases")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise BundleError(f'{MANIFEST} must have a list of objects under "cases"')
    for number, entry in enumerate(entries):
        missing = [name for name in ("audio", "sha256", "label", "recording") if name not in entry]
        if missing or not isinstance(entry["recording"], dict):
            raise BundleError(f"case {number} of {MANIFEST} lacks {', '.join(missing) or 'a table `recording`'}")
    return entries


def _audio(bundle: zipfile.ZipFile, entry: Mapping[str, Any], limits: BundleLimits) -> bytes:
    audio = read_entry(bundle, str(entry["audio"]), limits.file_bytes)
    if hashlib.sha256(audio).hexdigest() != entry["sha256"]:
        raise BundleError(f"{str(entry['audio'])[:100]!r} is not what {MANIFEST} declares: its SHA-256 differs")
    return audio


def _take(library: CaseLibrary, entry: Mapping[str, Any], audio: bytes, actor: str, batch: str) -> tuple[Case, bool]:
    """Decode, extract, store and retain one case; whether it is new."""
    description = _description(entry)
    stored = library.audio.put(audio)
    path = library.audio.path(stored.sha256)
    recording = read_recording(path, channel=_whole(entry.get("channel", 0)))
    extraction = extract(recording, description.condition)
    labelling = Labelling(batch=batch, **{name: entry[name] for name in CARRIED if entry.get(name) is not None})
    with library.transaction(actor) as session:
        before = library.version(session)
        row = library.store_recording(session, path, recording, extraction, description)
        case = library.retain(session, row, labelling)
        return case, case.library_version > before


CARRIED = (
    "label",
    "origin",
    "state",
    "mechanism",
    "location",
    "severity",
    "parameters",
    "model_version",
    "verified_by",
    "quarantine_reason",
    "note",
    "key",
)


def _whole(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise InvalidRequestError(f"channel must be a whole number from 0, got {value!r}")
    return value


def _description(entry: Mapping[str, Any]) -> RecordingDescription:
    given = entry["recording"]
    try:
        recorded_at = given.get("recorded_at")
        return RecordingDescription(
            file_name=str(given.get("file_name", "recording.wav")),
            media_type=str(given.get("media_type", "audio/wav")),
            axis=given.get("axis"),
            gearbox=given.get("gearbox"),
            condition=condition_of(given),
            recorded_at=None if recorded_at is None else datetime.fromisoformat(recorded_at),
            extra=dict(given.get("extra", {})),
        )
    except (TypeError, ValueError) as error:
        raise InvalidRequestError(f"the description of {str(entry['audio'])[:100]!r} is not valid: {error}") from error
