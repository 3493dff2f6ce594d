"""What takes longer than a page may: worked out once for each state of the library, beside the requests that ask."""

from collections.abc import Callable, Hashable
from concurrent.futures import Future, wait
from dataclasses import dataclass, field
from threading import Event, Lock, Thread
from time import monotonic
from typing import Any, Generic, TypeVar

from sqlalchemy.orm import Session

from casebase.errors import LibraryError
from casebase.library import CaseLibrary

Value = TypeVar("Value")


class NotReadyError(Exception):
    """What was asked takes longer than a request may."""


WAIT_S, STEP_S = 25.0, 1.0
SOON_S = 0.25
"""So long a page waits before it says that something is being worked out: less is not seen as waiting."""


@dataclass(frozen=True)
class CachedQuery(Generic[Value]):
    """What is asked of the library.

    Args:
        kind: of question; those of a kind take about as long.
        state: of the library: for another one it is asked anew.
        about: what else the answer hangs on.
        work: answers it.
    """

    kind: str
    state: Hashable
    about: Hashable
    work: Callable[[Session], Value]

    @property
    def key(self) -> tuple[str, Hashable, Hashable]:
        """What is the same of all that ask the same."""
        return self.kind, self.state, self.about


@dataclass(frozen=True)
class Pending:
    """What is being worked out, since when, and how long the last one of its kind took [s]; None where none did."""

    future: "Future[Any]"
    began: float = field(default_factory=monotonic)
    last_s: float | None = None

    @property
    def share(self) -> float | None:
        """How much of the time has passed that the last one took, never all of it; None where that is not known."""
        return None if not self.last_s else min((monotonic() - self.began) / self.last_s, 0.95)


class Beside:
    """The answers of one library. A large one takes minutes: who asks for it waits a while, then is told so."""

    def __init__(self, library: CaseLibrary, stopping: Event) -> None:
        self._library, self._stopping = library, stopping
        self._lock = Lock()
        self._found: dict[tuple[str, Hashable, Hashable], Pending] = {}
        self._took_s: dict[str, float] = {}

    def get(self, asked: CachedQuery[Value]) -> Value:
        """Return the answer, waiting for it.

        Raises:
            NotReadyError: if it is not ready yet.
            LibraryError: if it cannot be told.
        """
        begun = self.begun(asked)
        until = monotonic() + WAIT_S
        while monotonic() < until and not self._stopping.is_set():
            wait([begun.future], STEP_S)
            if begun.future.done():
                found: Value = begun.future.result()
                return found
        raise NotReadyError("What was asked of this library takes longer than a request may; ask again in a minute.")

    def soon(self, asked: CachedQuery[Value], wait_s: float = SOON_S) -> Value | Pending:
        """Return the answer if it is there, or soon; else what is begun.

        Raises:
            LibraryError: if it cannot be told.
        """
        begun = self.begun(asked)
        wait([begun.future], wait_s)
        if not begun.future.done():
            return begun
        found: Value = begun.future.result()
        return found

    def known(self, asked: CachedQuery[Value]) -> Value | None:
        """Return the answer if it is there already; nothing is begun for it."""
        begun = self._found.get(asked.key)
        if begun is None or not begun.future.done() or begun.future.exception() is not None:
            return None
        found: Value = begun.future.result()
        return found

    def begun(self, asked: CachedQuery[Any]) -> Pending:
        """Return what will be the answer; who asks first has it worked out."""
        key = asked.key
        with self._lock:
            known = self._found.get(key)
            if known is None:
                self._found = {
                    kept: one for kept, one in self._found.items() if (kept[0], kept[1]) == key[:2] or kept[0] != key[0]
                }
                known = self._found[key] = Pending(Future(), last_s=self._took_s.get(asked.kind))
                Thread(target=self._compute, args=(asked, known), daemon=True).start()
            return known

    def _compute(self, asked: CachedQuery[Any], begun: Pending) -> None:
        try:
            with self._library.reading() as session:
                found = asked.work(session)
            begun.future.set_result(found)
            self._took_s[asked.kind] = monotonic() - begun.began
        except Exception as error:  # noqa: BLE001 - raised again in the request that asked
            if not isinstance(error, LibraryError):  # a fault is no answer: who asks next has it begun anew
                with self._lock:
                    self._found = {key: one for key, one in self._found.items() if one is not begun}
            begun.future.set_exception(error)
