"""Sound files of every kind that is read, made here: by soundfile, by PyAV, and by hand where headers are to lie."""

import struct
from pathlib import Path

import av
import numpy as np
import soundfile

RATE = 8000


def noise(count: int = RATE, channels: int = 1, seed: int = 0) -> np.ndarray:
    """Noise in steps of 16 bit, shape (count, channels)."""
    samples = np.random.default_rng(seed).normal(0, 0.1, (count, channels)).clip(-0.9, 0.9)
    return np.round(samples * 2**15).astype(np.float32) / 2**15


def pcm(samples: np.ndarray) -> bytes:
    """Samples as 16 bit."""
    return (samples * 2**15).astype("<i2").tobytes()


def chunk(name: bytes, content: bytes, *, claimed: int | None = None, pad: bool = True) -> bytes:
    """One chunk of a RIFF file, its size as claimed."""
    size = len(content) if claimed is None else claimed
    return name + struct.pack("<I", size) + content + (b"\0" if pad and len(content) % 2 else b"")


def fmt(*, rate: int = RATE, channels: int = 1, bits: int = 16, code: int = 1, align: int | None = None) -> bytes:
    """The `fmt ` chunk of a WAV file."""
    align = channels * bits // 8 if align is None else align
    return chunk(b"fmt ", struct.pack("<HHIIHH", code, channels, rate, rate * align & 0xFFFFFFFF, align, bits))


def riff(*chunks: bytes, form: bytes = b"RIFF") -> bytes:
    """A WAV file of chunks."""
    body = b"WAVE" + b"".join(chunks)
    return form + struct.pack("<I", len(body) & 0xFFFFFFFF) + body


def encode(
    path: Path, samples: np.ndarray, rate: int, container: str, codec: str, bit_rate: int | None = None, **tags: str
) -> Path:
    """Write samples, shape (n,), by PyAV and return the path; a rate that the codec does not have is resampled.

    Args:
        container, codec: by FFmpeg's names.
        bit_rate: of the codec [bit/s].
        tags: of the container.
    """
    rates = av.Codec(codec, "w").audio_rates
    written = rate if rates is None or rate in rates else min(each for each in rates if each >= rate)
    formats = [each.name for each in av.Codec(codec, "w").audio_formats or ()]
    wanted = next((each for each in ("s16", "s16p", "fltp", "flt", *formats) if each in formats), "s16")
    frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(samples, dtype=np.float32)[None], "fltp", "mono")
    frame.sample_rate, frame.pts = rate, 0
    with av.open(str(path), "w", format=container) as target:
        target.metadata.update(tags)
        stream = target.add_stream(codec, rate=written, layout="mono")
        if bit_rate:
            stream.bit_rate = bit_rate
        stream.codec_context.format = wanted
        stream.codec_context.open()
        size = stream.codec_context.frame_size or 1024
        resampler = av.AudioResampler(wanted, "mono", written, frame_size=size)
        for piece in (*resampler.resample(frame), *resampler.resample(None)):
            target.mux(stream.encode(piece))
        target.mux(stream.encode(None))
    return path


BY_AV = {
    "mp3": ("mp3", "libmp3lame", 64_000),
    "aac in mp4": ("mp4", "aac", 64_000),
    "aac alone": ("adts", "aac", 64_000),
    "opus": ("ogg", "libopus", 24_000),
    "opus in webm": ("webm", "libopus", 24_000),
    "amr": ("amr", "libopencore_amrnb", 12_200),
    "amr in 3gp": ("3gp", "libopencore_amrnb", 12_200),
    "wma": ("asf", "wmav2", 64_000),
    "mu-law": ("wav", "pcm_mulaw", None),
    "a-law": ("wav", "pcm_alaw", None),
    "adpcm microsoft": ("wav", "adpcm_ms", None),
    "adpcm ima": ("wav", "adpcm_ima_wav", None),
    "mp3 in wav": ("wav", "libmp3lame", 64_000),
    "alac in mp4": ("mp4", "alac", None),
    "pcm in mov": ("mov", "pcm_s16le", None),
    "pcm in mkv": ("matroska", "pcm_s16le", None),
    "flac in mkv": ("matroska", "flac", None),
    "flac in ogg": ("ogg", "flac", None),
    "pcm in avi": ("avi", "pcm_s16le", None),
    "wavpack": ("wv", "wavpack", None),
    "tta": ("tta", "tta", None),
}
"""Container, codec and bit rate of what is written by PyAV; the lossy ones first."""

LOSSY = tuple(BY_AV)[:13]
LOSSLESS = tuple(BY_AV)[13:]
BY_SOUNDFILE = {
    **{f"wav {each.lower()}": ("WAV", each) for each in ("PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE")},
    **{f"{each.lower()} pcm": (each, "PCM_16") for each in ("WAVEX", "RF64", "W64", "FLAC", "AIFF", "AU", "CAF")},
    **{f"{each.lower()} pcm": (each, "PCM_16") for each in ("NIST", "VOC", "AVR", "PAF", "IRCAM", "MAT4", "PVF")},
    "caf alac": ("CAF", "ALAC_16"),
    "aiff float": ("AIFF", "FLOAT"),
    "vorbis": ("OGG", "VORBIS"),
}


def seeds(folder: Path, count: int = RATE // 2) -> dict[str, bytes]:
    """One small file of every kind, by name."""
    found: dict[str, bytes] = {}
    samples = noise(count)[:, 0]
    path = folder / "seed"
    for name, (container, subtype) in BY_SOUNDFILE.items():
        soundfile.write(path, samples, RATE, format=container, subtype=subtype)
        found[name] = path.read_bytes()
    for name, (container, codec, bit_rate) in BY_AV.items():
        found[name] = encode(path, samples, RATE, container, codec, bit_rate).read_bytes()
    soundfile.write(path, noise(count, 3), RATE, format="WAV", subtype="PCM_16")
    found["three channels"] = path.read_bytes()
    tags = chunk(b"bext", bytes(602)) + chunk(b"guan", b"GUANO|Version:1.0\nTimestamp:2026-05-01T10:00:00Z")
    tags += chunk(
        b"LIST", b"INFO" + chunk(b"ICMT", b"Recorded at 10:00:00 01/05/2026 (UTC) by AudioMoth 0123456789ABCDEF")
    )
    found["tags"] = riff(fmt(), tags, chunk(b"data", pcm(samples)))
    long_sizes = chunk(b"ds64", struct.pack("<QQQI", 0, 2 * count, count, 0))
    found["bw64"] = riff(long_sizes, fmt(), chunk(b"data", pcm(samples), claimed=0xFFFFFFFF), form=b"BW64")
    found["flac with a tag"] = b"ID3\x04\0\0\0\0\0\x0a" + bytes(10) + found["flac pcm"]
    path.unlink()
    return found
