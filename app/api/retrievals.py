"""Retrievals: the nearest cases of a recording; nothing is stored."""

from fastapi import APIRouter

from app.http.errors import Unprocessable
from app.http.security import Viewer
from app.http.uploads import TheUpload, multipart_body
from app.recordings.intake import decoded, hear
from app.recordings.metadata import RecordingMetadata, read_metadata
from app.recordings.neighbours import NeighbourQuery, RetrievalAnswer, neighbours_of, neighbours_of_stored
from app.service import TheService

router = APIRouter(tags=["retrievals"])


@router.post("/retrievals", openapi_extra=multipart_body(RecordingMetadata, query=NeighbourQuery))
def retrieve(_: Viewer, upload: TheUpload, service: TheService) -> RetrievalAnswer:
    """Find the nearest cases of a recording, and why they are near. Nothing is stored.

    Part `file` with the sound and part `metadata` (JSON) with what is known of it, as for a diagnosis; or
    `recording_id` or `case_id` in the part `query` for what is stored already, and then without the
    cases of the same sound.
    """
    upload.only("file", "metadata", "query")
    limit = service.settings.metadata_bytes
    query: NeighbourQuery = read_metadata(upload.text("query", limit), NeighbourQuery, "query")
    sent = {"file", "metadata"} & {*upload.files, *upload.fields}
    if query.recording_id or query.case_id:
        if sent:
            raise Unprocessable(f"The query names what is stored, so leave out {' and '.join(sorted(sent))}.")
        return neighbours_of_stored(service.library, query)
    if "file" not in upload.files:
        raise Unprocessable(
            "There is no recording: send one in the part 'file', or name a `recording_id` or `case_id` in the part "
            "'query'."
        )
    file = upload.file("file")
    metadata = read_metadata(upload.text("metadata", limit), RecordingMetadata)
    recording = decoded(file.path, metadata)
    heard = hear(service.library, recording, file.name, file.media_type, metadata)
    return neighbours_of(service.library, heard, query)
