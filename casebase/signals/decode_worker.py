"""The decoding worker: a program of its own that reads audio files under limits and trusts none of them.

It is started as a plain subprocess by `casebase.signals.decode`, imports nothing of the product, and speaks over
pipes: one JSON line per file in; out come blocks, each a kind byte and a length (uint32, little-endian) before
its bytes: `S` samples (float32), then one `R` result or `E` error (JSON). `H` says that it is up.
"""

import contextlib
import json
import os
import re
import resource
import struct
import sys
from io import FileIO
from typing import BinaryIO

import numpy as np
import soundfile

BLOCK_SAMPLES = 1 << 18
LOSSLESS = re.compile(r"PCM_\w+|FLOAT|DOUBLE|ALAC_\w+|DPCM_\w+|DWVW_\w+")
CONTRADICTION = re.compile(r"should be|not equal|does not match|truncated")
CONTAINERS = (b"RIFF", b"RIFX", b"RF64", b"BW64", b"riff", b"fLaC", b"FORM", b".snd", b"caff")
LOSSY_MAGIC = (b"ID3", b"OggS", b"\x1aE\xdf\xa3", b"0&\xb2u")
LOSSY_ADVICE = "lossy compression removes the faint impacts that tell a fault; record or export as WAV or FLAC instead"


class RefusedError(Exception):
    """A file that is refused; `kind` names the error class on the other side."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


def confine() -> None:
    """Give up what decoding does not need: writing files, core dumps, many open files."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (16, 16))


def allow(memory_bytes: int, cpu_seconds: float) -> None:
    """Allow this much address space, and this much processor time from now on."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    until = int(used.ru_utime + used.ru_stime + cpu_seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (until, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, resource.RLIM_INFINITY))


def refuse_foreign(start: bytes) -> None:
    """Refuse what is no sound file, or a lossy one, with advice, before any decoder sees it."""
    if not start:
        raise RefusedError("not_audio", "the file is empty; send a sound file, for example WAV or FLAC")
    if start[:2] == b"PK":
        raise RefusedError("not_audio", "this is a ZIP archive; unpack it and send the sound files in it")
    if start.startswith(LOSSY_MAGIC) or start[4:8] == b"ftyp":
        raise RefusedError("not_audio", f"this is a lossy or video format; {LOSSY_ADVICE}")


def check_chunks(file: FileIO, start: bytes, size: int) -> None:
    """Refuse a RIFF or RF64 file whose chunks do not fit into the file."""
    order = ">" if start[:4] == b"RIFX" else "<"
    long_data = None
    offset = 12
    while offset + 8 <= size:
        file.seek(offset)
        name, length = struct.unpack(order + "4sI", file.read(8))
        if name == b"ds64":
            long_data = struct.unpack("<Q", file.read(24)[8:16].ljust(8, b"\0"))[0]
        if name == b"data" and length == 0xFFFFFFFF and long_data is not None:
            length = long_data
        if offset + 8 + length > size:
            shown = name.decode("ascii", "backslashreplace").strip()
            raise RefusedError(
                "broken",
                f"the header claims {length} bytes for '{shown}', but only {size - offset - 8} follow: the file is "
                "truncated or its header is wrong; copy or export it again",
            )
        if name == b"data":
            return
        offset += 8 + length + length % 2
    raise RefusedError("broken", "the file has no 'data' chunk, so no sound; copy or export it again")


def check_format(sound: soundfile.SoundFile, limits: dict[str, float]) -> None:
    """Refuse lossy formats and rates, channels or lengths outside the limits, by what the header says."""
    if not LOSSLESS.fullmatch(sound.subtype):
        raise RefusedError("not_audio", f"{sound.format} with {sound.subtype} is lossy; {LOSSY_ADVICE}")
    low, high = limits["lowest_rate_hz"], limits["highest_rate_hz"]
    if not low <= sound.samplerate <= high:
        raise RefusedError("broken", f"the sample rate is {sound.samplerate} Hz; {low:g} to {high:g} Hz are accepted")
    if sound.channels > limits["channels"]:
        raise RefusedError("too_large", f"{sound.channels} channels; at most {limits['channels']:g} are accepted")
    if not sound.format.startswith(("WAV", "RF64")) and CONTRADICTION.search(sound.extra_info):
        raise RefusedError(
            "broken",
            "the header claims another length than the file has: it is truncated or its header is wrong; copy or "
            "export it again",
        )


def check_length(frames: int, sound: soundfile.SoundFile, limits: dict[str, float]) -> None:
    """Refuse a length, claimed or counted, beyond the limits."""
    if frames > limits["duration_s"] * sound.samplerate:
        raise RefusedError(
            "too_large",
            f"the recording lasts {frames / sound.samplerate:.1f} s or more; at most {limits['duration_s']:g} s are "
            "accepted, so cut it",
        )
    if frames * sound.channels > limits["samples"]:
        raise RefusedError(
            "too_large",
            f"{frames} samples on {sound.channels} channels or more; at most {limits['samples']:g} in all are "
            "accepted, so send fewer channels or a shorter piece",
        )


def choose_channel(channel: int | None, channels: int) -> int:
    """Return the channel to use: the one asked for, or the first."""
    if channel is None:
        return 0
    if not 0 <= channel < channels:
        raise RefusedError("channel", f"channel {channel} asked for, but the recording has 0 to {channels - 1}")
    return channel


def decode(request: dict[str, object], limits: dict[str, float], out: BinaryIO) -> None:
    """Decode one file, sending samples of one channel as they come, then the result."""
    with open(str(request["path"]), "rb", buffering=0) as file:
        size = os.fstat(file.fileno()).st_size
        start = file.read(16)
        refuse_foreign(start)
        if start[:4] in (b"RIFF", b"RIFX", b"RF64", b"BW64") and start[8:12] == b"WAVE":
            check_chunks(file, start, size)
        file.seek(0)
        try:
            decode_open(file, request, limits, out)
        except soundfile.LibsndfileError as error:
            known = start.startswith(CONTAINERS)
            reason = error.error_string.strip(" .") or "decoding stopped"
            message = (
                f"the sound file is damaged ({reason}); copy or export it again"
                if known
                else "this is no sound file that is known here; send WAV, FLAC or AIFF"
            )
            raise RefusedError("broken" if known else "not_audio", message) from error


def decode_open(file: FileIO, request: dict[str, object], limits: dict[str, float], out: BinaryIO) -> None:
    """Decode an open file with libsndfile."""
    with soundfile.SoundFile(file.fileno(), closefd=False) as sound:
        check_format(sound, limits)
        check_length(0 if sound.frames > 1 << 60 else sound.frames, sound, limits)
        asked = request["channel"]
        channel = choose_channel(asked if isinstance(asked, int) else None, sound.channels)
        frames = 0
        block = np.empty((max(1, BLOCK_SAMPLES // sound.channels), sound.channels), dtype=np.float32)
        while (read := len(sound.read(out=block))) > 0:
            frames += read
            check_length(frames, sound, limits)
            send(out, b"S", np.ascontiguousarray(block[:read, channel]).data)
        if frames != sound.frames:
            raise RefusedError(
                "broken", f"the header claims {sound.frames} samples, but {frames} were read; export it again"
            )
        result = {"rate_hz": sound.samplerate, "channel": channel, "channels": sound.channels, "frames": frames}
        send(out, b"R", json.dumps(result).encode())


def send(out: BinaryIO, kind: bytes, content: bytes | memoryview) -> None:
    """Write one block."""
    length = content.nbytes if isinstance(content, memoryview) else len(content)
    out.write(kind + struct.pack("<I", length))
    out.write(content)
    out.flush()


def main() -> None:
    """Serve requests until standard input ends."""
    confine()
    requests, out = sys.stdin.buffer, sys.stdout.buffer
    send(out, b"H", b"")
    while line := requests.readline():
        request = json.loads(line)
        limits = request["limits"]
        allow(int(limits["memory_bytes"]), limits["cpu_seconds"])
        try:
            decode(request, limits, out)
        except RefusedError as refused:
            send(out, b"E", json.dumps({"kind": refused.kind, "message": str(refused)}).encode())
        except MemoryError:
            message = f"decoding needs more than {limits['memory_bytes'] >> 20} MiB of memory"
            send(out, b"E", json.dumps({"kind": "too_large", "message": message}).encode())


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError, KeyboardInterrupt):
        main()
