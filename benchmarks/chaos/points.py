"""kill -9 of this very process at its n-th write: the points are set from outside, the product knows nothing of them.

A point lies before and after every fsync, rename, removal and new folder, before every file opened for writing, before
and after every statement that writes and every commit of either database, and before the answer goes out.
"""

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from sqlalchemy import Engine, event
from sqlalchemy.engine.default import DefaultDialect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

ON_DISK = ("fsync", "link", "rename", "replace", "unlink", "mkdir", "rmdir")
WRITES = ("INSERT", "UPDATE", "DELETE", "WITH")


@dataclass
class CrashPoint:
    """Where this process dies: at the n-th write after it was armed; where `at` is 0, nowhere, but they are counted."""

    at: int
    armed: bool = False
    passed: list[str] = field(default_factory=list)
    _lock: Lock = field(default_factory=Lock)

    def __call__(self, what: str) -> None:
        if not self.armed:
            return
        with self._lock:
            self.passed.append(what)
            if len(self.passed) == self.at:
                os.kill(os.getpid(), signal.SIGKILL)

    def install(self) -> None:
        """Set the points in this process, for good."""
        for name in ON_DISK:
            setattr(os, name, self._around(name, getattr(os, name)))
        DefaultDialect.do_commit = self._around("commit", DefaultDialect.do_commit)  # type: ignore[method-assign]
        event.listen(Engine, "before_cursor_execute", self._statement("before"))
        event.listen(Engine, "after_cursor_execute", self._statement("after"))
        sys.addaudithook(self._opened)

    def _around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def instead(*arguments: Any, **named: Any) -> Any:
            self(f"before {name}")
            result = function(*arguments, **named)
            self(f"after {name}")
            return result

        return instead

    def _statement(self, when: str) -> Callable[..., None]:
        def instead(_connection: object, _cursor: object, statement: str, *_: object) -> None:
            verb = statement.split(None, 1)[0].upper()
            if verb in WRITES:
                self(f"{when} {' '.join(statement.split()[:3])}")

        return instead

    def _opened(self, name: str, arguments: tuple[Any, ...]) -> None:
        flags = arguments[2] if name == "open" else None
        if self.armed and isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR):
            self("before open for writing")

    def answering(self, app: ASGIApp) -> ASGIApp:
        """An application that may die before it answers."""

        async def instead(scope: Scope, receive: Receive, send: Send) -> None:
            async def sent(message: Message) -> None:
                self(f"before {message['type']}")
                await send(message)

            await app(scope, receive, sent)

        return instead
