"""If-None-Match: whether the client already has what it asks for."""

from typing import Annotated

from fastapi import Header, Response, status

IfNoneMatch = Annotated[
    str | None, Header(max_length=1000, description="ETags that the client has; of the current one the answer is 304")
]


def has_already(if_none_match: str | None, etag: str) -> bool:
    """Return whether one of the tags is the current one; weak ones count like strong ones (RFC 9110, 13.1.2).

    >>> has_already('"1", W/"2"', '"2"'), has_already("*", '"2"'), has_already('"1"', '"2"'), has_already(None, '"2"')
    (True, True, False, False)
    """
    tags = [tag.strip().removeprefix("W/") for tag in (if_none_match or "").split(",")]
    return etag in tags or tags == ["*"]


def not_modified(headers: dict[str, str]) -> Response:
    """Return the answer to a client that has it already."""
    return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=headers)
