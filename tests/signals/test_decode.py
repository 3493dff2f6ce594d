"""Decoding: every lossless format comes back whole; a file without sound is a clear error and harms nothing."""

import os
import struct
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random

import numpy as np
import pytest
import soundfile

from benchmarks.bombs.inputs import spoilt
from benchmarks.encoded_sounds import RATE, chunk, fmt, noise, pcm, riff, seeds
from signals.errors import (
    BrokenAudioError,
    ChannelError,
    NotAudioError,
    RecordingTooLargeError,
    SignalError,
)
from signals.reading.decode import DecodeLimits, read_recording
from signals.reading.limited_pool import SOUNDS

LOSSLESS_SUBTYPES = [
    (name, subtype)
    for name in soundfile.available_formats()
    for subtype in ("PCM_16", "PCM_24", "FLOAT", "ALAC_16")
    if name not in {"RAW", "OGG", "MP3", "HTK", "SDS", "SD2"} and soundfile.check_format(name, subtype)
]


def wave(data: bytes, *, claimed: int | None = None, **form: int) -> bytes:
    """A WAV file by hand, so that its header can lie."""
    return riff(fmt(**form), chunk(b"data", data, claimed=claimed, pad=False))


@pytest.mark.parametrize(("name", "subtype"), LOSSLESS_SUBTYPES)
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


SOUND = pcm(noise()[:, 0])
INFINITE = np.r_[noise()[:, 0], np.inf]
BROKEN: dict[str, tuple[bytes, type[SignalError], str]] = {
    "60 bytes that claim 4 GiB": (wave(SOUND[:16], claimed=0xFFFFFFF0), BrokenAudioError, "8 samples"),
    "cut in the header": (wave(SOUND)[:30], BrokenAudioError, "no 'fmt ' chunk"),
    "no data chunk": (wave(b"")[:36], BrokenAudioError, "data"),
    "no sample": (wave(b""), BrokenAudioError, "0 samples"),
    "3 ms": (wave(SOUND[:48]), BrokenAudioError, "3.0 ms"),
    "silence": (wave(bytes(2 * RATE)), BrokenAudioError, "silent"),
    "pure direct current": (wave(b"\x00\x10" * RATE), BrokenAudioError, "silent"),
    "NaN": (wave(np.full(RATE, np.nan, "<f4").tobytes(), bits=32, code=3), BrokenAudioError, "not finite"),
    "one infinity": (wave(INFINITE.astype("<f4").tobytes(), bits=32, code=3), BrokenAudioError, "1 of 8001"),
    "beyond float32": (wave(np.full(RATE, 1e300, "<f8").tobytes(), bits=64, code=3), BrokenAudioError, "not finite"),
    "0 Hz": (wave(SOUND, rate=0), BrokenAudioError, "."),
    "4 GHz": (wave(SOUND, rate=4_000_000_000), BrokenAudioError, "."),
    "0 channels": (wave(SOUND, channels=0, align=2), BrokenAudioError, "."),
    "65535 channels": (wave(SOUND, channels=65535, align=2), SignalError, "."),
    "40 channels": (wave(SOUND, channels=40), RecordingTooLargeError, "at most 16"),
    "a code that nobody knows": (wave(SOUND, code=0x7777), NotAudioError, "not read here"),
    "empty": (b"", NotAudioError, "empty"),
    "one byte": (b"R", NotAudioError, "no sound file"),
    "HTML": (b"<!doctype html><title>no</title>" * 9, NotAudioError, "no sound file"),
    "ZIP": (b"PK\x03\x04" + bytes(200), NotAudioError, "unpack"),
    "a tag of MP3 and no sound": (b"ID3\x04" + bytes(500), NotAudioError, "WAV or FLAC"),
    "MP4 without its index": (b"\0\0\0\x20ftypM4A " + bytes(500), BrokenAudioError, "begins as MP4 or MOV"),
    "FLAC without frames": (b"fLaC" + bytes(60), BrokenAudioError, "begins as FLAC"),
    "a list of other files": (b"#EXTM3U\n#EXTINF:1,\n/etc/hostname\n", NotAudioError, "no sound file"),
    "a list to be joined": (b"ffconcat version 1.0\nfile /etc/hostname\n", NotAudioError, "no sound file"),
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
def test_truncated_files_are_read_as_far_as_they_go(tmp_path: Path, name: str) -> None:
    path = tmp_path / "cut"
    samples = noise(5 * RATE)
    soundfile.write(path, samples, RATE, format=name, subtype="PCM_16")
    whole = path.read_bytes()
    assert read_recording(path).source.missing_s == 0
    for share in (0.3, 0.6, 0.95):
        path.write_bytes(whole[: int(share * len(whole))])
        recording = read_recording(path)
        np.testing.assert_array_equal(recording.samples, samples[: recording.samples.size, 0])
        assert recording.duration_s == pytest.approx(5 * share, abs=0.6)
        assert recording.duration_s + (recording.source.missing_s or 0) == pytest.approx(5, abs=2 / RATE)


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
    recording = read_recording(path)
    assert recording.samples.size == RATE
    assert recording.source.missing_s == pytest.approx(2)


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
    with SOUNDS.worker() as worker:
        worker.process.kill()
        worker.process.wait()
    assert read_recording(path).samples.size == RATE


def test_many_threads_decode_at_once(tmp_path: Path) -> None:
    paths = []
    for seed in range(8):
        paths.append(tmp_path / f"{seed}.wav")
        soundfile.write(paths[-1], noise(seed=seed), RATE, subtype="PCM_16")
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(read_recording, paths))
    for seed, recording in enumerate(found):
        np.testing.assert_array_equal(recording.samples, noise(seed=seed)[:, 0])


def test_a_worker_is_limited_cannot_write_and_has_no_secrets(tmp_path: Path) -> None:
    path = tmp_path / "limits.wav"
    path.write_bytes(wave(SOUND))
    read_recording(path, limits=DecodeLimits(memory_bytes=700_000_768))
    with SOUNDS.worker() as worker:
        status = Path(f"/proc/{worker.process.pid}")
        if not status.exists():
            pytest.skip("no /proc here to look into the worker")
        limits = (status / "limits").read_text()
        environment = (status / "environ").read_bytes().decode()
    assert "Max address space         700000768" in limits
    assert "Max file size             0" in limits
    assert "Max core file size        0" in limits
    names = {entry.split("=")[0] for entry in environment.split("\0") if entry}
    numbers = {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "MALLOC_MMAP_THRESHOLD_"}
    assert names <= {*numbers, "LD_LIBRARY_PATH", "LC_CTYPE"}


def test_no_such_file_and_no_regular_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_recording(tmp_path / "nowhere.wav")
    os.mkfifo(tmp_path / "pipe.wav")
    for path in (tmp_path, tmp_path / "pipe.wav", Path("/dev/null")):
        with pytest.raises(NotAudioError, match="is no regular file"):
            read_recording(path)


def test_spoilt_files_are_read_or_refused_but_never_break_the_decoder(tmp_path: Path) -> None:
    dice, good, path, outcomes = Random(3), list(seeds(tmp_path).values()), tmp_path / "spoilt", Counter[str]()
    for _ in range(500):
        path.write_bytes(spoilt(dice.choice(good), good, dice))
        try:
            assert np.isfinite(read_recording(path).samples).all()
            outcomes["read"] += 1
        except SignalError as error:
            outcomes["gave up" if "gave up" in str(error) else type(error).__name__] += 1
    assert min(outcomes["read"], outcomes["BrokenAudioError"]) > 100
    assert not {"gave up", "DecoderUnavailableError"} & outcomes.keys()
