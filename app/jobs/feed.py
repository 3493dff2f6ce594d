"""What happens to jobs, for any number of listeners: on the event loop, read from the database once for all of them."""

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from app.jobs.job import JobEvent
from app.jobs.jobs import POLL_S, Jobs


@dataclass(eq=False)
class Topic:
    """One job that somebody listens to: what is known of its history."""

    events: list[JobEvent] = field(default_factory=list)
    ended: bool = False
    error: BaseException | None = None
    listeners: int = 0
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def tell(self) -> None:
        """Wake whoever waits for news."""
        self.news.set()
        self.news = asyncio.Event()


class JobFeed:
    """Follows jobs while somebody listens. A listener costs neither a thread nor a look into the database.

    Args:
        jobs: opens the jobs.
    """

    def __init__(self, jobs: Callable[[], Jobs]) -> None:
        self._jobs = jobs
        self._topics: dict[str, Topic] = {}
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="job feed")
        self._reading: asyncio.Task[None] | None = None

    async def follow(self, job_id: str, *, after: int, patience_s: float) -> AsyncIterator[JobEvent | None]:
        """Yield the history after event number `after`, then what happens until the job ends.

        Yields None when nothing happened for `patience_s` [s].
        """
        topic = self._topics.setdefault(job_id, Topic())
        topic.listeners += 1
        if self._reading is None or self._reading.done():
            self._reading = asyncio.create_task(self._read())
        number = after + 1
        try:
            while True:
                news = topic.news
                while number < len(topic.events):
                    yield topic.events[number]
                    number += 1
                if topic.error is not None:
                    raise topic.error
                if topic.ended:
                    return
                try:
                    async with asyncio.timeout(patience_s):
                        await news.wait()
                except TimeoutError:
                    yield None
        finally:
            topic.listeners -= 1
            if topic.listeners == 0 and self._topics.get(job_id) is topic:
                del self._topics[job_id]

    def close(self) -> None:
        """Read no more."""
        self._reader.shutdown(wait=False, cancel_futures=True)

    async def _read(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            while self._topics:
                for job_id, topic in list(self._topics.items()):
                    if topic.ended:
                        continue
                    events, topic.ended = await loop.run_in_executor(
                        self._reader, self._news, job_id, len(topic.events)
                    )
                    topic.events += events
                    if events or topic.ended:
                        topic.tell()
                await asyncio.sleep(POLL_S)
        except BaseException as error:  # whoever listens breaks off, comes back and is told
            for topic in self._topics.values():
                topic.error = error
                topic.tell()
            self._topics.clear()
            raise

    def _news(self, job_id: str, known: int) -> tuple[list[JobEvent], bool]:
        """Return the events from number `known` on that there are now, and whether none will follow."""
        found: list[JobEvent] = []
        for event in self._jobs().events(job_id, after=known - 1, patience_s=0.0):
            if event is None:
                return found, False
            found.append(event)
        return found, True
