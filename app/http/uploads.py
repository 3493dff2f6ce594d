"""Uploads: streamed to a temporary file after the door has let them in, a few at a time."""

import hashlib
import os
import re
import tempfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, aclosing, asynccontextmanager
from dataclasses import dataclass
from email.header import decode_header, make_header
from email.message import Message
from email.utils import collapse_rfc2231_value
from pathlib import Path
from typing import Annotated, Any, TypeVar
from urllib.parse import unquote

from fastapi import Depends, Request
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel
from starlette.datastructures import FormData, Headers, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser

from app.http.errors import BadRequest, TooLarge, Unprocessable, UnsupportedMedia
from app.http.security import ConcurrencyLimiter
from app.recordings.intake import Log, RecordingMetadata, read_metadata
from app.service import Service, service_of
from casebase.store.stale_locks import hold
from signals.errors import TextError
from signals.reading.text import is_whole, text_of

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


Described = TypeVar("Described", bound=RecordingMetadata)
BLOCK = 1024 * 1024
NAME_CHARACTERS = 255
BINARY = {"type": "string", "format": "binary"}
SEVERAL = ("sound", "telemetry", "as_new", "axis")
"""Parts that may come more than once: recordings of one axis, axes of a robot's joints."""


@dataclass(frozen=True)
class UploadedFile:
    """One file of a form: where its bytes are, until the request ends."""

    path: Path
    name: str
    media_type: str
    size: int
    sha256: str


@dataclass(frozen=True)
class Upload:
    """A multipart request: its files by the name of their part, as they came, and its text fields by name."""

    files: dict[str, list[UploadedFile]]
    fields: dict[str, str]

    def file(self, name: str) -> UploadedFile:
        """Return the first file of this part.

        Raises:
            Unprocessable: if there is none.
        """
        if name in self.files:
            return self.files[name][0]
        parts = ", ".join(sorted({*self.files, *self.fields})) or "none"
        raise Unprocessable(f"The form needs a file in the part {name!r}; it has the parts: {parts}.")

    def all_of(self, name: str) -> list[UploadedFile]:
        """Return the files of all parts of this name, as they came."""
        return self.files.get(name, [])

    def text(self, name: str, limit: int) -> str:
        """Return the text of this part, whether sent as a field or as a file; empty where it is missing."""
        if name not in self.files:
            return text_of(self.fields.get(name, ""))
        return _text(name, self.file(name), limit)

    def texts(self, name: str, limit: int) -> dict[str, str]:
        """Return the texts of all files of this part, by the names of the files.

        Raises:
            Unprocessable: if two have the same name, or one is not UTF-8 text.
            TooLarge: if one is longer than the limit.
        """
        found: dict[str, str] = {}
        for file in self.all_of(name):
            if file.name in found:
                raise Unprocessable(f"The form has two files {file.name!r} in the parts {name!r}; give each its name.")
            found[file.name] = _text(name, file, limit)
        return found

    def recording(self, model: type[Described], limit: int) -> tuple[Described, Log | None, tuple[object, ...]]:
        """Return what is said of the recording in the part `file`, the telemetry beside it, and what makes the request
        the same as another.

        Raises:
            Unprocessable: if parts are missing, unknown, or one too many.
        """
        sound, logs = self.file("file"), self.all_of("telemetry")
        self.only("file", "metadata", "telemetry", "channels")
        metadata: Described = read_metadata(self.text("metadata", limit), model)
        channels = self.text("channels", limit).strip() or None
        if len(logs) > 1 or (channels and not logs):
            raise Unprocessable(
                f"The form has {len(logs)} tables in the part 'telemetry'; one goes with a recording, and 'channels' "
                "with that."
            )
        log = Log(logs[0].path, channels) if logs else None
        return metadata, log, (sound.sha256, metadata.description(), *([logs[0].sha256, channels] if logs else []))

    def filled(self) -> "Upload":
        """Return it without what is empty: a browser sends that for each field that was left alone."""
        filled = {name: [file for file in files if file.size] for name, files in self.files.items()}
        fields = {name: text for name, text in self.fields.items() if text.strip()}
        return Upload({name: files for name, files in filled.items() if files}, fields)

    def only(self, *known: str) -> None:
        """Refuse parts that nobody asked for.

        Raises:
            Unprocessable: if there are any.
        """
        unknown = sorted({*self.files, *self.fields} - set(known))
        if unknown:
            raise Unprocessable(f"The form has unknown parts: {', '.join(unknown)}. Known: {', '.join(known)}.")


def _text(part: str, file: UploadedFile, limit: int) -> str:
    if file.size > limit:
        raise TooLarge(f"The part {part!r} has {file.size} bytes; it may have {limit}.")
    try:
        return text_of(file.path.read_bytes())
    except TextError:
        raise Unprocessable(f"The part {part!r} is not UTF-8 text.") from None


def _store(part: UploadFile, folder: Path, number: int) -> UploadedFile:
    digest = hashlib.sha256()
    path = folder / str(number)
    with path.open("wb") as target:
        while block := part.file.read(BLOCK):
            digest.update(block)
            target.write(block)
    name = Path(plain_name(part.filename or "").replace("\\", "/")).name
    printable = "".join(character for character in name if character.isprintable())[:NAME_CHARACTERS]
    media_type = part.content_type or "application/octet-stream"
    return UploadedFile(path, printable or "unnamed", media_type, part.size or 0, digest.hexdigest())


def check_whole(name: str, text: str) -> None:
    """Refuse a field of a form that no database could hold.

    Raises:
        Unprocessable: if it has NUL or half a character.
    """
    if not (is_whole(name) and is_whole(text)):
        raise Unprocessable(f"The part {name!a} has NUL or half a character in it: send text as UTF-8.")


def _store_all(form: FormData, folder: Path) -> Upload:
    files: dict[str, list[UploadedFile]] = {}
    fields: dict[str, str] = {}
    for number, (name, value) in enumerate(form.multi_items()):
        if name in fields or (name in files and (name not in SEVERAL or isinstance(value, str))):
            raise Unprocessable(f"The form has the part {name!r} twice; send one recording per request.")
        if isinstance(value, str):
            check_whole(name, value)
            fields[name] = value
        else:
            files.setdefault(name, []).append(_store(value, folder, number))
    return Upload(files, fields)


def is_form(headers: Headers) -> bool:
    """Whether a request says that its body is an upload; where a route takes none, that says nothing."""
    return headers.get("content-type", "").lower().startswith("multipart/form-data")


@asynccontextmanager
async def received(request: Request, service: Service) -> AsyncIterator[Upload]:
    """Read a multipart request into a temporary folder, gone afterwards.

    Raises:
        UnsupportedMedia: if it is no multipart request.
        BadRequest: if the form cannot be parsed or has too many or too long parts.
    """
    settings = service.settings
    if not is_form(request.headers):
        content_type = request.headers.get("content-type", "") or "without a content type"
        raise UnsupportedMedia(f"Send multipart/form-data with the part 'file'; this is {content_type}.")
    async with AsyncExitStack() as stack:
        stream = await stack.enter_async_context(aclosing(request.stream()))
        parser = FormParser(
            request.headers,
            stream,
            max_files=settings.form_parts,
            max_fields=settings.form_parts,
            max_part_size=settings.metadata_bytes,
        )
        try:
            form = await parser.parse()
        except MultiPartException as error:
            raise BadRequest(f"The form cannot be read: {error.message}") from None
        stack.push_async_callback(form.close)
        settings.incoming.mkdir(parents=True, exist_ok=True)
        folder = stack.enter_context(tempfile.TemporaryDirectory(dir=settings.incoming))
        descriptor = os.open(folder, os.O_RDONLY)
        stack.callback(os.close, descriptor)
        hold(descriptor)
        yield await run_in_threadpool(_store_all, form, Path(folder))


async def upload_of(request: Request) -> AsyncIterator[Upload | None]:
    """Dependency, after the one for the role: the multipart request, or None where the body is JSON."""
    if request.headers.get("content-type", "").lower().startswith("application/json"):
        yield None
        return
    uploads: ConcurrencyLimiter = request.app.state.uploads
    at_work: ConcurrencyLimiter = request.app.state.at_work
    key_id = request.state.principal.key_id
    async with (
        uploads.enter(key_id),
        received(request, service_of(request)) as upload,
        at_work.enter(key_id),
    ):
        yield upload


async def needed_upload(upload: Annotated[Upload | None, Depends(upload_of, scope="function")]) -> Upload:
    if upload is None:
        raise UnsupportedMedia("Send multipart/form-data with the part 'file'; this is application/json.")
    return upload


MaybeUpload = Annotated[Upload | None, Depends(upload_of, scope="function")]
TheUpload = Annotated[Upload, Depends(needed_upload, scope="function")]


def multipart_body(
    metadata: type[BaseModel], instead: type[BaseModel] | None = None, query: type[BaseModel] | None = None
) -> dict[str, Any]:
    """The OpenAPI of a request with the parts `file` and `metadata`, or with a JSON document instead.

    Args:
        query: of a part `query`, which can stand for the file; else there may be telemetry beside it.
    """
    content: dict[str, Any] = {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["file"],
                "additionalProperties": False,
                "properties": {
                    "file": {**BINARY, "description": "WAV, FLAC, or what a phone records"},
                    "metadata": {**metadata.model_json_schema(), "description": "JSON: what is known of the recording"},
                },
            },
            "encoding": {"file": {"contentType": "audio/wav"}, "metadata": {"contentType": "application/json"}},
        }
    }
    if any(field.is_required() for field in metadata.model_fields.values()):
        content["multipart/form-data"]["schema"]["required"].append("metadata")
    parts = content["multipart/form-data"]["schema"]["properties"]
    if query is None:
        parts["telemetry"] = {
            **BINARY,
            "description": "time and angle of the same motion, a table as of investigations",
        }
        parts["channels"] = {"type": "string", "description": "channel map of the telemetry, TOML or the same as JSON"}
    else:
        del content["multipart/form-data"]["schema"]["required"]
        described = {**query.model_json_schema(), "description": "JSON: what is looked for, and how"}
        parts["query"] = described
        content["multipart/form-data"]["encoding"]["query"] = {"contentType": "application/json"}
    if instead is not None:
        content["application/json"] = {"schema": instead.model_json_schema()}
    return {"requestBody": {"required": True, "content": content}}
