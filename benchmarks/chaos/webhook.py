"""A receiver of alarms as bad as real ones: at times it answers 500, breaks off after it took a message, or is away."""

import random
from collections import defaultdict
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

FAILS, BREAKS_OFF = 0.15, 0.1


@dataclass
class Webhook:
    """What was taken, by the id of the message: all bodies that came with it."""

    chance: random.Random
    well: bool = False
    taken: dict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    port: int = 0
    _server: ThreadingHTTPServer | None = None

    def open(self) -> None:
        """Listen, at the port of the first time."""
        hook = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                length = int(self.headers["Content-Length"])
                content = self.rfile.read(length)
                if len(content) < length:  # who sent it was killed meanwhile
                    return
                drawn = 1.0 if hook.well else hook.chance.random()
                if drawn >= FAILS:
                    hook.taken[self.headers["webhook-id"]].append(content)
                if FAILS <= drawn < FAILS + BREAKS_OFF:
                    return
                self.send_response(500 if drawn < FAILS else 204)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, *_: object) -> None: ...

        self._server = ThreadingHTTPServer(("127.0.0.1", self.port), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_address[1]
        Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def close(self) -> None:
        """Be away: nobody listens."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None
