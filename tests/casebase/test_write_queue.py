"""Writers: first come first served, and who would wait too long is refused, and keeps nobody else from writing."""

import time
from pathlib import Path
from threading import Event, Thread

import pytest

from casebase.errors import BusyError
from casebase.library import CaseLibrary
from casebase.store.write_queue import WriteQueue


def test_writers_come_in_the_order_in_which_they_asked() -> None:
    queue, order, threads = WriteQueue(30.0), [], []

    def write(number: int) -> None:
        with queue.turn():
            order.append(number)

    with queue.turn():
        for number in range(20):
            threads.append(Thread(target=write, args=(number,)))
            threads[-1].start()
            while len(queue._waiting) <= number:
                time.sleep(0.001)
    for thread in threads:
        thread.join()
    assert order == list(range(20))


def test_one_that_gives_up_leaves_its_turn_to_others() -> None:
    queue = WriteQueue(0.05)
    with queue.turn(), pytest.raises(BusyError), queue.turn():
        pass
    with queue.turn():
        pass
    with pytest.raises(ValueError), queue.turn():
        raise ValueError
    with queue.turn():
        pass


def test_a_long_transaction_makes_others_busy_not_wrong(tmp_path: Path) -> None:
    """Of the same process or of another."""
    one, other = (CaseLibrary.open(tmp_path, longest_wait_s=0.2) for _ in range(2))
    begun, done = Event(), Event()

    def write() -> None:
        with one.transaction("first"):
            begun.set()
            done.wait(30)

    thread = Thread(target=write)
    thread.start()
    begun.wait(30)
    for library, words in ((one, "more is being stored"), (other, "database is locked")):
        with pytest.raises(Exception, match=words), library.transaction("second"):
            pass
        with library.reading() as session:
            assert library.retrieve.counts(session) == {}
    done.set()
    thread.join()
    for library in (one, other):
        with library.transaction("third"):
            pass
        library.close()
