"""What a simulation gives: named channels with units over one clock, and the list of events."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import CompositionError, near_match
from sim.residual import Residual

MEMORY_LIMIT_BYTES = 2_000_000_000
"""Largest result that is returned at once: 43 minutes of three shafts at 8 kHz."""


class Event(NamedTuple):
    """A component changed its mode: when [s], which, from what to what (Modelica's numbers, and in words)."""

    time_s: float
    component: str
    from_mode: int
    to_mode: int
    from_name: str = ""
    to_name: str = ""


class Channels(Mapping[str, NDArray[np.float64]]):
    """Named channels, each computed when it is first read."""

    def __init__(self, sources: Mapping[str, Callable[[], NDArray[np.float64]]]) -> None:
        self._sources = sources
        self._ready: dict[str, NDArray[np.float64]] = {}

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self._ready:
            if name not in self._sources:
                raise KeyError(f"no channel {name!r}{near_match(name, self._sources)}")
            self._ready[name] = self._sources[name]()
        return self._ready[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)


@dataclass(frozen=True)
class Trajectory:
    """One simulated run.

    Parameters
    ----------
    time_s
        Sample times [s], shape (n,), evenly spaced.
    channels
        Values by name (`inertia2.w`, `gear.mode`), each of shape (n,), right-hand limits at events.
    units
        Unit of every channel by the same name.
    events
        All changes of mode, in order of time.
    engine
        `exact` or `chain`: how it was computed.
    residual
        How well the run obeys its own equations; None where nobody looked.
    """

    time_s: NDArray[np.float64]
    channels: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str]
    events: tuple[Event, ...]
    engine: str
    residual: Residual | None = None

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return one channel, shape (n,).

        Raises
        ------
        CompositionError
            when there is no such channel; the message says the nearest.
        """
        if name not in self.channels:
            raise CompositionError(f"no channel {name!r}{near_match(name, self.channels)}")
        return self.channels[name]

    @property
    def sample_rate_hz(self) -> float:
        return float((len(self.time_s) - 1) / (self.time_s[-1] - self.time_s[0])) if len(self.time_s) > 1 else 0.0
