"""Cross-validations of the library: computed once for each state of it, beside the requests that ask."""

from concurrent.futures import Future
from contextlib import suppress
from threading import Event, Lock, Thread
from time import monotonic

from app.errors import Unavailable
from casebase.errors import LibraryError
from casebase.evaluation import Evaluation
from casebase.library import CaseLibrary

WAIT_S, STEP_S = 25.0, 1.0
Key = tuple[int, str, str, str | None, str | None]
"""Version of the library, what is left out together, origin, a case that it does without, and an axis."""


class Evaluations:
    """The evaluations of one library. A large one takes minutes: who asks for it waits a while, then is told so."""

    def __init__(self, library: CaseLibrary, stopping: Event) -> None:
        self._library, self._stopping = library, stopping
        self._lock = Lock()
        self._found: dict[Key, Future[Evaluation]] = {}

    def get(self, version: int, group: str, origin: str, without: str | None = None) -> Evaluation:
        """Return the evaluation of the library at this version, without a case if one is named.

        Raises:
            Unavailable: if it is not ready yet.
        """
        found = self._begun((version, group, origin, without, None))
        until = monotonic() + WAIT_S
        while monotonic() < until and not self._stopping.is_set():
            with suppress(TimeoutError):
                return found.result(STEP_S)
        raise Unavailable(
            "The cross-validation of this library takes longer than a request may; ask again in a minute.",
            headers={"Retry-After": "60"},
        )

    def of_axis(self, version: int, axis: str) -> Evaluation | None:
        """Return what is said of the held-out cases of an axis at this version; None where it is not ready yet.

        Raises:
            LibraryError: if it cannot be told.
        """
        found = self._begun((version, "gearbox", "both", None, axis))
        return found.result() if found.done() and not found.cancelled() else None

    def _begun(self, key: Key) -> "Future[Evaluation]":
        """Return what will be the evaluation; who asks first has it computed."""
        with self._lock:
            if key not in self._found:
                self._found = {kept: found for kept, found in self._found.items() if kept[0] == key[0]}
                self._found[key] = Future()
                Thread(target=self._compute, args=(key, self._found[key]), daemon=True).start()
            return self._found[key]

    def _compute(self, key: Key, found: Future[Evaluation]) -> None:
        try:
            with self._library.reading() as session:
                group, origin, without, axis = key[1:]
                result = self._library.reuse.evaluate(session, group=group, origin=origin, without=without, axis=axis)
                found.set_result(result)
        except LibraryError as error:
            found.set_exception(error)
        finally:
            found.cancel()  # does nothing to what is done; a fault of ours must not keep anybody waiting
