"""A recording comes in with what its recorder wrote into it, and lossy only where the installation takes it."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import pytest

from app.recordings.intake import RecordingMetadata, take_in
from app.settings import settings_of
from benchmarks.encoded_sounds import RATE, chunk, encode, fmt, noise, pcm, riff
from casebase.library import CaseLibrary
from signals.errors import NotAudioError

SAMPLES = noise(3 * RATE)[:, 0]
BEXT = bytes(256) + b"Zoom H5".ljust(64, b"\0") + b"2026-07-01" + b"12:00:00" + bytes(264)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[CaseLibrary]:
    """The library of a site in Stockholm that takes no lossy sound."""
    monkeypatch.setenv("GEARCASE_TIME_ZONE", "Europe/Stockholm")
    monkeypatch.setenv("GEARCASE_ACCEPT_LOSSY", "false")
    settings_of.cache_clear()
    library = CaseLibrary.open(tmp_path / "data")
    yield library
    library.close()
    settings_of.cache_clear()


def test_the_recorders_clock_and_name_are_kept(site: CaseLibrary, tmp_path: Path) -> None:
    path = tmp_path / "bwf.wav"
    path.write_bytes(riff(fmt(), chunk(b"bext", BEXT), chunk(b"data", pcm(SAMPLES))))
    intake = take_in(site, path, path.name, "audio/wav", RecordingMetadata.model_validate({}))
    when = intake.description.recorded_at
    assert when is not None
    assert (when.isoformat(), when.utcoffset()) == ("2026-07-01T12:00:00+02:00", timedelta(hours=2))
    assert intake.description.extra["device"] == "Zoom H5"
    assert any("without an offset" in remark and "Europe/Stockholm" in remark for remark in intake.remarks)


def test_a_recorders_clock_that_is_ahead_says_nothing(site: CaseLibrary, tmp_path: Path) -> None:
    path = tmp_path / "bwf.wav"
    path.write_bytes(riff(fmt(), chunk(b"bext", BEXT.replace(b"2026", b"2099")), chunk(b"data", pcm(SAMPLES))))
    intake = take_in(site, path, path.name, "audio/wav", RecordingMetadata.model_validate({}))
    assert intake.description.recorded_at is None
    assert any("future" in remark for remark in intake.remarks)


def test_clocks_of_recorder_and_service_may_differ() -> None:
    for hours in (-1, 20):
        RecordingMetadata.model_validate({"recorded_at": (datetime.now(UTC) + timedelta(hours=hours)).isoformat()})


def test_what_is_said_comes_before_the_recorders_clock(site: CaseLibrary, tmp_path: Path) -> None:
    path = tmp_path / "bwf.wav"
    path.write_bytes(riff(fmt(), chunk(b"bext", BEXT), chunk(b"data", pcm(SAMPLES))))
    said = RecordingMetadata.model_validate({"recorded_at": "2026-07-02T08:00:00Z"})
    intake = take_in(site, path, path.name, "audio/wav", said)
    assert intake.description.recorded_at == datetime(2026, 7, 2, 8, tzinfo=UTC)
    assert intake.remarks == ()


def test_lossy_sound_is_refused_where_it_is_switched_off_and_nothing_is_kept(site: CaseLibrary, tmp_path: Path) -> None:
    path = encode(tmp_path / "memo.m4a", SAMPLES, RATE, "mp4", "aac", 64_000)
    with pytest.raises(NotAudioError, match="GEARCASE_ACCEPT_LOSSY=false"):
        take_in(site, path, path.name, "audio/mp4", RecordingMetadata.model_validate({}))
    assert not [each for each in (tmp_path / "data").rglob("*") if each.is_file() and "audio" in each.parts]


def test_a_memo_of_a_phone_is_diagnosed_and_flagged(operator: httpx.Client, tmp_path: Path) -> None:
    path = encode(tmp_path / "memo.m4a", SAMPLES, RATE, "mp4", "aac", 64_000)
    answer = operator.post("/api/v1/diagnoses", files={"file": ("memo.m4a", path.read_bytes())})
    assert answer.status_code == 201, answer.text
    assert "lossy" in {flag["name"] for flag in answer.json()["quality"]}
    recording = answer.json()["recording"]
    sound = operator.get(f"/api/v1/recordings/{recording['id']}/audio")
    assert sound.headers["content-type"] == "audio/mp4"
