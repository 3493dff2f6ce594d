"""`gearcase serve`: the service, in one process with a worker beside it."""

import asyncio
import ctypes
import signal
import socket
import sys
import tempfile
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
import uvicorn

from app.commands.frame import ACTOR, settings
from app.commands.jobs import LogFolder, worker_child
from app.http.connections import BACKLOG, Wants, protocol_of
from app.http.keys import Role, create_key, list_keys
from app.http.middleware import Metrics
from app.logs import configure_logs, leave
from app.main import create_app
from app.service import Service
from app.upkeep import Periodic
from casebase.errors import DamagedError
from casebase.store.integrity import RESTORE, cut_logs, faults_of

RULE = "\N{BOX DRAWINGS HEAVY HORIZONTAL}" * 75
FIRST_KEY = "first-admin-key"
M_ARENA_MAX = -8
TRIM_EVERY_S = 20.0
STOPPING_S = 4
"""Requests under way are given so long; the service ends within 5 s, who runs containers kills after 10."""


def serve(
    host: Annotated[str, typer.Option(help="address to listen on")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes any that is free")] = 8000,
    worker: Annotated[bool, typer.Option(help="run a worker for jobs beside the service")] = True,
    proxies: Annotated[
        str, typer.Option(help="addresses of proxies whose X-Forwarded headers are believed; none by default")
    ] = "",
    log_folder: LogFolder = None,
    show_key: Annotated[
        bool | None, typer.Option(help="print the first admin key; by default only where stdout is a terminal")
    ] = None,
) -> None:
    """Serve the API and the pages; prints the address to open.

    On the first start it makes an admin key. Where that is not printed, it stands in the file first-admin-key of the
    data folder.
    """
    with _listen(host, port) as listening:
        shown = sys.stdout.isatty() if show_key is None else show_key
        _serve(listening, worker=worker, proxies=proxies, log_folder=log_folder, show_key=shown)
    leave(again=False)


def return_memory() -> None:
    """Give freed memory back every so often: under load glibc's heaps grow, and one is made for each thread."""
    libc = ctypes.CDLL(None) if sys.platform == "linux" else None
    if libc is not None and hasattr(libc, "malloc_trim"):
        libc.mallopt(M_ARENA_MAX, 2)
        Periodic("memory", TRIM_EVERY_S, partial(libc.malloc_trim, 0)).start()


def _serve(listening: socket.socket, *, worker: bool, proxies: str, log_folder: Path | None, show_key: bool) -> None:
    return_memory()
    service = Service.open(settings(), Metrics())
    tempfile.tempdir = str(settings().data_dir)  # that of the system may be read-only
    try:
        faults = faults_of(service.library.engine)
        if faults:
            raise DamagedError(f"the database is damaged ({faults[0]}). {RESTORE}")
        service.tidy()
        cut_logs(settings().data_dir)
        first = _first_key(service, show=show_key)
        configure_logs("service", log_folder)
        config = uvicorn.Config(
            create_app(service=service),
            http=protocol_of(settings()),
            backlog=BACKLOG,
            access_log=False,
            log_config=None,
            proxy_headers=bool(proxies),
            forwarded_allow_ips=proxies or "127.0.0.1",
            server_header=False,
            timeout_keep_alive=int(settings().header_timeout_s),  # who comes again after 5 s has a connection
            timeout_graceful_shutdown=STOPPING_S,
            h11_max_incomplete_event_size=64 * 1024,
        )
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _stopped)
        with worker_child(settings(), service.stopping, log_folder) if worker else nullcontext():
            Announced(config, service, first, log_folder).run(sockets=[listening])
    finally:
        service.close()


def _stopped(_number: int, _frame: object) -> None:
    """The server has stopped in good order and raises its signal again; what runs beside it is to end as well."""


class Announced(uvicorn.Server):
    """A server that says where it is once it is there."""

    def __init__(self, config: uvicorn.Config, service: Service, first_key: str, log_folder: Path | None) -> None:
        super().__init__(config)
        self._service, self._first_key, self._log_folder = service, first_key, log_folder

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._service.stopping.set()
        await super().shutdown(sockets)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        asyncio.get_running_loop().set_exception_handler(Wants())
        await super().startup(sockets)
        if not self.started or not sockets:
            return
        for words in _emptiness(self._service):
            print(words)
        print(RULE)
        if self._first_key:
            print(self._first_key)
        host, port = sockets[0].getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        print(f"Open http://{shown}:{port}{self._service.settings.root_path}/")
        print(f"Log: {self._log_folder or 'stderr'}. Ctrl-C ends the service.")
        print(RULE, flush=True)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # the protocol by name, for asyncio sets TCP_NODELAY only where it is told: else each answer waits for a delayed ACK
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise OSError(
            f"cannot listen on {host}:{port}: {error.strerror}; choose another with --host or --port"
        ) from None
    return listening


def _first_key(service: Service, *, show: bool) -> str:
    """Make an admin key where there is none at all; say what it is, or which file it is in, since output may be a log.

    The library is open: what this process writes is for its owner alone.
    """
    with service.library.transaction(ACTOR) as session:
        if list_keys(session):
            return ""
        key = create_key(session, name="first admin", role=Role.ADMIN)[1]
        if show:
            return f"Admin key, shown this once: {key}"
        path = service.settings.data_dir.resolve() / FIRST_KEY
        path.write_text(f"{key}\n", encoding="ascii")
        return f"Admin key: in {path}. Remove that file when you have the key."


def _emptiness(service: Service) -> list[str]:
    with service.library.reading() as session:
        if service.library.retrieve.counts(session):
            return []
    folder = service.settings.data_dir
    return [
        "The library is empty, so every answer will be 'not_in_library'. Fill it with your own recordings:",
        f"  gearcase --data-dir {folder} cases add FILE... --label normal",
        "or with simulated cases of an example axis:",
        f"  gearcase --data-dir {folder} starter",
    ]
