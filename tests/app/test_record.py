"""`gearcase record`: a real capture through PortAudio, from a sound system that plays a file into the microphone."""

import signal
from collections.abc import Iterator
from ctypes.util import find_library
from pathlib import Path
from threading import Event

import numpy as np
import pytest
import soundfile
from numpy.typing import NDArray

from app.recordings.microphone import QUIET_DBFS, Level, record
from benchmarks.harness.live import Done, LiveServer, gearcase
from benchmarks.harness.sounds import hum

RATE_HZ = 8000
ALSA = Path("/usr/share/alsa/alsa.conf")
CONFIGURATION = """<{system}>
pcm.microphone {{
  type file
  slave.pcm "null"
  file "/dev/null"
  infile "{heard}"
  format "raw"
}}
"""


def play(heard: Path, samples: NDArray[np.floating]) -> None:
    """Let the microphone hear these samples from when it is opened next."""
    samples.astype("<f4").tofile(heard)


@pytest.fixture(scope="module")
def heard(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The file that the microphone hears; PortAudio reads once in a process which microphones there are."""
    if not ALSA.exists() or find_library("portaudio") is None:
        pytest.skip("no PortAudio and ALSA here (libportaudio2)")
    folder = tmp_path_factory.mktemp("microphone")
    (folder / "asound.conf").write_text(CONFIGURATION.format(system=ALSA, heard=folder / "heard.raw"))
    play(folder / "heard.raw", np.zeros(RATE_HZ))
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ALSA_CONFIG_PATH", str(folder / "asound.conf"))
        yield folder / "heard.raw"
    for number, handler in handlers.items():
        signal.signal(number, handler)


def recorded(tmp_path: Path, seconds: float, *words: str) -> Done:
    said = ("--seconds", str(seconds), "--rate", str(RATE_HZ), "--device", "microphone", "--out", tmp_path / "out.wav")
    return gearcase("record", *said, *words, data_dir=tmp_path / "nothing")


def test_what_the_microphone_hears_is_written_as_it_is_and_sent(
    heard: Path, live_server: LiveServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hum whose motion repeats and rests, at half of full scale."""
    monkeypatch.setenv("GEARCASE_KEY", live_server.keys["operator"])
    played = hum(40.0, 1) * np.abs(np.sin(np.pi * np.arange(40 * RATE_HZ) / RATE_HZ))
    played = np.asarray(0.5 * played / np.abs(played).max(), dtype=np.float32)
    play(heard, played)
    done = recorded(tmp_path, 8, "--send", "--url", live_server.url, "--axis", "bench", "--gearbox", "recorded")
    assert done.code == 0, done.stderr
    assert "The check: the recording can be diagnosed" in done.stderr
    samples, rate_hz = soundfile.read(tmp_path / "out.wav")
    assert (rate_hz, samples.size) == (RATE_HZ, 8 * RATE_HZ)
    assert np.abs(samples - played[: samples.size]).max() <= 2.0**-23, "no gain, no loss: a step of 24 bit at most"
    with live_server.client("viewer") as client:
        items = client.get("/api/v1/diagnoses?gearbox=recorded").json()["items"]
    assert [each["recording"]["file_name"] for each in items] == ["out.wav"]
    assert items[0]["recording"]["recorded_at"] is not None
    assert f"/diagnoses/{items[0]['id']}" in done.stdout


def test_a_poor_recording_is_not_sent_unless_asked(
    heard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps of 24 bit, of which ten at least are needed; nobody listens at that address, and nobody is asked."""
    monkeypatch.setenv("GEARCASE_KEY", "gearcase_x")
    play(heard, np.random.default_rng(1).normal(size=40 * RATE_HZ) * 2.0**-23)
    assert ": microphone" in gearcase("record", "--list", data_dir=tmp_path).stdout
    done = recorded(tmp_path, 4, "--send", "--url", "http://127.0.0.1:9")
    assert done.code == 2
    assert "too quiet" in done.stderr
    assert "It was not sent" in done.stderr


def test_a_microphone_that_is_not_there_is_a_sentence(heard: Path, tmp_path: Path) -> None:
    assert heard.exists()
    done = gearcase("record", "--device", "another", "--out", tmp_path / "out.wav", data_dir=tmp_path)
    assert done.code == 1
    assert "--list` names them" in done.stderr
    assert not (tmp_path / "out.wav").exists()


def test_the_level_says_where_to_hold_the_microphone() -> None:
    loud = np.ones(800, dtype=np.float32)
    assert Level.of(loud).rms_dbfs == pytest.approx(0)
    for scale, words in ((1.0, "farther"), (0.3, "good"), (10 ** (QUIET_DBFS / 20) / 2, "nearer")):
        assert words in Level.of(np.float32(scale) * loud).advice


def test_a_recording_ends_when_there_is_enough_or_somebody_says_so(tmp_path: Path) -> None:
    stop, told = Event(), []
    blocks = [np.full(80, 0.25, dtype=np.float32)] * 10

    def tell(done_s: float, _level: Level) -> None:
        told.append(done_s)
        if len(told) == 4:
            stop.set()

    assert record(iter(blocks), tmp_path / "a.wav", 800, 0.25, stop, tell) == pytest.approx(0.25)
    assert record(iter(blocks), tmp_path / "b.wav", 800, 1.0, stop, tell) == pytest.approx(0.1)
    assert soundfile.info(tmp_path / "b.wav").frames == 80
