"""A recording over HTTP: its bytes, ranges of them, and plots whose numbers are known in closed form."""

import io
import json

import httpx
import numpy as np
import pytest
from PIL import Image

from benchmarks.harness.sounds import RATE_HZ, wav

SECONDS, AMPLITUDE, FREQUENCY_HZ = 4.0, 0.5, 125.0


@pytest.fixture(scope="module")
def content() -> bytes:
    """A pure tone, so that every plot is known."""
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    return wav((AMPLITUDE * np.sin(2 * np.pi * FREQUENCY_HZ * time)).astype(np.float32))


@pytest.fixture
def path(admin: httpx.Client, content: bytes) -> str:
    """Where the recording is; named so that its name would do harm if it were used as a path or as markup."""
    files = {"file": ('../../<b>"tone".wav', content, "text/html")}
    answer = admin.post("/api/v1/cases", files=files, data={"metadata": json.dumps({"label": "tone"})})
    return f"/api/v1/recordings/{answer.raise_for_status().json()['recording']['id']}"


def test_audio_is_the_file_that_came_in(viewer: httpx.Client, path: str, content: bytes) -> None:
    answer = viewer.get(f"{path}/audio")
    assert answer.content == content
    assert answer.headers["content-type"] == "audio/wav"  # whatever the sender claimed
    assert "<b>" not in answer.headers["content-disposition"]
    assert ".." not in answer.headers["content-disposition"]


def test_who_has_the_audio_is_told_so_without_it(viewer: httpx.Client, path: str, content: bytes) -> None:
    head = viewer.head(f"{path}/audio")
    assert (head.status_code, head.content) == (200, b"")
    assert int(head.headers["content-length"]) == len(content)
    known = {"If-None-Match": f'"old", W/{head.headers["etag"]}'}
    for answer in (viewer.get(f"{path}/audio", headers=known), viewer.head(f"{path}/audio", headers=known)):
        assert (answer.status_code, answer.content) == (304, b"")
        assert answer.headers["etag"] == head.headers["etag"]
    assert viewer.get(f"{path}/audio", headers={"If-None-Match": '"old"'}).content == content


@pytest.mark.parametrize(
    ("header", "start", "end"),
    [("bytes=0-99", 0, 100), ("bytes=100-", 100, None), ("bytes=-50", -50, None), ("bytes=10-999999999", 10, None)],
)
def test_range(viewer: httpx.Client, path: str, content: bytes, header: str, start: int, end: int | None) -> None:
    answer = viewer.get(f"{path}/audio", headers={"Range": header})
    assert answer.status_code == 206
    assert answer.content == content[start:end]
    first = start % len(content)
    assert answer.headers["content-range"] == f"bytes {first}-{first + len(answer.content) - 1}/{len(content)}"


def test_range_behind_the_end(viewer: httpx.Client, path: str, content: bytes) -> None:
    answer = viewer.get(f"{path}/audio", headers={"Range": "bytes=99999999-"})
    assert answer.status_code == 416
    assert answer.headers["content-range"] == f"bytes */{len(content)}"


def test_range_of_another_version_is_answered_whole(viewer: httpx.Client, path: str) -> None:
    etag = viewer.get(f"{path}/audio").headers["etag"]
    for if_range, status in ((etag, 206), ('"another"', 200)):
        headers = {"Range": "bytes=0-9", "If-Range": if_range}
        assert viewer.get(f"{path}/audio", headers=headers).status_code == status


def test_spectrogram_by_accept(viewer: httpx.Client, path: str) -> None:
    numbers = viewer.get(f"{path}/spectrogram", headers={"Accept": "application/json"}).json()
    level = np.array(numbers["level_db"])
    assert level.shape == (len(numbers["frequency_hz"]), len(numbers["time_s"]))
    loudest = np.array(numbers["frequency_hz"])[level.argmax(axis=0)]
    assert np.all(np.abs(loudest - FREQUENCY_HZ) <= RATE_HZ / 512)
    drawn = viewer.get(f"{path}/spectrogram", headers={"Accept": "image/png"})
    assert drawn.headers["content-type"] == "image/png"
    image = Image.open(io.BytesIO(drawn.content))
    assert image.size[0] > 800
    assert viewer.get(f"{path}/spectrogram", headers={"Accept": "text/html"}).status_code == 406


def test_features_have_units_and_physics(viewer: httpx.Client, path: str) -> None:
    found = viewer.get(f"{path}/features").json()
    assert found["features"]
    assert all(feature["unit"] and feature["physics"] and feature["source"] for feature in found["features"])
