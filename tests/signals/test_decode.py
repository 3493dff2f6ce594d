"""Decoding: every lossless format comes back whole; every broken file is a clear error and harms nothing."""

import contextlib
import struct
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from casebase.signals.decode import DecodeLimits, read_recording
from casebase.signals.decode_pool import POOL
from casebase.signals.errors import (
    BrokenAudioError,
    ChannelError,
    NotAudioError,
    RecordingTooLargeError,
    SignalError,
)

RATE = 8000
LOSSLESS = [
    (name, subtype)
    for name in soundfile.available_formats()
    for subtype in ("PCM_16", "PCM_24", "FLOAT", "ALAC_16")
    if name not in {"RAW", "OGG", "MP3", "HTK", "SDS", "SD2"} and soundfile.check_format(name, subtype)
]


def noise(count: int = RATE, channels: int = 1, seed: int = 0) -> np.ndarray:
    samples = np.random.default_rng(seed).normal(0, 0.1, (count, channels)).clip(-0.9, 0.9)
    return np.round(samples * 2**15).astype(np.float32) / 2**15


def wave(
    data: bytes,
    *,
    rate: int = RATE,
    channels: int = 1,
    bits: int = 16,
    claimed: int | None = None,
    code: int = 1,
    align: int | None = None,
) -> bytes:
    """A WAV file by hand, so that its header can lie."""
    align = channels * bits // 8 if align is None else align
    claimed = len(data) if claimed is None else claimed
    head = struct.pack("<4sIHHIIHH", b"fmt ", 16, code, channels, rate, rate * align & 0xFFFFFFFF, align, bits)
    body = b"WAVE" + head + b"data" + struct.pack("<I", claimed) + data
    return b"RIFF" + struct.pack("<I", len(body) & 0xFFFFFFFF) + body


def pcm(samples: np.ndarray) -> bytes:
    return (samples * 2**15).astype("<i2").tobytes()


@pytest.mark.parametrize(("name", "subtype"), LOSSLESS)
def test_what_was_written_is_read(tmp_path: Path, name: str, subtype: str) -> None:
    samples = noise()
    path = tmp_path / "recording.bin"
    soundfile.write(path, samples, RATE, format=name, subtype=subtype)
    recording = read_recording(path)
    read = recording.samples[: len(samples)]
    np.testing.assert_allclose(read, samples[:, 0], atol=2**-14)
    assert not recording.samples[len(samples) :].any()


@pytest.mark.parametrize("rate", [8000, 8001, 11025, 44100, 47999, 96000, 192000])
def test_rates_are_kept(tmp_path: Path, rate: int) -> None:
    path = tmp_path / "rate.wav"
    soundfile.write(path, noise(rate // 2), rate, subtype="PCM_16")
    recording = read_recording(path)
    assert recording.sample_rate_hz == rate
    assert recording.duration_s == pytest.approx(0.5, abs=1e-4)


def test_a_channel_is_chosen_or_the_first_is_used_and_said(tmp_path: Path) -> None:
    samples = noise(channels=4)
    path = tmp_path / "four.wav"
    soundfile.write(path, samples, RATE, subtype="PCM_16")
    for channel in range(4):
        recording = read_recording(path, channel=channel)
        np.testing.assert_array_equal(recording.samples, samples[:, channel])
        assert (recording.channel, recording.channels) == (channel, 4)
    assert read_recording(path).channel == 0
    for channel in (4, -1):
        with pytest.raises(ChannelError, match="has 0 to 3"):
            read_recording(path, channel=channel)


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(order=st.permutations(range(3)))
def test_channels_may_be_permuted(tmp_path: Path, order: list[int]) -> None:
    samples = noise(2000, channels=3)
    path = tmp_path / "permuted.flac"
    soundfile.write(path, samples[:, order], RATE)
    for place, channel in enumerate(order):
        np.testing.assert_array_equal(read_recording(path, channel=place).samples, samples[:, channel])


def test_same_samples_in_another_container_have_the_same_hash(tmp_path: Path) -> None:
    samples = noise()
    for name in ("a.wav", "a.flac", "a.aiff"):
        soundfile.write(tmp_path / name, samples, RATE, subtype="PCM_16")
    hashes = {read_recording(tmp_path / name).sha256 for name in ("a.wav", "a.flac", "a.aiff")}
    assert len(hashes) == 1


SOUND = pcm(noise()[:, 0])
BROKEN: dict[str, tuple[bytes, type[SignalError], str]] = {
    "60 bytes that claim 4 GiB": (wave(SOUND[:16], claimed=0xFFFFFFF0), BrokenAudioError, "truncated"),
    "half of it": (wave(SOUND, claimed=len(SOUND))[: len(SOUND) // 2], BrokenAudioError, "truncated"),
    "cut in the header": (wave(SOUND)[:30], BrokenAudioError, "no 'data'|truncated"),
    "no data chunk": (wave(b"")[:36], BrokenAudioError, "data"),
    "no sample": (wave(b""), BrokenAudioError, "0 samples"),
    "3 ms": (wave(SOUND[:48]), BrokenAudioError, "3.0 ms"),
    "silence": (wave(bytes(2 * RATE)), BrokenAudioError, "silent"),
    "pure direct current": (wave(b"\x00\x10" * RATE), BrokenAudioError, "silent"),
    "NaN": (wave(np.full(RATE, np.nan, "<f4").tobytes(), bits=32, code=3), BrokenAudioError, "not finite"),
    "one infinity": (
        wave(np.r_[noise()[:, 0], np.inf].astype("<f4").tobytes(), bits=32, code=3),
        BrokenAudioError,
        "1 of 8001",
    ),
    "beyond float32": (
        wave(np.full(RATE, 1e300, "<f8").tobytes(), bits=64, code=3),
        BrokenAudioError,
        "not finite",
    ),
    "0 Hz": (wave(SOUND, rate=0), BrokenAudioError, "."),
    "4 GHz": (wave(SOUND, rate=4_000_000_000), BrokenAudioError, "."),
    "0 channels": (wave(SOUND, channels=0, align=2), BrokenAudioError, "."),
    "65535 channels": (wave(SOUND, channels=65535, align=2), SignalError, "."),
    "40 channels": (wave(SOUND, channels=40), RecordingTooLargeError, "at most 16"),
    "ADPCM": (wave(SOUND, code=0x11, bits=4), SignalError, "."),
    "A-law": (wave(SOUND, code=6, bits=8), NotAudioError, "lossy"),
    "a chunk that claims everything": (
        wave(SOUND).replace(b"fmt ", b"LIST" + struct.pack("<I", 0x7FFFFFFF) + b"fmt "),
        BrokenAudioError,
        "LIST",
    ),
    "empty": (b"", NotAudioError, "empty"),
    "one byte": (b"R", NotAudioError, "no sound file"),
    "HTML": (b"<!doctype html><title>no</title>" * 9, NotAudioError, "no sound file"),
    "ZIP": (b"PK\x03\x04" + bytes(200), NotAudioError, "unpack"),
    "MP3 with a tag": (b"ID3\x04" + bytes(500), NotAudioError, "WAV or FLAC"),
    "MP4": (b"\0\0\0\x20ftypM4A " + bytes(500), NotAudioError, "lossy"),
    "FLAC without frames": (b"fLaC" + bytes(60), BrokenAudioError, "damaged"),
    "random bytes": (np.random.default_rng(1).bytes(5000), NotAudioError, "no sound file"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_clear_errors(tmp_path: Path, name: str) -> None:
    content, kind, words = BROKEN[name]
    path = tmp_path / "upload.wav"
    path.write_bytes(content)
    with pytest.raises(kind, match=words) as caught:
        read_recording(path)
    assert len(str(caught.value)) > 20
    assert str(tmp_path) not in str(caught.value)


@pytest.mark.parametrize("name", ["FLAC", "AIFF", "AU", "CAF", "W64", "RF64", "WAV", "WAVEX"])
def test_truncated_files_of_any_format_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "cut"
    soundfile.write(path, noise(), RATE, format=name, subtype="PCM_16")
    whole = path.read_bytes()
    for share in (0.3, 0.6, 0.95):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(BrokenAudioError):
            read_recording(path)


@pytest.mark.parametrize("subtype", ["VORBIS", "OPUS", "MPEG_LAYER_III"])
def test_lossy_formats_are_refused_with_advice(tmp_path: Path, subtype: str) -> None:
    path = tmp_path / "memo"
    name = "MP3" if subtype.startswith("MPEG") else "OGG"
    soundfile.write(path, noise(2 * RATE), RATE, format=name, subtype=subtype)
    with pytest.raises(NotAudioError, match="WAV or FLAC"):
        read_recording(path)


def test_a_small_file_that_unpacks_to_hours_is_stopped_by_count(tmp_path: Path) -> None:
    path = tmp_path / "bomb.flac"
    soundfile.write(path, np.zeros(700 * RATE, dtype=np.int16), RATE)
    assert path.stat().st_size < 200_000
    with pytest.raises(RecordingTooLargeError, match="at most 600 s"):
        read_recording(path)
    for claimed in (0, 1000):
        path.write_bytes(with_flac_length(path.read_bytes(), claimed))
        with pytest.raises((RecordingTooLargeError, BrokenAudioError)):
            read_recording(path)


def with_flac_length(content: bytes, samples: int) -> bytes:
    """Put another number of samples (36 bits) into the STREAMINFO block."""
    place = 8 + 13
    return content[:place] + bytes([content[place] & 0xF0]) + struct.pack(">I", samples) + content[place + 5 :]


def test_a_flac_header_that_claims_more_than_there_is(tmp_path: Path) -> None:
    path = tmp_path / "more.flac"
    soundfile.write(path, noise(), RATE)
    path.write_bytes(with_flac_length(path.read_bytes(), 3 * RATE))
    with pytest.raises(BrokenAudioError, match=r"claims|damaged"):
        read_recording(path)


def test_limits_on_samples_count_all_channels(tmp_path: Path) -> None:
    path = tmp_path / "wide.wav"
    soundfile.write(path, noise(channels=4), RATE)
    assert read_recording(path, limits=DecodeLimits(samples=4 * RATE)).samples.size == RATE
    with pytest.raises(RecordingTooLargeError, match="4 channels"):
        read_recording(path, limits=DecodeLimits(samples=4 * RATE - 1))


def test_a_decoder_out_of_time_is_killed_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "slow.wav"
    soundfile.write(path, noise(), RATE)
    with pytest.raises(BrokenAudioError, match="more time than allowed"):
        read_recording(path, limits=DecodeLimits(seconds=0.0))
    assert read_recording(path).samples.size == RATE


def test_a_decoder_that_was_killed_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "again.wav"
    soundfile.write(path, noise(), RATE)
    with POOL.worker() as worker:
        worker.process.kill()
        worker.process.wait()
    assert read_recording(path).samples.size == RATE


def test_many_threads_decode_at_once(tmp_path: Path) -> None:
    paths = []
    for seed in range(8):
        paths.append(tmp_path / f"{seed}.wav")
        soundfile.write(paths[-1], noise(seed=seed), RATE, subtype="PCM_16")
    found: dict[int, np.ndarray] = {}

    def read(seed: int) -> None:
        found[seed] = read_recording(paths[seed]).samples

    threads = [threading.Thread(target=read, args=(seed,)) for seed in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for seed in range(8):
        np.testing.assert_array_equal(found[seed], noise(seed=seed)[:, 0])


def test_a_worker_is_limited_cannot_write_and_has_no_secrets(tmp_path: Path) -> None:
    path = tmp_path / "limits.wav"
    path.write_bytes(wave(SOUND))
    read_recording(path, limits=DecodeLimits(memory_bytes=700_000_768))
    with POOL.worker() as worker:
        status = Path(f"/proc/{worker.process.pid}")
        if not status.exists():
            pytest.skip("no /proc here to look into the worker")
        limits = (status / "limits").read_text()
        environment = (status / "environ").read_bytes().decode()
    assert "Max address space         700000768" in limits
    assert "Max file size             0" in limits
    assert "Max core file size        0" in limits
    names = {entry.split("=")[0] for entry in environment.split("\0") if entry}
    assert names <= {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "LD_LIBRARY_PATH", "LC_CTYPE"}


def test_no_such_file_and_no_regular_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_recording(tmp_path / "nowhere.wav")
    with pytest.raises(NotAudioError, match="regular"):
        read_recording(tmp_path)


def mutations() -> st.SearchStrategy[Callable[[bytes], bytes]]:
    """Ways to spoil a file: overwrite some bytes, or cut it."""

    def overwritten(place: int, content: bytes) -> Callable[[bytes], bytes]:
        return lambda whole: whole[:place] + content + whole[place + len(content) :]

    def cut(place: int) -> Callable[[bytes], bytes]:
        return lambda whole: whole[:place]

    return st.one_of(
        st.builds(overwritten, st.integers(0, 60), st.binary(min_size=1, max_size=8)),
        st.builds(cut, st.integers(0, 3000)),
    )


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(spoil=mutations(), name=st.sampled_from(["WAV", "FLAC", "AIFF", "CAF"]))
def test_spoilt_files_are_read_or_refused_but_never_break_the_decoder(
    tmp_path: Path, spoil: Callable[[bytes], bytes], name: str
) -> None:
    path = tmp_path / "spoilt"
    soundfile.write(path, noise(1500), RATE, format=name, subtype="PCM_16")
    path.write_bytes(spoil(path.read_bytes()))
    with contextlib.suppress(SignalError):
        assert np.isfinite(read_recording(path).samples).all()
    path.write_bytes(wave(SOUND))
    assert read_recording(path).samples.size == RATE
