"""Writers of one process: one at a time, first come first served, and none that waits longer than is bearable.

SQLite has one writer, and lets those that wait try again at random: some would wait for ever.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Lock

from casebase.errors import BusyError


class WriteQueue:
    """Who may write now, and who is next.

    Args:
        longest_wait_s: after which a writer gives up [s].
    """

    def __init__(self, longest_wait_s: float) -> None:
        self._longest_wait_s = longest_wait_s
        self._lock = Lock()
        self._writing = False
        self._waiting: deque[Event] = deque()

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Wait until nobody writes who came before, and let the next one write at the end.

        Raises:
            BusyError: if that takes too long.
        """
        with self._lock:
            turn = Event()
            if self._writing:
                self._waiting.append(turn)
            else:
                self._writing = True
                turn.set()
        if not turn.wait(self._longest_wait_s):
            with self._lock:
                if not turn.is_set():  # else it came at the last moment
                    self._waiting.remove(turn)
                    raise BusyError("more is being stored than the database can take; send it again in a few seconds")
        try:
            yield
        finally:
            with self._lock:
                self._writing = bool(self._waiting)
                if self._waiting:
                    self._waiting.popleft().set()
