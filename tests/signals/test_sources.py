"""What recorders and phones really write: sloppy headers, every container, loss; what is known of it is said."""

import io
import struct
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
import soundfile

from benchmarks.encoded_sounds import BY_AV, LOSSLESS, LOSSY, RATE, chunk, encode, fmt, noise, pcm, riff
from signals.errors import BrokenAudioError, NotAudioError
from signals.features import FlagLevel, extract
from signals.reading.decode import DecodeLimits, read_recording
from signals.recording import Recording
from tests.shared_data import shared
from tests.signals.synthetic import RATE_HZ, Joint, sound

SAMPLES = noise(5 * RATE)[:, 0]
DATA = pcm(SAMPLES)
LIST = b"INFO" + chunk(b"ICMT", b"robot", pad=False)
DS64 = chunk(b"ds64", struct.pack("<QQQI", 0, len(DATA), len(SAMPLES), 0))


def written(tmp_path: Path, content: bytes) -> Recording:
    path = tmp_path / "recording.wav"
    path.write_bytes(content)
    return read_recording(path)


def severities(recording: Recording) -> dict[str, FlagLevel]:
    return {flag.name: flag.severity for flag in extract(recording).quality}


def reason(recording: Recording, name: str) -> str:
    return next(flag.reason for flag in extract(recording).quality if flag.name == name)


WHOLE = {
    "as it should be": riff(fmt(), chunk(b"data", DATA)),
    "odd chunk with its pad": riff(fmt(), chunk(b"LIST", LIST), chunk(b"data", DATA)),
    "odd chunk without its pad": riff(fmt(), chunk(b"LIST", LIST, pad=False), chunk(b"data", DATA)),
    "a chunk that claims everything": riff(chunk(b"LIST", LIST, claimed=0x7FFFFFFF), fmt(), chunk(b"data", DATA)),
    "a chunk that claims too little": riff(fmt(), chunk(b"JUNK", bytes(99), claimed=3), chunk(b"data", DATA)),
    "data before the format": riff(chunk(b"data", DATA), fmt()),
    "chunks behind the data": riff(fmt(), chunk(b"data", DATA), chunk(b"LIST", LIST)),
    "RF64": riff(DS64, fmt(), chunk(b"data", DATA, claimed=0xFFFFFFFF), form=b"RF64"),
    "BW64": riff(DS64, fmt(), chunk(b"data", DATA, claimed=0xFFFFFFFF), form=b"BW64"),
}


@pytest.mark.parametrize("name", WHOLE)
def test_sloppy_wav_files_are_read_whole(tmp_path: Path, name: str) -> None:
    recording = written(tmp_path, WHOLE[name])
    np.testing.assert_array_equal(recording.samples, SAMPLES)
    assert recording.source.missing_s == 0
    assert severities(recording).keys().isdisjoint({"truncated", "lossy", "dead_channel", "wrong_tag"})


@pytest.mark.parametrize("claimed", [0, 0x7FFF0000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFD8, 0xFFFFFFFF])
def test_an_unfinished_header_is_read_to_the_end_and_said(tmp_path: Path, claimed: int) -> None:
    recording = written(tmp_path, riff(fmt(), chunk(b"data", DATA, claimed=claimed)))
    np.testing.assert_array_equal(recording.samples, SAMPLES)
    assert recording.source.missing_s is None
    assert severities(recording)["truncated"] is FlagLevel.NOTE


def test_an_empty_recording_before_other_chunks_is_not_read_to_the_end(tmp_path: Path) -> None:
    with pytest.raises(BrokenAudioError, match="0 samples"):
        written(tmp_path, riff(fmt(), chunk(b"data", b""), chunk(b"LIST", LIST * 1000)))


@pytest.mark.parametrize(("more", "severity"), [(2, FlagLevel.NOTE), (8000, FlagLevel.NOTE), (80_000, FlagLevel.POOR)])
def test_what_is_missing_is_said_in_seconds(tmp_path: Path, more: int, severity: FlagLevel) -> None:
    recording = written(tmp_path, riff(fmt(), chunk(b"data", DATA, claimed=len(DATA) + more)))
    np.testing.assert_array_equal(recording.samples, SAMPLES)
    assert recording.source.missing_s == pytest.approx(more / 2 / RATE)
    assert severities(recording)["truncated"] is severity
    assert f"{more / 2 / RATE:.3g} s are missing" in reason(recording, "truncated")


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", ["i2", "i3", "i4", "f4", "f8", "u1"])
def test_every_width_and_order_of_bytes(tmp_path: Path, order: str, kind: str) -> None:
    if kind == "u1":
        content = np.round(SAMPLES * 128 + 128).astype(np.uint8).tobytes()
    elif kind == "i3":
        wide = (SAMPLES * 2**31).astype(f"{order}i4").tobytes()
        parts = np.frombuffer(wide, np.uint8).reshape(-1, 4)
        content = (parts[:, 1:] if order == "<" else parts[:, :3]).tobytes()
    else:
        scale = 1 if kind[0] == "f" else 2 ** (8 * int(kind[1]) - 1)
        content = (SAMPLES.astype(np.float64) * scale).astype(order + kind).tobytes()
    width = int(kind[1])
    whole = riff(fmt(bits=8 * width, code=3 if kind[0] == "f" else 1), chunk(b"data", content))
    if order == ">":
        form = struct.pack(">IHHIIHH", 16, 3 if kind[0] == "f" else 1, 1, RATE, RATE * width, width, 8 * width)
        whole = b"RIFX" + whole[4:8][::-1] + b"WAVEfmt " + form + b"data" + struct.pack(">I", len(content)) + content
    recording = written(tmp_path, whole)
    np.testing.assert_allclose(recording.samples, SAMPLES, atol=1 / 256 if kind == "u1" else 2**-15)
    if kind != "u1":
        np.testing.assert_array_equal(recording.samples, SAMPLES)


@pytest.mark.parametrize("name", LOSSLESS)
def test_lossless_sound_in_any_container_comes_back_whole(tmp_path: Path, name: str) -> None:
    container, codec, _ = BY_AV[name]
    recording = read_recording(encode(tmp_path / "file", SAMPLES, RATE, container, codec))
    np.testing.assert_array_equal(recording.samples, SAMPLES)
    assert recording.sample_rate_hz == RATE
    assert recording.source.lossy is None
    assert recording.source.missing_s == 0
    assert "lossy" not in severities(recording)


@pytest.mark.parametrize("name", LOSSY)
def test_lossy_sound_is_read_and_flagged_unless_switched_off(tmp_path: Path, name: str) -> None:
    container, codec, bit_rate = BY_AV[name]
    samples = sound(Joint(duration_s=8.0))
    path = encode(tmp_path / "file", samples, int(RATE_HZ), container, codec, bit_rate)
    recording = read_recording(path)
    assert recording.duration_s == pytest.approx(8.0, abs=0.3)
    assert severities(recording)["lossy"] is (FlagLevel.POOR if name.startswith("amr") else FlagLevel.NOTE)
    assert f"({recording.source.lossy})" in reason(recording, "lossy")
    envelopes = [
        np.sqrt(np.convolve(each.resampled(RATE_HZ).samples ** 2, np.ones(800), "same"))[1000:60_000]
        for each in (recording, Recording(samples, RATE_HZ))
    ]
    assert np.corrcoef(envelopes)[0, 1] > 0.7
    with pytest.raises(NotAudioError, match="GEARCASE_ACCEPT_LOSSY=false"):
        read_recording(path, limits=DecodeLimits(lossy=False))


def test_flac_of_unknown_length_and_with_tags_before_and_behind(tmp_path: Path) -> None:
    memory = io.BytesIO()
    soundfile.write(memory, SAMPLES, RATE, format="FLAC")
    whole = memory.getvalue()
    place = 8 + 13
    unknown = whole[:place] + bytes([whole[place] & 0xF0]) + bytes(4) + whole[place + 5 :]
    id3v2 = b"ID3\x04\0\0\0\0\0\x7f" + bytes(127)
    id3v1 = b"TAG" + b"robot".ljust(125, b"\0")
    for content in (unknown, id3v2 + whole, whole + id3v1, id3v2 + unknown + id3v1):
        recording = written(tmp_path, content)
        np.testing.assert_array_equal(recording.samples, SAMPLES)
        assert recording.source.missing_s == 0


def test_a_damaged_flac_is_read_up_to_the_damage(tmp_path: Path) -> None:
    memory = io.BytesIO()
    soundfile.write(memory, SAMPLES, RATE, format="FLAC")
    content = bytearray(memory.getvalue())
    content[len(content) // 2] ^= 0xFF
    recording = written(tmp_path, bytes(content))
    assert RATE < recording.samples.size < 4 * RATE
    np.testing.assert_array_equal(recording.samples, SAMPLES[: recording.samples.size])
    assert recording.duration_s + (recording.source.missing_s or 0) == pytest.approx(5)


def test_a_video_is_heard_and_a_video_without_sound_is_refused(tmp_path: Path) -> None:
    for silent in (False, True):
        path = video(tmp_path / "video.mp4", silent=silent)
        if silent:
            with pytest.raises(NotAudioError, match="no sound"):
                read_recording(path)
        else:
            np.testing.assert_array_equal(read_recording(path).samples, SAMPLES)


def video(path: Path, *, silent: bool) -> Path:
    """A video of one grey picture, with or without sound."""
    import av

    with av.open(str(path), "w", format="mp4") as target:
        pictures = target.add_stream("mpeg4", rate=5)
        pictures.width, pictures.height, pictures.pix_fmt = 64, 64, "yuv420p"
        voice = None if silent else target.add_stream("alac", rate=RATE, layout="mono")
        for _ in range(5):
            target.mux(pictures.encode(av.VideoFrame.from_ndarray(np.full((96, 64), 99, np.uint8), "yuv420p")))
        target.mux(pictures.encode(None))
        if voice is not None:
            for start in range(0, len(SAMPLES), 4096):
                piece = (SAMPLES[None, start : start + 4096] * 2**15).astype(np.int16)
                frame = av.AudioFrame.from_ndarray(piece, "s16p", "mono")
                frame.sample_rate, frame.pts = RATE, start
                target.mux(voice.encode(frame))
            target.mux(voice.encode(None))
    return path


def test_floating_point_tagged_as_integers_is_unusable_and_integers_are_not(tmp_path: Path) -> None:
    samples = sound(Joint(duration_s=12.0)).astype("<f4")
    wrong = written(tmp_path, riff(fmt(bits=32), chunk(b"data", samples.tobytes())))
    assert severities(wrong)["wrong_tag"] is FlagLevel.UNUSABLE
    assert "floating point with an integer tag" in reason(wrong, "wrong_tag")
    long = np.concatenate((np.zeros(300_000, "<f4"), np.tile(samples, 4)))[: 300_050 + 262_144]
    assert written(tmp_path, riff(fmt(bits=32), chunk(b"data", long.tobytes()))).source.float_tag
    for gain in (1e-6, 1e-3, 1.0):
        right = np.round(samples.astype(np.float64) * gain * 2**31).astype("<i4")
        recording = written(tmp_path, riff(fmt(bits=32), chunk(b"data", right.tobytes())))
        assert not recording.source.float_tag
    loud = (np.random.default_rng(0).uniform(-1, 1, 8000) * 2**31).astype("<i4")
    assert not written(tmp_path, riff(fmt(bits=32), chunk(b"data", loud.tobytes()))).source.float_tag
    positive = (np.random.default_rng(0).uniform(0, 0.4, 8000) * 2**31).astype("<i4")
    assert not written(tmp_path, riff(fmt(bits=32), chunk(b"data", positive.tobytes()))).source.float_tag
    square = np.where(np.arange(8000) % 20 < 10, 2**30, -(2**30)).astype("<i4")
    assert not written(tmp_path, riff(fmt(bits=32), chunk(b"data", square.tobytes()))).source.float_tag


LIVE = sound(Joint(duration_s=12.0)).astype(np.float32)
HUM = 0.1 * np.sin(2 * np.pi * 50 * np.arange(LIVE.size) / RATE_HZ) + 0.02 * np.sin(
    2 * np.pi * 150 * np.arange(LIVE.size) / RATE_HZ
)
FLOOR = np.random.default_rng(1).normal(0, 1e-4, LIVE.size)
DEAD = {"silence": np.zeros(LIVE.size), "a constant": np.full(LIVE.size, 0.01), "noise": FLOOR, "hum": HUM + FLOOR}


def stereo(tmp_path: Path, left: np.ndarray, right: np.ndarray) -> Path:
    path = tmp_path / "stereo.wav"
    soundfile.write(path, np.stack((left, right), axis=1), int(RATE_HZ), subtype="PCM_24")
    return path


@pytest.mark.parametrize("name", DEAD)
def test_a_dead_first_channel_is_passed_over(tmp_path: Path, name: str) -> None:
    path = stereo(tmp_path, DEAD[name], LIVE)
    recording = read_recording(path)
    assert (recording.channel, recording.source.dead) == (1, (0,))
    np.testing.assert_allclose(recording.samples, LIVE, atol=2**-22)
    assert severities(recording)["dead_channel"] is FlagLevel.NOTE
    assert reason(recording, "dead_channel").startswith("channel 0 carries no machine, channel 1 ")
    if name in ("noise", "hum"):
        asked = read_recording(path, channel=0)
        assert severities(asked)["dead_channel"] is FlagLevel.UNUSABLE
        assert reason(asked, "dead_channel").endswith("use channel 1")
    else:
        with pytest.raises(BrokenAudioError, match="channel 1 carries sound, use that"):
            read_recording(path, channel=0)


@pytest.mark.parametrize("gain", [1.0, 0.1, 0.02])
def test_a_quieter_channel_that_hears_the_same_is_kept(tmp_path: Path, gain: float) -> None:
    for left in (gain * LIVE + FLOOR, gain * np.roll(LIVE, 40) + 0.3 * gain * LIVE.std() * FLOOR / 1e-4):
        recording = read_recording(stereo(tmp_path, left, LIVE))
        assert (recording.channel, recording.source.dead) == (0, ())


BEXT = bytes(256) + b"Zoom H5".ljust(64, b"\0") + b"2026-03-29" + b"02:30:00" + bytes(264)
AUDIOMOTH = b"Recorded at 19:17:30 10/12/2025 (UTC-3) by AudioMoth 24E144085F0A3E3C at medium gain."
GUANO = b"GUANO|Version: 1.0\nMake: Wildlife\nModel: SM4\nTimestamp: 2026-01-02T03:04:05+01:00\n"
TAGGED = {
    "BWF": (chunk(b"bext", BEXT), datetime(2026, 3, 29, 2, 30), "Zoom H5"),
    "AudioMoth": (
        chunk(b"LIST", b"INFO" + chunk(b"ICMT", AUDIOMOTH)),
        datetime(2025, 12, 10, 19, 17, 30, tzinfo=timezone(timedelta(hours=-3))),
        "AudioMoth 24E144085F0A3E3C",
    ),
    "GUANO before BWF": (
        chunk(b"bext", BEXT) + chunk(b"guan", GUANO),
        datetime(2026, 1, 2, 2, 4, 5, tzinfo=UTC),
        "Wildlife SM4",
    ),
    "a clock never set": (
        chunk(
            b"LIST", b"INFO" + chunk(b"ICMT", b"Recorded at 00:00:09 01/01/1970 (UTC) by AudioMoth 24E144085F0A3E3C")
        ),
        None,
        "AudioMoth 24E144085F0A3E3C",
    ),
    "nonsense": (
        chunk(b"bext", b"\xff" * 602) + chunk(b"guan", b"Timestamp: \0\xff") + chunk(b"iXML", b"<"),
        None,
        "�" * 32,
    ),
}


@pytest.mark.parametrize("behind", [False, True])
@pytest.mark.parametrize("name", TAGGED)
def test_date_and_device_of_recorders(tmp_path: Path, name: str, behind: bool) -> None:
    tags, when, device = TAGGED[name]
    data = chunk(b"data", DATA)
    source = written(tmp_path, riff(fmt(), data, tags) if behind else riff(fmt(), tags, data)).source
    assert source.recorded_at == when
    assert source.device == device
    assert (source.recorded_at is None or source.recorded_at.tzinfo is None) == (when is None or when.tzinfo is None)


def test_date_and_device_of_phones(tmp_path: Path) -> None:
    path = encode(
        tmp_path / "memo.mov", SAMPLES, RATE, "mov", "alac", creation_time="2026-05-01T10:00:00Z", make="Apple"
    )
    source = read_recording(path).source
    assert (source.recorded_at, source.device) == (datetime(2026, 5, 1, 10, tzinfo=UTC), "Apple")
    path = encode(tmp_path / "memo.mka", SAMPLES, RATE, "matroska", "flac", DATE="2026")
    assert read_recording(path).source.recorded_at is None


FIELD = ("data", "field")
TWIN = (*FIELD, "09-odd-chunk-without-pad", "09_odd_list_padded.wav")


@pytest.mark.parametrize(
    ("name", "count", "missing_s"),
    [
        ("08-unfinished-wav/01_stream_ffffffff.wav", 160_000, None),
        ("08-unfinished-wav/02_data_size_0.wav", 160_000, None),
        ("08-unfinished-wav/03_data_int32max.wav", 160_000, None),
        ("08-unfinished-wav/04_truncated_60pct.wav", 96_000, 8.0),
        ("08-unfinished-wav/04b_truncated_last_512.wav", 159_744, 0.032),
        ("08-unfinished-wav/15b_data_size_plus_2.wav", 160_000, 1 / 8000),
        ("09-odd-chunk-without-pad/08_odd_list_unpadded.wav", 160_000, 0.0),
        ("17-wrong-tags/13_bw64_ds64.wav", 160_000, 0.0),
    ],
)
def test_wav_files_from_the_field_are_their_sound_twin(name: str, count: int, missing_s: float | None) -> None:
    twin, recording = read_recording(shared(*TWIN)), read_recording(shared(*FIELD, *name.split("/")))
    np.testing.assert_array_equal(recording.samples, twin.samples[:count])
    assert recording.source.missing_s == (None if missing_s is None else pytest.approx(missing_s))
    assert ("truncated" in severities(recording)) == (missing_s != 0)


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("10-valid-flac-called-damaged/mm-test-unknown-duration.flac", 220_500),
        ("11-lossless-called-lossy/42_alac.m4a", 960_000),
        ("11-lossless-called-lossy/45_flac.ogg", 960_000),
        ("08-unfinished-wav/mm-ffmpeg-missing-chunksize.wav", 27_648),
    ],
)
def test_lossless_files_from_the_field_are_read_whole(name: str, count: int) -> None:
    recording = read_recording(shared(*FIELD, *name.split("/")))
    assert recording.samples.size == count
    assert recording.source.lossy is None


def test_accelerometers_beside_each_other_keep_the_first_channel() -> None:
    for path in sorted(shared("data", "spectraquest").glob("*.wav")):
        recording = read_recording(path)
        assert (recording.channel, recording.source.dead) == (0, ())
