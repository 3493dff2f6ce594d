"""What happens to jobs, for any number of listeners: on the event loop, read from the database once for all of them."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from weakref import WeakValueDictionary

from app.jobs.job import JobEvent
from app.jobs.jobs import POLL_S, Jobs


@dataclass(eq=False)
class Topic:
    """One job that somebody listens to: what was known of its history when it was last read."""

    events: list[JobEvent] = field(default_factory=list)
    over: bool = False
    read_at: float = float("-inf")
    reading: asyncio.Lock = field(default_factory=asyncio.Lock)


class JobFeed:
    """Follows jobs while somebody listens. A listener costs neither a thread nor a look into the database."""

    def __init__(self, jobs: Jobs) -> None:
        self._jobs = jobs
        self._topics: WeakValueDictionary[str, Topic] = WeakValueDictionary()
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="job feed")

    async def follow(self, job_id: str, *, after: int, patience_s: float) -> AsyncIterator[JobEvent | None]:
        """Yield the history after event number `after`, then what happens until the job ends.

        Yields None when nothing happened for `patience_s` [s].
        """
        topic = self._topics.setdefault(job_id, Topic())
        loop = asyncio.get_running_loop()
        number, heard_at = after + 1, loop.time()
        while True:
            async with topic.reading:
                if loop.time() - topic.read_at >= POLL_S:
                    found, topic.over = await loop.run_in_executor(self._reader, self._news, job_id, topic)
                    topic.events += found
                    topic.read_at = loop.time()
            for event in topic.events[number:]:
                yield event
                number, heard_at = event.number + 1, loop.time()
            if topic.over:
                return
            if loop.time() - heard_at >= patience_s:
                heard_at = loop.time()
                yield None
            await asyncio.sleep(POLL_S)

    def close(self) -> None:
        """Read no more."""
        self._reader.shutdown(wait=False, cancel_futures=True)

    def _news(self, job_id: str, topic: Topic) -> tuple[Sequence[JobEvent], bool]:
        return self._jobs.news(job_id, after=len(topic.events) - 1)
