"""Recordings: their sound, byte ranges included, and what it looks like."""

import re
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import quote

from fastapi import APIRouter, Header, Query, Request, Response, status
from fastapi.responses import StreamingResponse
from pydantic import BaseModel

from app.documents import Answer, ErasedAnswer, Identifier, RecordingAnswer
from app.http.errors import RangeNotSatisfiable
from app.http.headers import IfNoneMatch, chosen, has_already, not_modified
from app.http.security import Admin, ReadingLimit, Viewer
from app.recordings import views
from app.recordings.intake import media_type_of
from app.report.recorded import decoded
from app.service import Reading, Service, TheService
from casebase.recordings import named_features
from casebase.store import erasing
from casebase.store.models import Extractor, StoredRecording
from signals.crest import WINDOW_S
from signals.features import EXTRACTOR_VERSION, catalogue
from signals.spectra import PAPER_CUTOFF_HZ

router = APIRouter(prefix="/recordings/{recording_id}", tags=["recordings"])

BLOCK = 256 * 1024
UNCHANGING = {"Cache-Control": "private, max-age=31536000, immutable"}
UNTIL_ERASED = {"Cache-Control": "private, max-age=300"}
"""What shows a recording never changes, but is to be gone soon after the audio was erased."""
SINGLE_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")
PNG, JSON = "image/png", "application/json"


@router.get("")
def get_recording(_: Viewer, session: Reading, service: TheService, recording_id: Identifier) -> RecordingAnswer:
    """A recording and how it was taken."""
    return RecordingAnswer.model_validate(service.library.retrieve.recording(session, recording_id))


@router.delete("")
def erase_recording(admin: Admin, service: TheService, request: Request, recording_id: Identifier) -> ErasedAnswer:
    """Erase the audio, for good, with all that shows it; features, diagnoses, cases and the audit stay.

    It goes for all recordings of this file. Recordings of the same sound in other files are named in the answer.
    """
    with service.library.transaction(admin.actor, request.scope["request_id"]) as session:
        done = erasing.erase(service.library, session, recording_id)
    views.forget()
    return ErasedAnswer.model_validate(done)


@router.get(
    "/audio",
    response_class=Response,
    responses={
        200: {"content": {"audio/*": {}}},
        206: {"content": {"audio/*": {}}, "description": "the range asked for"},
        304: {"description": "as the client has it"},
    },
)
def audio(
    _: Viewer,
    session: Reading,
    service: TheService,
    recording_id: Identifier,
    byte_range: Annotated[str | None, Header(alias="Range", max_length=100, description="bytes=FIRST-LAST")] = None,
    if_range: Annotated[str | None, Header(max_length=100, description="ETag that the range is meant for")] = None,
    if_none_match: IfNoneMatch = None,
) -> Response:
    """The file as it came in, whole or one range of it (several ranges are answered by the whole)."""
    row = service.library.retrieve.recording(session, recording_id)
    service.library.retrieve.audio_path(row)
    if has_already(if_none_match, _etag(row)):
        return not_modified(_file_headers(row))
    return file_answer(service, row, byte_range, if_range)


def _etag(row: StoredRecording) -> str:
    return f'"{row.file_sha256}"'


def _file_headers(row: StoredRecording) -> dict[str, str]:
    return {
        **UNTIL_ERASED,
        "ETag": _etag(row),
        "Content-Disposition": f"inline; filename*=UTF-8''{quote(row.file_name)}",
    }


def file_answer(service: Service, row: StoredRecording, byte_range: str | None, if_range: str | None) -> Response:
    """Return the file of a recording, whole or one range of it."""
    path = service.library.retrieve.audio_path(row)
    headers, etag = _file_headers(row), _etag(row)
    wanted = byte_range if if_range in (None, etag) else None
    start, end, code, ranged = asked_range(wanted, row.byte_count)
    headers |= {**ranged, "Content-Length": str(end - start)}
    return StreamingResponse(_bytes(path, start, end), code, headers, media_type=media_type_of(row.file_name))


def asked_range(header: str | None, size: int) -> tuple[int, int, int, dict[str, str]]:
    """Return the bytes asked for as [start, end), with the status and headers of an answer that has them.

    Everything is asked for where the header is no single range of bytes.

    Raises:
        RangeNotSatisfiable: if the range begins behind the end.
    """
    start, end = _range(header, size)
    headers = {"Accept-Ranges": "bytes"}
    if (start, end) == (0, size):
        return start, end, status.HTTP_200_OK, headers
    headers["Content-Range"] = f"bytes {start}-{end - 1}/{size}"
    return start, end, status.HTTP_206_PARTIAL_CONTENT, headers


def _range(header: str | None, size: int) -> tuple[int, int]:
    match = SINGLE_RANGE.fullmatch(header.strip()) if header else None
    if match is None or match.groups() == ("", ""):
        return 0, size
    first, last = match.groups()
    if first == "":
        start, end = max(0, size - int(last)), size
    else:
        start, end = int(first), min(size, int(last) + 1) if last else size
        if last and int(last) < start:
            return 0, size
    if start >= size:
        raise RangeNotSatisfiable(
            f"The recording has {size} bytes; {header!r} begins behind them.",
            headers={"Content-Range": f"bytes */{size}"},
        )
    return start, end


def _bytes(path: Path, start: int, end: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        file.seek(start)
        left = end - start
        while left > 0 and (block := file.read(min(BLOCK, left))):
            left -= len(block)
            yield block


def shown(
    service: Service, row: StoredRecording, look: Callable[..., BaseModel | bytes], *how: object, kind: str = JSON
) -> Response:
    """Answer what a recording looks like, as it was computed before where that is kept."""

    def drawn() -> bytes:
        found = look(decoded(service, row), *how)
        return found if isinstance(found, bytes) else found.model_dump_json().encode()

    path = service.library.retrieve.audio_path(row)
    content = views.kept((path, row.channel, row.unit, look.__name__, *how), drawn)
    return Response(content, headers=UNTIL_ERASED, media_type=kind)


@router.get("/waveform", response_model=views.Waveform, dependencies=[ReadingLimit])
def waveform(
    _: Viewer,
    session: Reading,
    service: TheService,
    recording_id: Identifier,
    points: Annotated[int, Query(ge=10, le=200_000, description="intervals")] = 2000,
) -> Response:
    """Lowest and highest sample of each of `points` intervals."""
    return shown(service, service.library.retrieve.recording(session, recording_id), views.waveform, points)


@router.get("/spectrum", response_model=views.Spectrum, dependencies=[ReadingLimit])
def spectrum(
    _: Viewer,
    session: Reading,
    service: TheService,
    recording_id: Identifier,
    resolution_hz: Annotated[float, Query(ge=0.1, le=1000, description="width of a line [Hz]")] = 2.0,
) -> Response:
    """Averaged power spectrum."""
    return shown(service, service.library.retrieve.recording(session, recording_id), views.spectrum, resolution_hz)


@router.get("/crest", response_model=views.CrestFactor, dependencies=[ReadingLimit])
def crest(
    _: Viewer,
    session: Reading,
    service: TheService,
    recording_id: Identifier,
    window_s: Annotated[float, Query(ge=0.01, le=60, description="length of a window [s]")] = WINDOW_S,
    low_pass_hz: Annotated[
        int, Query(ge=0, le=1_000_000, description="what lies above is left out [Hz]; 0: nothing is")
    ] = round(PAPER_CUTOFF_HZ),
) -> Response:
    """Crest factor over time, peak of each window over the RMS of the whole record, beside RMS and peak."""
    row = service.library.retrieve.recording(session, recording_id)
    return shown(service, row, views.crest, window_s, low_pass_hz)


@router.get(
    "/spectrogram",
    response_model=views.Spectrogram,
    responses={200: {"content": {PNG: {}}}},
    dependencies=[ReadingLimit],
)
def spectrogram(
    _: Viewer,
    session: Reading,
    service: TheService,
    recording_id: Identifier,
    request: Request,
    columns: Annotated[int, Query(ge=10, le=2000, description="columns of the picture, at most")] = 800,
    theme: Annotated[Literal["light", "dark"], Query(description="colours of the picture")] = "light",
) -> Response:
    """Level over time and frequency: a PNG by default, numbers for `Accept: application/json`."""
    kind = chosen(request.headers.get("accept", "*/*"), (PNG, JSON))
    row = service.library.retrieve.recording(session, recording_id)
    if kind == JSON:
        answer = shown(service, row, views.spectrogram, columns)
    else:
        answer = shown(service, row, views.spectrogram_png, columns, theme == "dark", kind=PNG)
    answer.headers["Vary"] = "Accept"
    return answer


class Feature(BaseModel):
    """One feature: null where this recording does not allow it."""

    name: str
    value: float | None
    unit: str
    physics: str
    source: str


class Features(Answer):
    """The feature vector that diagnosis compares, and what was found on the way."""

    extractor_version: str
    features: list[Feature]
    motion: dict[str, object]
    events: list[dict[str, object]]


@router.get("/features")
def features(_: Viewer, session: Reading, service: TheService, recording_id: Identifier) -> Features:
    """Every feature with its unit and a sentence of physics."""
    row = service.library.retrieve.recording(session, recording_id)
    stored = service.library.retrieve.features(session, row)
    names = session.get_one(Extractor, EXTRACTOR_VERSION).names
    values = named_features(stored, names)
    return Features(
        extractor_version=EXTRACTOR_VERSION,
        features=[Feature(value=values[name], **asdict(each)) for name, each in catalogue().items()],
        motion=stored.motion,
        events=stored.events,
    )
