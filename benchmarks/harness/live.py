"""A real service: uvicorn in a process of its own, on a free port, with a key of each role."""

import io
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from app.cli import run
from app.http.security import COOKIE

ROLES = ("viewer", "operator", "admin")
START_S = 300.0
NO_MAIL_SERVER = "smtp://127.0.0.1:9"
"""Where nobody listens: receivers of e-mail can be made, and no message leaves."""


@dataclass(frozen=True)
class Done:
    """What a command left: its exit code and what it wrote."""

    code: int
    stdout: str
    stderr: str


def gearcase(*words: str | Path, data_dir: Path) -> Done:
    """Run one command of the command line in this process."""
    out, error, temporary = io.StringIO(), io.StringIO(), tempfile.tempdir
    with redirect_stdout(out), redirect_stderr(error):
        code = run([*map(str, words), "--data-dir", str(data_dir)])
    tempfile.tempdir = temporary  # the service sets its own
    return Done(code, out.getvalue(), error.getvalue())


@dataclass
class LiveServer:
    """One running service and the keys to it."""

    data_dir: Path
    environment: Mapping[str, str] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)
    url: str = ""
    process: subprocess.Popen[str] | None = None
    worker: bool = False
    """With a worker beside it, and then in a process group of its own."""
    printed: list[str] = field(default_factory=list)
    port: int = 0
    """To listen on; any that is free where 0."""

    def start(self) -> None:
        """Start the service and wait until it has printed its address."""
        log = (self.data_dir.parent / "service.log").open("a")
        command = [sys.executable, "-m", "app", "serve", "--port", str(self.port)]
        command += ["--show-key", "--worker" if self.worker else "--no-worker"]
        self.process = subprocess.Popen(
            [*command, "--data-dir", str(self.data_dir)],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            env={**os.environ, **self.environment, "PYTHONUNBUFFERED": "1"},
            start_new_session=self.worker,
        )
        log.close()
        assert self.process.stdout is not None
        deadline = time.monotonic() + START_S
        for line in self.process.stdout:
            self.printed.append(line.rstrip())
            address = re.match(r"Open (http://\S+?)/$", line.strip())
            if address:
                self.url = address.group(1)
                return
            assert time.monotonic() < deadline, "the service did not start"
        raise AssertionError(f"the service ended: {self.log()[-3000:]}")

    def until_ready(self) -> None:
        """Wait until the service says that it is ready."""
        deadline = time.monotonic() + START_S
        while not httpx.get(f"{self.url}/readyz").is_success:
            assert time.monotonic() < deadline, "the service did not become ready"
            time.sleep(0.02)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Send a signal and wait for the end; return the exit code."""
        assert self.process is not None
        self.process.send_signal(number)
        return self.ended()

    def ended(self) -> int:
        """Wait for the end; return the exit code."""
        assert self.process is not None
        assert self.process.stdout is not None
        code = self.process.wait(60)
        self.process.stdout.close()
        return code

    def kill_all(self) -> None:
        """End it and what runs beside it as a power cut would."""
        assert self.process is not None
        assert self.worker
        os.killpg(self.process.pid, signal.SIGKILL)
        self.ended()

    @property
    def running(self) -> bool:
        return self.process is not None and self.process.poll() is None

    def kill(self) -> None:
        """End it as a power cut would."""
        self.stop(signal.SIGKILL)

    def log(self) -> str:
        return (self.data_dir.parent / "service.log").read_text()

    def logged(self, words: str) -> str:
        """The log line with these words; the service may write it after the answer has gone out."""
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            for line in self.log().splitlines(keepends=True):
                if words in line and line.endswith("\n"):
                    return line
            time.sleep(0.02)
        raise AssertionError(f"{words!r} is not in the log: {self.log()[-3000:]}")

    def client(self, role: str | None = "admin", **options: object) -> httpx.Client:
        """A client with the key of a role, or with none; close it after use."""
        headers = {"Authorization": f"Bearer {self.keys[role]}"} if role else {}
        return httpx.Client(base_url=self.url, headers=headers, timeout=60.0, **options)  # type: ignore[arg-type]

    def session(self, role: str) -> dict[str, str]:
        """The cookie of a browser that has signed in with the key of a role."""
        with httpx.Client(base_url=self.url) as browser:
            sign_in(browser, self.keys[role])
            return {COOKIE: browser.cookies[COOKIE]}


def sign_in(browser: httpx.Client, key: str, path: str = "/") -> httpx.Response:
    """Send the sign-in form as a browser does: with the token that it came with."""
    form = browser.get("/sign-in").text
    token = re.search(r'name="csrf" value="(\w+)"', form)
    assert token is not None
    while (answer := browser.post("/sign-in", data={"csrf": token[1], "key": key, "next": path})).status_code == 503:
        time.sleep(float(answer.headers["retry-after"]))
    return answer


def started(data_dir: Path, *, worker: bool = False, **environment: str) -> LiveServer:
    """Start a service over a data directory that has no key yet and make a key of each role."""
    data_dir.mkdir(parents=True, exist_ok=True)
    server = LiveServer(data_dir, {"GEARCASE_SMTP_URL": NO_MAIL_SERVER, **environment}, worker=worker)
    server.start()
    admin = next(line.split()[-1] for line in server.printed if line.startswith("Admin key"))
    server.keys["admin"] = admin
    with server.client() as client:
        for role in ("viewer", "operator"):
            answer = client.post("/api/v1/keys", json={"name": f"test {role}", "role": role})
            server.keys[role] = answer.raise_for_status().json()["key"]
    return server
