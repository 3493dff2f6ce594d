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
Key = tuple[int, str, str, str | None]
"""Version of the library, what is left out together, origin, and a case that it does without."""


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
        key = (version, group, origin, without)
        with self._lock:
            if key not in self._found:
                self._found = {kept: found for kept, found in self._found.items() if kept[0] == version}
                self._found[key] = Future()
                Thread(target=self._compute, args=(key, self._found[key]), daemon=True).start()
            found = self._found[key]
        until = monotonic() + WAIT_S
        while monotonic() < until and not self._stopping.is_set():
            with suppress(TimeoutError):
                return found.result(STEP_S)
        raise Unavailable(
            "The cross-validation of this library takes longer than a request may; ask again in a minute.",
            headers={"Retry-After": "60"},
        )

    def _compute(self, key: Key, found: Future[Evaluation]) -> None:
        try:
            with self._library.reading() as session:
                found.set_result(self._library.reuse.evaluate(session, group=key[1], origin=key[2], without=key[3]))
        except LibraryError as error:
            found.set_exception(error)
        finally:
            found.cancel()  # does nothing to what is done; a fault of ours must not keep anybody waiting
