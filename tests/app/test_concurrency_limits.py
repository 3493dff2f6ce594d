"""Looking costs those who look: listeners hold no thread, pictures are made a few at a time and once."""

import json
from contextlib import ExitStack

import httpx
import numpy as np
import pytest

from app.recordings import views
from benchmarks.bombs.bodies import AXIS
from benchmarks.harness.live import LiveServer
from benchmarks.harness.sounds import sound
from benchmarks.harness.wire import connected, head, process_folder
from signals.recording import Recording

API = "/api/v1"
LISTENERS = 120
RATE_HZ = 8000.0


def threads(server: LiveServer) -> int:
    return len(list((process_folder(server) / "task").iterdir()))


def test_listeners_hold_no_thread_and_hear_the_end(live_server: LiveServer, admin: httpx.Client) -> None:
    job = admin.post(f"{API}/simulations", json={"axis": AXIS, "per_label": 1}).raise_for_status()
    path = job.headers["location"]
    before = threads(live_server)
    with ExitStack() as open_ones:
        listeners = [open_ones.enter_context(connected(live_server)) for _ in range(LISTENERS)]
        for listener in listeners:
            listener.sendall(head(live_server, "GET", f"{path}/events", "admin"))
        begun = [listener.recv(4096) for listener in listeners]
        assert all(each.startswith(b"HTTP/1.1 200") for each in begun)
        assert threads(live_server) - before < 10 + 40  # those of one-off work, which are kept; none for each listener
        assert admin.get("/readyz").status_code == 200
        assert admin.get(f"{API}/cases").status_code == 200
        assert admin.delete(path).json()["state"] == "cancelled"
        for listener, content in zip(listeners, begun, strict=True):
            while b"event: end" not in content:
                more = listener.recv(4096)
                assert more, content
                content += more


def test_pictures_are_made_once(live_server: LiveServer, admin: httpx.Client) -> None:
    files = {"file": ("seen.wav", sound(77, seconds=2.0), "audio/wav")}
    made = admin.post(f"{API}/diagnoses", files=files).raise_for_status().json()
    base = f"{API}/recordings/{made['recording']['id']}"
    for path in ("waveform?points=50", "spectrum", "crest", "spectrogram?columns=40", "spectrogram?theme=dark"):
        first, again = (admin.get(f"{base}/{path}").raise_for_status() for _ in range(2))
        assert first.content == again.content
        assert first.headers["cache-control"] == "private, max-age=300"
    numbers = admin.get(f"{base}/spectrogram?columns=40", headers={"Accept": "application/json"}).json()
    assert len(numbers["time_s"]) <= 40
    admin.delete(base).raise_for_status()
    assert admin.get(f"{base}/spectrum").status_code == 410


@pytest.mark.parametrize("resolution_hz", [0.1, 1.0, 8.0, 1000.0])
def test_a_sine_has_half_its_amplitude_squared_on_its_line(resolution_hz: float) -> None:
    time_s = np.arange(80_000) / RATE_HZ
    recording = Recording(np.sin(2 * np.pi * 1000 * time_s).astype(np.float32), RATE_HZ, 0, 1)
    found = views.spectrum(recording, resolution_hz)
    assert max(found.level_db) == pytest.approx(10 * np.log10(0.5), abs=0.02)
    assert found.frequency_hz[int(np.argmax(found.level_db))] == pytest.approx(1000)
    assert len(found.frequency_hz) > views.SHORTEST_WINDOW // 2


def test_pieces_of_the_work_show_in_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = np.random.default_rng(1).standard_normal(30_011).astype(np.float32)
    recording = Recording(samples, RATE_HZ, 0, 1)
    whole = (views.spectrum(recording, 20.0), views.spectrogram(recording, 37))
    monkeypatch.setattr(views, "AT_ONCE", 1500)
    pieces = (views.spectrum(recording, 20.0), views.spectrogram(recording, 37))
    np.testing.assert_allclose(pieces[0].level_db, whole[0].level_db, atol=0.011)
    np.testing.assert_allclose(pieces[1].level_db, whole[1].level_db, atol=0.011)
    assert json.loads(pieces[1].model_dump_json())["time_s"] == whole[1].time_s


def test_what_is_kept_stays_within_its_bytes() -> None:
    kept: views.Kept[bytes] = views.Kept(100, len)
    for number in range(20):
        assert kept.get(number, lambda: bytes(30)) == bytes(30)
    assert kept.get(19, lambda: b"made again") == bytes(30)
    assert kept.get(0, lambda: b"made again") == b"made again"
    assert kept.get("too large", lambda: bytes(101)) == bytes(101)
    kept.clear()
    assert kept.get(19, lambda: b"made again") == b"made again"
