"""Idempotency-Key: a POST that is sent again is answered as before and does nothing twice.

The answer is kept in the transaction of the work itself, so that there is an answer exactly if there is the work.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from typing import Annotated

from fastapi import Depends, Header, Request, Response
from pydantic_core import to_json
from sqlalchemy import delete
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from app.http.errors import Unprocessable
from app.http.security import Principal
from app.service import Service, service_of
from casebase.store.models import IdempotencyRecord, now


@dataclass(frozen=True)
class Made:
    """What a POST made: the document to answer, where it is, and what of it may be kept for a repetition."""

    document: object
    location: str | None = None
    headers: dict[str, str] = field(default_factory=dict)
    repeated: object = None
    status: int = 201

    def response(self) -> Response:
        headers = {**self.headers, **({"Location": self.location} if self.location else {})}
        return Response(to_json(self.document, inf_nan_mode="null"), self.status, headers, "application/json")


@dataclass(frozen=True)
class Once:
    """Does a POST's work in one transaction, once per Idempotency-Key."""

    service: Service
    request: Request
    key: str | None

    @property
    def principal(self) -> Principal:
        principal: Principal = self.request.state.principal
        return principal

    def replay(self, *content: object) -> Response | None:
        """Return the kept answer to the same request, or None if there is none.

        Raises:
            Unprocessable: if the key was used with other content.
        """
        if self.key is None:
            return None
        with self.service.library.reading() as session:
            return self._replay(session, self._digest(content))

    def run(self, work: Callable[[Session], Made], *content: object) -> Response:
        """Do the work and keep the answer; `content` is what makes the request the same."""
        digest = self._digest(content)
        request_id = self.request.scope["request_id"]
        try:
            with self.service.library.transaction(self.principal.actor, request_id) as session:
                if self.key is None:
                    return work(session).response()
                session.execute(delete(IdempotencyRecord).where(IdempotencyRecord.created_at < self._since))
                kept = self._replay(session, digest)
                if kept is not None:
                    return kept
                record = IdempotencyRecord(actor=self.principal.key_id, key=self.key, request_sha256=digest)
                session.add(record)
                session.flush()  # a second request with this key waits here for the first
                made = work(session)
                answer = replace(made, document=made.repeated or made.document).response()
                record.status, record.body = answer.status_code, bytes(answer.body)
                record.headers = {name: value for name, value in answer.headers.items() if name != "content-length"}
                return made.response()
        except IntegrityError:
            kept = self.replay(*content)
            if kept is None:
                raise
            return kept

    def _digest(self, content: tuple[object, ...]) -> str:
        call = [self.request.method, self.request.url.path, *content]
        return hashlib.sha256(json.dumps(call, sort_keys=True, default=str).encode()).hexdigest()

    def _replay(self, session: Session, digest: str) -> Response | None:
        record = session.get(IdempotencyRecord, (self.principal.key_id, self.key))
        if record is None or record.status is None or record.created_at < self._since:
            return None
        if record.request_sha256 != digest:
            raise Unprocessable(
                f"The Idempotency-Key {self.key!r} was used for another request; use a new one for new content."
            )
        headers = {name: str(value) for name, value in record.headers.items()} | {"Idempotent-Replay": "true"}
        return Response(record.body, record.status, headers)

    @property
    def _since(self) -> datetime:
        """From when on answers are remembered."""
        return now() - timedelta(hours=self.service.settings.idempotency_hours)


def once(
    request: Request,
    idempotency_key: Annotated[
        str | None,
        Header(
            min_length=1,
            max_length=255,
            pattern=r"^[\x20-\x7e]+$",
            description="a key of your own: asked again with it, it is done once and answered as before",
        ),
    ] = None,
) -> Once:
    return Once(service_of(request), request, idempotency_key)


OnlyOnce = Annotated[Once, Depends(once)]
