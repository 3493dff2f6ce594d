"""`gearcase record`: a real capture through PortAudio, from a sound system that plays a file into the microphone."""

import os
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path
from threading import Event

import numpy as np
import pytest
import soundfile

from app.microphone import QUIET_DBFS, Level, record
from tests.app.sounds import hum
from tests.live import LiveServer

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


@pytest.fixture
def heard(tmp_path: Path) -> np.ndarray:
    """What the microphone hears: 40 s of a hum whose motion repeats and rests, at half of full scale."""
    samples = hum(40.0, 1) * np.abs(np.sin(np.pi * np.arange(40 * RATE_HZ) / RATE_HZ)).astype(np.float32)
    samples = np.asarray(0.5 * samples / np.abs(samples).max(), dtype="<f4")
    samples.tofile(tmp_path / "heard.raw")
    return samples


@pytest.fixture
def environment(tmp_path: Path, heard: np.ndarray) -> dict[str, str]:
    if not ALSA.exists() or find_library("portaudio") is None:
        pytest.skip("no PortAudio and ALSA here (libportaudio2)")
    (tmp_path / "asound.conf").write_text(CONFIGURATION.format(system=ALSA, heard=tmp_path / "heard.raw"))
    return {**os.environ, "ALSA_CONFIG_PATH": str(tmp_path / "asound.conf")}


def run(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "app", "record", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_what_the_microphone_hears_is_written_as_it_is_and_sent(
    environment: dict[str, str], heard: np.ndarray, live_server: LiveServer, tmp_path: Path
) -> None:
    words = ("--seconds", "8", "--rate", str(RATE_HZ), "--device", "microphone", "--out", str(tmp_path / "out.wav"))
    environment["GEARCASE_KEY"] = live_server.keys["operator"]
    done = run(environment, *words, "--send", "--url", live_server.url, "--axis", "bench", "--gearbox", "recorded")
    assert done.returncode == 0, done.stderr
    assert "The check: the recording can be diagnosed" in done.stderr
    samples, rate_hz = soundfile.read(tmp_path / "out.wav")
    assert (rate_hz, samples.size) == (RATE_HZ, 8 * RATE_HZ)
    assert np.abs(samples - heard[: samples.size]).max() <= 2.0**-23, "no gain, no loss: a step of 24 bit at most"
    with live_server.client("viewer") as client:
        items = client.get("/api/v1/diagnoses?gearbox=recorded").json()["items"]
    assert [each["recording"]["file_name"] for each in items] == ["out.wav"]
    assert items[0]["recording"]["recorded_at"] is not None
    assert f"/diagnoses/{items[0]['id']}" in done.stdout


def test_a_poor_recording_is_not_sent_unless_asked(environment: dict[str, str], tmp_path: Path) -> None:
    """Steps of 24 bit, of which ten at least are needed; nobody listens at that address, and nobody is asked."""
    (np.random.default_rng(1).normal(size=40 * RATE_HZ) * 2.0**-23).astype("<f4").tofile(tmp_path / "heard.raw")
    environment["GEARCASE_KEY"] = "gearcase_x"
    words = ("--seconds", "4", "--rate", str(RATE_HZ), "--device", "microphone", "--out", str(tmp_path / "out.wav"))
    assert ": microphone" in run(environment, "--list").stdout
    done = run(environment, *words, "--send", "--url", "http://127.0.0.1:9")
    assert done.returncode == 2
    assert "too quiet" in done.stderr
    assert "It was not sent" in done.stderr


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
