"""Real receivers of messages, on ports of this machine: a mail server, an MQTT broker, and a webhook."""

import shutil
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from email import message_from_bytes
from email.message import Message
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socketserver import BaseRequestHandler, ThreadingTCPServer
from threading import Event, Thread
from typing import Any

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import SMTP, Envelope, Session
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

BROKERS = ("mosquitto", "/usr/sbin/mosquitto")
WAIT_S = 60.0


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(met: Any, what: str) -> None:
    """Wait until something is so."""
    deadline = time.monotonic() + WAIT_S
    while not met():
        assert time.monotonic() < deadline, f"{what} did not happen"
        time.sleep(0.05)


@dataclass
class Mailbox:
    """A mail server: what it took, and whether it is to keep the first one waiting."""

    port: int = 0
    began: Event = field(default_factory=Event)
    go_on: Event = field(default_factory=Event)
    taken: list[Message] = field(default_factory=list)
    answer: str = "250 taken"

    async def handle_DATA(self, _server: SMTP, _session: Session, envelope: Envelope) -> str:
        self.began.set()
        if not self.go_on.is_set():
            return "451 later"
        assert isinstance(envelope.content, bytes)
        if self.answer.startswith("250"):
            self.taken.append(message_from_bytes(envelope.content))
        return self.answer


@contextmanager
def mail_server() -> Iterator[Mailbox]:
    box = Mailbox(free_port())
    controller = Controller(box, hostname="127.0.0.1", port=box.port)
    controller.start()
    yield box
    controller.stop()


@dataclass
class Hook:
    """A webhook: what it was sent, and what it accepted; it answers nothing before it is told to go on."""

    port: int = 0
    began: Event = field(default_factory=Event)
    go_on: Event = field(default_factory=Event)
    status: int = 204
    headers: dict[str, str] = field(default_factory=dict)
    taken: list[tuple[dict[str, str], bytes]] = field(default_factory=list)


@contextmanager
def webhook() -> Iterator[Hook]:
    hook = Hook()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            content = self.rfile.read(int(self.headers["Content-Length"]))
            hook.began.set()
            if not hook.go_on.is_set():
                hook.go_on.wait(WAIT_S)
                self.close_connection = True  # nobody is there any more who could hear an answer
                return
            hook.taken.append(({name.lower(): value for name, value in self.headers.items()}, content))
            self.send_response(hook.status)
            for name, value in hook.headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None: ...

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    hook.port = server.server_address[1]
    thread = Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    yield hook
    hook.go_on.set()
    server.shutdown()
    thread.join()
    server.server_close()


Talk = Callable[[socket.socket], object]


@contextmanager
def server(talk: Talk) -> Iterator[int]:
    """A server that does this with each connection; its port."""

    class Handler(BaseRequestHandler):
        def handle(self) -> None:
            with suppress(OSError):
                talk(self.request)

    made = ThreadingTCPServer(("127.0.0.1", 0), Handler)
    made.daemon_threads, made.block_on_close = True, False
    thread = Thread(target=made.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield made.server_address[1]
    made.shutdown()
    thread.join()
    made.server_close()


def silence(connection: socket.socket) -> None:
    while connection.recv(2**16):
        pass


def reset(connection: socket.socket) -> None:
    connection.recv(2**16)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.close()


def says(answer: bytes) -> Talk:
    return lambda connection: connection.recv(2**16) and connection.sendall(answer)


def endless(begin: bytes, piece: bytes) -> Talk:
    def talk(connection: socket.socket) -> None:
        connection.sendall(begin)
        while True:
            connection.sendall(piece)
            time.sleep(0.02)

    return talk


def mail(**answers: bytes) -> Talk:
    """A mail server that answers 250 to all other words."""

    def talk(connection: socket.socket) -> None:
        connection.sendall(b"220 here\r\n")
        for line in connection.makefile("rb"):
            connection.sendall(answers.get(line[:4].decode().upper(), b"250 yes") + b"\r\n")

    return talk


@dataclass
class Broker:
    """An MQTT broker that can be started, and what one subscriber to everything got."""

    folder: Path
    program: str
    port: int
    process: subprocess.Popen[bytes] | None = None
    taken: list[MQTTMessage] = field(default_factory=list)
    client: Client | None = None

    def start(self) -> None:
        settings = self.folder / "broker.conf"
        settings.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence false\n")
        self.process = subprocess.Popen([self.program, "-c", str(settings)], stderr=subprocess.DEVNULL)

        def reached() -> bool:
            with socket.socket() as probe:
                return probe.connect_ex(("127.0.0.1", self.port)) == 0

        wait_for(reached, "the broker's start")
        subscribed = Event()
        self.client = Client(CallbackAPIVersion.VERSION2, client_id="subscriber")
        self.client.on_message = lambda _client, _data, message: self.taken.append(message)
        self.client.on_subscribe = lambda *_: subscribed.set()
        self.client.connect("127.0.0.1", self.port)
        self.client.subscribe("#", qos=2)
        self.client.loop_start()
        assert subscribed.wait(WAIT_S)

    def stop(self) -> None:
        if self.client is not None:
            self.client.disconnect()
            self.client.loop_stop()
        if self.process is not None:
            self.process.terminate()
            self.process.wait()


@contextmanager
def broker(folder: Path) -> Iterator[Broker]:
    """A broker that is not started yet; skips with the reason where there is none."""
    program = next((found for name in BROKERS if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("no MQTT broker here (looked for mosquitto)")
    made = Broker(folder, program, free_port())
    yield made
    made.stop()
