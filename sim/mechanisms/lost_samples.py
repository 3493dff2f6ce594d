"""Rows that a logger or a bus did not deliver."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.heard import Heard
from sim.mechanisms.mechanism import Measurement, Parameter, Signature


class LostSamples(Measurement):
    """A share of the rows is missing, in runs of one to eight."""

    name: ClassVar[str] = "lost_samples"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("fraction", "1", 0.0, 0.5, 0.01),)
    size: ClassVar[str] = "fraction"
    signature: ClassVar[Signature] = Signature("recording")
    equations: ClassVar[str] = "rows are taken out at random until the share is reached"
    source: ClassVar[str] = "overrun of a bus"
    action: ClassVar[str] = (
        "Check load of the logger, buffers and cables of the recorder, then record again; nothing is wrong with the "
        "machine."
    )
    check: ClassVar[str] = "Repeat the same motion without gaps: what happens in the lost rows was not measured."
    own_hypothesis: ClassVar[bool] = True
    beside_the_chain: ClassVar[bool] = True
    of_the_recording: ClassVar[bool] = True
    checked: ClassVar[tuple[str, str] | None] = (
        "rows or samples missing, or held while it moves",
        "none found (less than 0.05 % of all)",
    )
    heard: ClassVar[Heard | None] = Heard(
        "lost samples",
        "Record again with the gain lowered and without gaps: what is missing of the sound could be a fault's.",
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return (None,)

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        rows = telemetry.rows
        wanted = round(self["fraction"] * rows)
        if wanted == 0:
            return telemetry
        random = np.random.default_rng(seed)
        keep = np.ones(rows, dtype=bool)
        while np.count_nonzero(~keep) < wanted:
            start = int(random.integers(1, rows - 9))
            left = wanted - int(np.count_nonzero(~keep))
            keep[start : start + min(int(random.integers(1, 9)), left)] = False
        lost = {name: values[keep] for name, values in telemetry.lost.items()}
        channels = {name: values[keep] for name, values in telemetry.channels.items()}
        return replace(telemetry, time_s=telemetry.time_s[keep], channels=channels, lost=lost)
