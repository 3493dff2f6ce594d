"""Many simulated measurements on all cores, the same whatever the number of workers."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from sim.acoustics.microphone import Microphone
from sim.description.axis import Axis
from sim.errors import number
from sim.experiment.virtual_measurement import DEFAULT_MICROPHONE, Measurement, measure

AHEAD = 2  # runs per worker that may wait to be taken, so that memory is bounded however many axes come


def simulate_many(
    axes: Iterable[Axis],
    duration_s: float,
    *,
    seed: int = 0,
    microphone: Microphone = DEFAULT_MICROPHONE,
    workers: int | None = None,
) -> Iterator[Measurement]:
    """Yield one measurement per axis, in their order.

    Threads do it, since the compiled engine and the transforms work without the interpreter's lock. Run i has a seed
    of its own that hangs on `seed` and i alone. `workers` None: one per core.

    Raises SimulationError of the first axis that cannot be simulated, when its turn comes.
    """
    count = int(number("workers", workers or os.cpu_count() or 1, "", at_least=1, at_most=1024))
    waiting: deque[Future[Measurement]] = deque()
    with ThreadPoolExecutor(count) as pool:
        try:
            for i, axis in enumerate(axes):
                waiting.append(pool.submit(measure, axis, duration_s, seed_of_run(seed, i), microphone))
                if len(waiting) > AHEAD * count:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def seed_of_run(seed: int, i: int) -> int:
    """Seed of run i: independent streams for every pair (numpy's SeedSequence)."""
    return int(np.random.SeedSequence((seed, i)).generate_state(1, np.uint64)[0] >> 1)
