"""A service that is elsewhere: recordings are sent to it through HTTP, with a key."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from app.recordings.intake import media_type_of
from casebase.store.audio_store import sha256_of

KEY_VARIABLE = "GEARCASE_KEY"
CONNECT_S, ANSWER_S = 10.0, 600.0
PASSING = (408, 425, 429)
"""Statuses below 500 that say no more than: not now."""


class RemoteError(Exception):
    """A recording that the service did not take; the text says why."""


class UnreachableError(RemoteError):
    """The service cannot be reached, or cannot take it at the moment: send it again."""


class RefusedError(RemoteError):
    """The service will not take this recording, however often it is sent."""


@dataclass(frozen=True)
class Remote:
    """A service and a key to it.

    Args:
        url: where its pages are, such as http://127.0.0.1:8000.
    """

    url: str
    key: str

    @classmethod
    def of_environment(cls, url: str) -> "Remote":
        """With the key of the environment; raises RemoteError where there is none."""
        key = os.environ.get(KEY_VARIABLE, "").strip()
        if not key:
            raise RemoteError(f"set {KEY_VARIABLE} to a key with the role operator; `gearcase keys create` makes one")
        return cls(url.rstrip("/"), key)

    def diagnose(self, path: Path, metadata: Mapping[str, object], sha256: str | None = None) -> dict[str, Any]:
        """Send a recording and return its diagnosis; sent again, it is done once and answered as before.

        Raises:
            UnreachableError, RefusedError: if it is not taken; RemoteError where its key is not.
        """
        said = json.dumps(metadata, sort_keys=True)
        once = hashlib.sha256(f"{sha256 or sha256_of(path)} {said}".encode()).hexdigest()
        timeout = httpx.Timeout(ANSWER_S, connect=CONNECT_S)
        try:
            with path.open("rb") as file, httpx.Client(timeout=timeout) as client:
                answer = client.post(
                    f"{self.url}/api/v1/diagnoses",
                    headers={"Authorization": f"Bearer {self.key}", "Idempotency-Key": once},
                    files={"file": (path.name, file, media_type_of(path.name))},
                    data={"metadata": said},
                )
        except (httpx.InvalidURL, httpx.UnsupportedProtocol) as error:
            raise RefusedError(f"{self.url} is no address of a service: {error}") from None
        except httpx.HTTPError as error:
            raise UnreachableError(f"{self.url} does not answer: {error or type(error).__name__}") from None
        return _read(answer)

    def page_of(self, diagnosis: Mapping[str, Any]) -> str:
        """Where the page of a diagnosis is."""
        return f"{self.url}/diagnoses/{diagnosis['id']}"


def _read(answer: httpx.Response) -> dict[str, Any]:
    try:
        document = answer.json()
    except ValueError:
        document = None
    if answer.status_code == httpx.codes.CREATED and isinstance(document, dict):
        return document
    detail = document.get("detail", "") if isinstance(document, dict) else ""
    words = f"the service answered {answer.status_code}. {detail}".strip()
    if answer.status_code in (401, 403):
        raise RemoteError(words)
    if answer.status_code in PASSING or answer.status_code >= 500:
        raise UnreachableError(words)
    raise RefusedError(words)
