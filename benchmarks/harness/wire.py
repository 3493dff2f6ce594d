"""Requests as bytes on a socket of their own, for what no well-behaved client does."""

import os
import socket
import time
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import urlsplit

from benchmarks.harness.live import LiveServer

PATIENCE_S = 30.0


def connected(server: LiveServer) -> socket.socket:
    address = urlsplit(server.url)
    assert address.hostname is not None
    return socket.create_connection((address.hostname, address.port or 80), timeout=PATIENCE_S)


def head(server: LiveServer, method: str, path: str, role: str | None, **headers: str) -> bytes:
    """The head of a request, with the key of a role or with none."""
    key = {"Authorization": f"Bearer {server.keys[role]}"} if role else {}
    named = {"Host": urlsplit(server.url).netloc, **key, **{name.replace("_", "-"): headers[name] for name in headers}}
    return "\r\n".join(
        (f"{method} {path} HTTP/1.1", *(f"{name}: {text}" for name, text in named.items()), "", "")
    ).encode()


def chunked(blocks: Iterable[bytes]) -> Iterable[bytes]:
    for block in blocks:
        yield b"%x\r\n%b\r\n" % (len(block), block)
    yield b"0\r\n\r\n"


def received(connection: socket.socket) -> bytes:
    """All that comes until the other side closes, however it does."""
    found = b""
    try:
        while block := connection.recv(65_536):
            found += block
    except ConnectionError:
        pass
    return found


def pushed(connection: socket.socket, blocks: Iterable[bytes]) -> int:
    """Send until the other side takes no more; return how many bytes went."""
    sent = 0
    try:
        for block in blocks:
            connection.sendall(block)
            sent += len(block)
    except ConnectionError:
        pass
    return sent


def status(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


def process_folder(server: LiveServer) -> Path:
    assert server.process is not None
    return Path(f"/proc/{server.process.pid}")


def forget_peak(server: LiveServer) -> None:
    (process_folder(server) / "clear_refs").write_text("5")


def peak_bytes(server: LiveServer) -> int:
    """The most memory that the service has had since the peak was forgotten."""
    return _memory(server, "VmHWM")


def memory_bytes(server: LiveServer) -> int:
    return _memory(server, "VmRSS")


def settled(server: LiveServer) -> None:
    """Wait until the service has loaded what it loads beside the first requests."""
    steady, last = 0, memory_bytes(server)
    while steady < 5:
        time.sleep(0.3)
        steady, last = (steady + 1 if abs(memory_bytes(server) - last) < 1_000_000 else 0), memory_bytes(server)


def _memory(server: LiveServer, name: str) -> int:
    lines = (process_folder(server) / "status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:"))


def descriptors(server: LiveServer) -> list[str]:
    """What the service has open."""
    links = []
    for each in (process_folder(server) / "fd").iterdir():
        try:
            links.append(os.readlink(each))
        except FileNotFoundError:
            continue
    return links
