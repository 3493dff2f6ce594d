"""Audio files, read in the limited process.

WAV is read here, what FFmpeg knows by PyAV, the rest by libsndfile.
"""

import contextlib
import os
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, BinaryIO

import numpy as np
import soundfile
from numpy.typing import NDArray

from signals.reading import live_channel, recorder_tags, wav
from signals.reading.limited_worker import RefusedError, Send

BLOCK_BYTES = 1 << 20
BLOCK_SAMPLES = 1 << 18
LOSSLESS_SUBTYPE = re.compile(r"PCM_\w+|FLOAT|DOUBLE|ALAC_\w+|DPCM_\w+|DWVW_\w+")
ADVICE = "record or export as WAV or FLAC"
NOT_KNOWN = "this is no sound file that is known here; send WAV or FLAC, or what a phone records"

FORMATS = {
    "flac": "FLAC",
    "aiff": "AIFF",
    "caf": "CAF",
    "au": "AU",
    "w64": "Wave64",
    "wav": "WAV",
    "ogg": "Ogg",
    "matroska,webm": "Matroska or WebM",
    "mov,mp4,m4a,3gp,3g2,mj2": "MP4 or MOV",
    "mp3": "MP3",
    "aac": "AAC",
    "amr": "AMR",
    "wv": "WavPack",
    "tta": "TTA",
    "ape": "Monkey's Audio",
    "asf": "WMA",
    "avi": "AVI",
}
"""Containers that are read by PyAV, by FFmpeg's name; none of them leads to another file."""

EXACT = {"flac", "aiff", "caf", "au", "w64"}
"""Containers whose header counts the samples."""

TIMED = {"matroska,webm", "mov,mp4,m4a,3gp,3g2,mj2"}
"""Containers whose header says how long the sound is, give or take what the encoder puts in front."""

SLACK_S = 0.25
W64_RIFF = bytes.fromhex("726966662e91cf11a5d628db04c10000")
LOSSLESS = {"flac", "alac", "wavpack", "tta", "ape", "wmalossless"}
LOSSY = {
    "mp3": "MP3",
    "mp3float": "MP3",
    "mp2": "MP2",
    "mp2float": "MP2",
    "aac": "AAC",
    "aac_latm": "AAC",
    "opus": "Opus",
    "libopus": "Opus",
    "vorbis": "Vorbis",
    "amrnb": "AMR",
    "amrwb": "AMR-WB",
    "libopencore_amrnb": "AMR",
    "libopencore_amrwb": "AMR-WB",
    "adpcm_ms": "ADPCM",
    "adpcm_ima_wav": "ADPCM",
    "adpcm_ima_qt": "ADPCM",
    "adpcm_yamaha": "ADPCM",
    "pcm_mulaw": "mu-law",
    "pcm_alaw": "A-law",
    "gsm": "GSM",
    "gsm_ms": "GSM",
    "g722": "G.722",
    "g726": "G.726",
    "ac3": "AC-3",
    "eac3": "E-AC-3",
    "wmav1": "WMA",
    "wmav2": "WMA",
    "speex": "Speex",
}
"""Codecs that leave out what an ear would miss, by FFmpeg's name."""

PLAIN = tuple(
    f"pcm_{kind}"
    for kind in (
        *("s8", "u8", "s8_planar", "s16le", "s16be", "s16le_planar", "s16be_planar", "s24le", "s24be"),
        *("s24le_planar", "s32le", "s32be", "s32le_planar", "f32le", "f32be", "f64le", "f64be", "bluray", "dvd"),
    )
)
MAGIC = {
    b"RIFF": "RIFF",
    b"RIFX": "RIFX",
    b"RF64": "RF64",
    b"BW64": "BW64",
    b"riff": "Wave64",
    b"fLaC": "FLAC",
    b"FORM": "AIFF",
    b".snd": "AU",
    b"caff": "CAF",
    b"OggS": "Ogg",
    b"\x1aE\xdf\xa3": "Matroska or WebM",
    b"#!AMR": "AMR",
    b"wvpk": "WavPack",
}


class UnknownError(Exception):
    """A decoder does not know the file; the text is its reason."""


@dataclass
class Found:
    """What a file says of its sound, and what was read of it."""

    limits: Mapping[str, float]
    rate_hz: int
    channels: int
    codec: str
    lossy: str | None = None
    claimed_s: float | None = 0.0
    slack_s: float = 0.0
    float_tag: bool = False
    recorded_at: datetime | None = None
    device: str | None = None

    def __post_init__(self) -> None:
        self.blocks: list[NDArray[np.float32]] = []
        self.frames = 0
        limits = self.limits
        if self.lossy is not None and not limits["lossy"]:
            raise RefusedError(
                "not_audio",
                f"the sound is stored with loss ({self.lossy}), which is switched off here "
                f"(GEARCASE_ACCEPT_LOSSY=false); {ADVICE}",
            )
        low, high = limits["lowest_rate_hz"], limits["highest_rate_hz"]
        if not low <= self.rate_hz <= high:
            raise RefusedError("broken", f"the sample rate is {self.rate_hz} Hz; {low:g} to {high:g} Hz are accepted")
        if self.channels > limits["channels"]:
            raise RefusedError("too_large", f"{self.channels} channels; at most {limits['channels']:g} are accepted")
        if self.channels < 1:
            raise RefusedError("broken", "its header says that it has 0 channels; export it again")

    def check_length(self, frames: int) -> None:
        """Refuse a length, claimed or counted, beyond the limits."""
        if frames > self.limits["duration_s"] * self.rate_hz:
            raise RefusedError(
                "too_large",
                f"the recording lasts {frames / self.rate_hz:.1f} s or more; at most {self.limits['duration_s']:g} s "
                "are accepted, so cut it",
            )
        if frames * self.channels > self.limits["samples"]:
            raise RefusedError(
                "too_large",
                f"{frames} samples on {self.channels} channels or more; at most {self.limits['samples']:g} in all are "
                "accepted, so send fewer channels or a shorter piece",
            )

    def take(self, block: NDArray[np.float32]) -> None:
        """Keep samples, shape (frames, channels)."""
        self.frames += len(block)
        self.check_length(self.frames)
        self.blocks.append(block)

    @property
    def missing_s(self) -> float | None:
        """How much less there is than the header says [s]; None where it says nothing that it should."""
        if self.claimed_s is None:
            return None
        missing_s = self.claimed_s - self.frames / self.rate_hz
        return missing_s if missing_s > max(self.slack_s, 0.5 / self.rate_hz) else 0.0


def decode(request: Mapping[str, Any], limits: Mapping[str, float], send: Send) -> Mapping[str, Any]:
    """Task: decode one file; send the samples of one channel (float32), return what the file says of its sound."""
    with open(str(request["path"]), "rb", buffering=0) as file:
        found = read(file, limits)
    asked = request["channel"]
    channel = 0 if asked is None else int(asked)
    if not 0 <= channel < found.channels:
        raise RefusedError("channel", f"channel {channel} asked for, but the recording has 0 to {found.channels - 1}")
    live: dict[str, object] = {}
    if found.channels > 1 and found.frames:
        whole = np.concatenate(found.blocks)
        found.blocks = [whole]
        heard = live_channel.hear(whole, found.rate_hz)
        if asked is None and channel in heard.dead:
            channel = heard.loudest
        live = {"dead": heard.dead, "loudest": heard.loudest, "below_db": heard.below_db}
    for block in found.blocks:
        for start in range(0, len(block), BLOCK_SAMPLES):
            send(np.ascontiguousarray(block[start : start + BLOCK_SAMPLES, channel]).data)
    return {
        "rate_hz": found.rate_hz,
        "channel": channel,
        "channels": found.channels,
        "codec": found.codec,
        "lossy": found.lossy,
        "missing_s": found.missing_s,
        "float_tag": found.float_tag,
        "recorded_at": found.recorded_at and found.recorded_at.isoformat(),
        "device": found.device,
        **live,
    }


def read(file: BinaryIO, limits: Mapping[str, float]) -> Found:
    """Read all channels of one file by the first decoder that knows it."""
    size = os.fstat(file.fileno()).st_size
    start = file.read(16)
    if not start:
        raise RefusedError("not_audio", "the file is empty; send a sound file, for example WAV or FLAC")
    if start[:2] == b"PK":
        raise RefusedError("not_audio", "this is a ZIP archive; unpack it and send the sound files in it")
    if start[:4] in wav.FORMS and start[8:12] == b"WAVE":
        try:
            return read_wav(file, size, limits)
        except wav.WavError as error:
            raise RefusedError("broken", f"this WAV file cannot be read: {error}; copy or export it again") from error
    reasons = []
    # FFmpeg cuts the last packet of ALAC in CAF twice where libsndfile wrote it
    in_turn = (read_with_libsndfile, read_with_av) if start[:4] == b"caff" else (read_with_av, read_with_libsndfile)
    for decoder in in_turn:
        file.seek(0)
        try:
            found = decoder(file, limits)
        except UnknownError as error:
            reasons.append(str(error))
        else:
            claim_by_bytes(found, missing_of_long_chunks(file, start, size))
            return found
    kind = next((name for magic, name in MAGIC.items() if start.startswith(magic)), None)
    kind = "MP4 or MOV" if start[4:8] == b"ftyp" else kind
    if kind is None:
        raise RefusedError("not_audio", NOT_KNOWN)
    raise RefusedError(
        "broken", f"the file begins as {kind}, but cannot be read ({reasons[0]}); copy or export it again"
    )


def missing_of_long_chunks(file: BinaryIO, start: bytes, size: int) -> int:
    """How many bytes of sound a CAF or Wave64 file has less than it claims; 0 for any other."""
    if start[:4] == b"caff":
        offset, layout, inside, step = 8, ">4sq", 0, 1
    elif start == W64_RIFF:
        offset, layout, inside, step = 40, "<4s12xq", 24, 8
    else:
        return 0
    head = struct.calcsize(layout)
    while offset + head <= size:
        file.seek(offset)
        name, stated = struct.unpack(layout, file.read(head))
        length = int(stated) - inside
        if name == b"data":
            return max(0, offset + head + length - size)
        if length < 0:
            return 0
        offset += head + -(-length // step) * step
    return 0


def claim_by_bytes(found: Found, missing: int) -> None:
    """Count so many missing bytes into what the header claims, where samples are stored as they are."""
    bits = re.fullmatch(r"pcm_[a-z]?(\d+)\w*", found.codec)
    if missing and bits:
        frames = found.frames + missing * 8 // (int(bits[1]) * found.channels)
        found.claimed_s = frames / found.rate_hz


def read_wav(file: BinaryIO, size: int, limits: Mapping[str, float]) -> Found:
    """Read a WAV file; samples that are coded go to PyAV under a right header."""
    header = wav.read_wav(file, size)
    recorded_at, device = recorder_tags.from_wav(header.tags)
    if not header.is_plain:
        try:
            found = read_with_av(wav.repaired(header, file), limits)
        except UnknownError as error:
            raise wav.WavError(f"its samples are stored in a way that is not known here ({error})") from error
        missing = header.missing_bytes
        present_s = found.frames / found.rate_hz
        found.claimed_s = None if missing is None else present_s * (1 + missing / header.length)
        found.slack_s, found.recorded_at, found.device = 0.0, recorded_at, device
        return found
    width = header.width * header.channels
    codec = "float" if header.code == wav.FLOAT else "pcm"
    found = Found(limits, header.rate_hz, header.channels, f"{codec}_{8 * header.width}")
    found.recorded_at, found.device = recorded_at, device
    found.claimed_s = None if header.claimed is None else header.claimed // width / header.rate_hz
    frames = header.length // width
    found.check_length(frames)
    file.seek(header.start)
    step = max(1, BLOCK_BYTES // width)
    while frames > found.frames:
        content = file.read(min(step, frames - found.frames) * width)
        content = content[: len(content) // width * width]
        if not content:
            break
        found.float_tag = found.float_tag or wav.looks_like_float(header, content)
        found.take(wav.samples(header, content))
    return found


def read_with_av(file: Any, limits: Mapping[str, float]) -> Found:
    """Read the first sound of a file with PyAV, in one thread, by decoders and containers of the lists above alone.

    A packet that cannot be decoded is passed over as long as nothing was decoded, and ends the sound later; so does
    a leap in time in a container that counts samples.

    Raises:
        UnknownError: if it is in no container of the list.
    """
    import av

    options = {
        "format_whitelist": ",".join(FORMATS),
        "codec_whitelist": ",".join((*PLAIN, *LOSSLESS, *LOSSY)),
        "protocol_whitelist": "none",
    }
    try:
        container = av.open(file, mode="r", options=options, metadata_errors="replace")
    except MemoryError:
        raise
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise UnknownError(reason_of(error)) from error
    with container:
        if not container.streams.audio:
            raise RefusedError("not_audio", "the file has no sound that is known here; send one with sound")
        stream = container.streams.audio[0]
        name = stream.codec_context.name if stream.codec_context else "unknown"
        if name not in LOSSY and name not in LOSSLESS and name not in PLAIN:
            raise RefusedError("not_audio", f"its sound is stored in a way that is not read here ({name}); {ADVICE}")
        stream.thread_type = "NONE"
        stream.codec_context.options = {"err_detect": "crccheck+explode"} if name in LOSSLESS else {}
        found = first = None
        for frame in frames_of(container, stream):
            if found is None:
                found, first = found_of(container, stream, frame, limits), frame.pts
            changed = (frame.sample_rate, frame.layout.nb_channels) != (found.rate_hz, found.channels)
            if changed or (container.format.name in EXACT and leaps(frame, first, found)):
                break
            found.take(samples_of(frame, found.channels))
    if found is None:
        raise UnknownError("no sound could be decoded")
    return found


def frames_of(container: Any, stream: Any) -> Iterator[Any]:
    """Give decoded frames until the file ends or cannot be decoded any further."""
    import av

    decoded = False
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
            frames = [] if packet is None else packet.decode()
        except MemoryError:
            raise
        except (av.error.FFmpegError, OSError, ValueError):
            if decoded:
                return
            continue
        if packet is None:
            return
        decoded = decoded or bool(frames)
        yield from frames


def leaps(frame: Any, first: int | None, found: Found) -> bool:
    """Whether a frame does not follow the one before: something between them could not be read."""
    if frame.pts is None or first is None:
        return False
    return abs(float((frame.pts - first) * frame.time_base) * found.rate_hz - found.frames) > 1


def found_of(container: Any, stream: Any, frame: Any, limits: Mapping[str, float]) -> Found:
    """What the container says of its sound, once the first frame is there."""
    name, form = stream.codec_context.name, container.format.name
    lossy = LOSSY.get(name)
    found = Found(limits, frame.sample_rate, frame.layout.nb_channels, name, lossy)
    claimed_s = float(stream.duration * stream.time_base) if stream.duration else None
    if claimed_s is None and container.duration and form in TIMED:
        claimed_s = container.duration / 1e6
    if form in EXACT | TIMED and claimed_s is not None and claimed_s > 0:
        found.claimed_s = claimed_s
        found.slack_s = 0.0 if form in EXACT and lossy is None else SLACK_S
    found.recorded_at, found.device = recorder_tags.from_container({**container.metadata, **stream.metadata})
    return found


def samples_of(frame: Any, channels: int) -> NDArray[np.float32]:
    """Return the samples of a frame, shape (frames, channels) [1]."""
    values: NDArray[Any] = frame.to_ndarray()
    values = values.T if frame.format.is_planar else values.reshape(-1, channels)
    if values.dtype == np.uint8:
        return (values.astype(np.float32) - np.float32(128)) / np.float32(128)
    if values.dtype.kind == "i":
        return values.astype(np.float32) / np.float32(2 ** (8 * values.dtype.itemsize - 1))
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values, dtype=np.float32)


def read_with_libsndfile(file: BinaryIO, limits: Mapping[str, float]) -> Found:
    """Read a file with libsndfile as far as it goes.

    Raises:
        UnknownError: if it does not know the file.
    """
    try:
        sound = soundfile.SoundFile(file.fileno(), closefd=False)
    except soundfile.LibsndfileError as error:
        raise UnknownError(error.error_string.strip(" .") or "decoding stopped") from error
    with sound:
        lossy = None if LOSSLESS_SUBTYPE.fullmatch(sound.subtype) else sound.subtype
        found = Found(limits, sound.samplerate, sound.channels, sound.subtype.lower(), lossy)
        if 0 < sound.frames < 1 << 60:
            found.check_length(sound.frames)
            found.claimed_s = sound.frames / sound.samplerate
        with contextlib.suppress(soundfile.LibsndfileError):
            frames = max(1, BLOCK_SAMPLES // sound.channels)
            while len(block := sound.read(frames, dtype="float32", always_2d=True)):
                found.take(block)
    return found


def reason_of(error: Exception) -> str:
    """What a decoder says of a file, without the place where it lies."""
    return str(getattr(error, "strerror", None) or "decoding stopped")
