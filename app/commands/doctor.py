"""`gearcase doctor`: check this installation and say what to do."""

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer
from sqlalchemy import exists, func, select
from sqlalchemy.orm import Session

from app.api.health import FREE_BYTES
from app.cleanup import leftovers
from app.commands.exit_codes import FAILURE
from app.commands.frame import frame_of
from app.http.keys import Role
from app.investigations import PARTS, files_of
from casebase.errors import NotFoundError
from casebase.library import CaseLibrary
from casebase.store.audio_store import sha256_of
from casebase.store.integrity import RESTORE, faults_of
from casebase.store.models import ApiKey, FeatureRow, StoredInvestigation, StoredRecording
from signals.errors import DecoderUnavailableError
from signals.features import EXTRACTOR_VERSION
from signals.reading.decode import warm_up


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at; `fault` says what is wrong and what to do, None is good."""

    what: str
    found: str
    fault: str | None = None


def register(app: typer.Typer) -> None:
    app.command("doctor")(doctor)


def doctor(
    context: typer.Context,
    thorough: Annotated[bool, typer.Option(help="read every recording and compare its SHA-256")] = False,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Check this installation and say what to do; ends with 1 if something is wrong."""
    frame = frame_of(context)
    with frame.library() as library, library.reading() as session:
        findings = [_database(library, thorough)]
        if findings[0].fault is None:
            findings += [each for check in CHECKS for each in check(library, session)]
            findings += _audio(library, session, thorough)
            findings.append(_leftovers(library, session, frame.settings.incoming))
    if json:
        frame.print_json([asdict(finding) for finding in findings])
    else:
        for finding in findings:
            frame.print(f"{'WRONG' if finding.fault else 'good '}  {finding.what}: {finding.found}")
            if finding.fault:
                frame.print(f"       {finding.fault}")
    raise typer.Exit(FAILURE if any(finding.fault for finding in findings) else 0)


def _database(library: CaseLibrary, thorough: bool) -> Finding:
    faults = faults_of(library.engine, thorough=thorough)
    if faults:
        return Finding("database", f"is damaged: {'; '.join(faults)}", RESTORE)
    if library.engine.dialect.name != "sqlite":
        return Finding("database", "PostgreSQL checks its pages itself, where data checksums are switched on")
    checked = "tables and indexes are whole" if thorough else "its pages are whole (for its indexes see --thorough)"
    return Finding("database", checked)


def _leftovers(library: CaseLibrary, session: Session, incoming: Path) -> Finding:
    """Of processes that were killed; and audio without a row, of requests that were refused after it was kept."""
    known = set(session.scalars(select(StoredRecording.file_sha256)))
    for inputs in session.scalars(select(StoredInvestigation.inputs)):
        known |= {str(file["sha256"]) for part in PARTS for file in files_of(inputs, part)}
    unspoken = [library.audio.path_of(sha256) for sha256 in library.audio.hashes() if sha256 not in known]
    size = sum(path.stat().st_size for path in unspoken)
    left = leftovers(library, incoming, remove=False)
    return Finding(
        "leftovers",
        f"{left} that the next start of the service removes, {len(unspoken)} files of audio that no row speaks of "
        f"({size >> 20} MiB)",
    )


def _folder(library: CaseLibrary, _: Session) -> Iterator[Finding]:
    free = shutil.disk_usage(library.data_dir).free
    fault = None if free > FREE_BYTES else "Make room: uploads are refused soon."
    yield Finding("disk", f"{free >> 20} MiB free where the data folder lies", fault)
    writable = os.access(library.data_dir, os.W_OK)
    yield Finding(
        "data folder",
        f"{library.data_dir} is {'writable' if writable else 'not writable'}",
        None if writable else "Give the folder to the user who runs the service.",
    )


def _keys(_: CaseLibrary, session: Session) -> Iterator[Finding]:
    admins = session.scalar(
        select(func.count()).select_from(ApiKey).where(ApiKey.role == Role.ADMIN.value, ApiKey.revoked_at.is_(None))
    )
    fault = None if admins else "Run `gearcase keys create --role admin --name NAME`."
    yield Finding("keys", f"{admins} admin keys in force", fault)


def _cases(library: CaseLibrary, session: Session) -> Iterator[Finding]:
    counts = library.retrieve.counts(session)
    shown = ", ".join(f"{count} {label} {origin}" for (label, origin), count in sorted(counts.items()))
    fault = None if counts else "Run `gearcase cases add FILE... --label LABEL`, or `gearcase starter`."
    yield Finding("library", shown or "no cases", fault)


def _features(_: CaseLibrary, session: Session) -> Iterator[Finding]:
    known = exists().where(
        FeatureRow.recording_id == StoredRecording.id, FeatureRow.extractor_version == EXTRACTOR_VERSION
    )
    old = session.scalar(select(func.count()).select_from(StoredRecording).where(~known))
    fault = "Export the cases, and import them: their features are taken again." if old else None
    yield Finding("features", f"{old} recordings lack features of the present extractor: not searched", fault)


def _decoder(_: CaseLibrary, __: Session) -> Iterator[Finding]:
    try:
        warm_up()
    except DecoderUnavailableError as error:
        yield Finding("decoder", "does not start", str(error))
        return
    yield Finding("decoder", "starts in its limited process")


def _audio(library: CaseLibrary, session: Session, thorough: bool) -> Iterator[Finding]:
    missing, changed, number = [], [], 0
    for row in session.scalars(select(StoredRecording).execution_options(yield_per=500)):
        if row.erased_at is not None:
            continue
        number += 1
        try:
            path = library.audio.path(row.file_sha256)
        except NotFoundError:
            missing.append(row.id)
            continue
        if thorough and sha256_of(path) != row.file_sha256:
            changed.append(row.id)
    looked = "read and compared" if thorough else "there (their bytes were not read; see --thorough)"
    fault = None
    if missing or changed:
        names = ", ".join((missing + changed)[:5])
        fault = f"{len(missing)} are missing and {len(changed)} changed ({names}, ...): restore them from a backup."
    yield Finding("recordings", f"{number - len(missing) - len(changed)} of {number} are {looked}", fault)


CHECKS: tuple[Callable[[CaseLibrary, Session], Iterator[Finding]], ...] = (_folder, _keys, _cases, _features, _decoder)
