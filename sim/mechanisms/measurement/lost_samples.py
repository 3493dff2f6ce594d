"""Rows that a logger or a bus did not deliver."""

from dataclasses import replace

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.mechanisms.mechanism import Measurement, Parameter, Signature, SoundReport, Traits, only


class LostSamples(Measurement):
    """A share of the rows is missing, in runs of one to eight.

    Equations: rows are taken out at random until the share is reached
    Source: overrun of a bus
    """

    name = "lost_samples"
    parameters = (Parameter("fraction", "1", 0.0, 0.5, 0.01),)
    size = "fraction"
    locations = only(None)
    signature = Signature("recording")
    action = (
        "Check load of the logger, buffers and cables of the recorder, then record again; nothing is wrong with the "
        "machine."
    )
    check = "Repeat the same motion without gaps: what happens in the lost rows was not measured."
    checked = (
        "rows or samples missing, or held while it moves",
        "none found (less than 0.05 % of all)",
    )
    sound = SoundReport(
        "lost samples",
        "Record again with the gain lowered and without gaps: what is missing of the sound could be a fault's.",
    )
    traits = Traits(
        own_hypothesis=True,
        beside_the_chain=True,
        of_the_recording=True,
    )

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
