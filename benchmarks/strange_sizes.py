"""What simulated cases say of recordings that another simulation made: sizes, by data sheet alone.

`python -m benchmarks.strange_sizes --half work`. This simulator makes cases of every label from each axis' data sheet
(`tests.stranger_bank.data_sheet`); the recordings of `benchmarks.strangers` are then sized by them. Told are the median
error, that of always saying the median of the cases, and how many of the intervals said to hold 90 % hold the truth.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.generation import simulate_case
from benchmarks import Row, table
from benchmarks.diagnosis import said
from benchmarks.strangers import audible, heard
from casebase.severity import PARAMETERS, Regression, Scaling
from casebase.signals.features import catalogue
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import Planned, plan
from tests import stranger_bank as bank
from tests.stranger_bank.data_sheet import data_sheet

CASES, DURATION_S = 40, 15.0


@dataclass(frozen=True)
class Told:
    """True size of a fault, what was said of it and between what, and the median of the cases [rad]."""

    label: str
    size: float
    value: float
    low: float
    high: float
    median: float


def simulated(half: bank.Half, axis: str) -> dict[str, tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Return features, shape (cases, n), and sizes [rad] of simulated cases of every fault that has a size."""
    planned = plan(read_axis(data_sheet(half, axis)), dict.fromkeys(PARAMETERS, CASES), 0, duration_s=DURATION_S)
    with ProcessPoolExecutor() as pool:
        values = list(pool.map(_features, planned, chunksize=4))
    found = {}
    for label in PARAMETERS:
        own = [row for row, each in enumerate(planned) if each.label == label]
        sizes = np.array([planned[row].size for row in own], dtype=np.float64)
        found[label] = (np.array([values[row] for row in own]), sizes)
    return found


def _features(planned: Planned) -> NDArray[np.float32]:
    return simulate_case(planned).extraction.features.values


def told(half: bank.Half, axis: str) -> Iterator[Told]:
    """Size the audible faults of known kinds of an axis."""
    known = simulated(half, axis)
    specs = [spec for asked in bank.questions(half) if asked.name.startswith(f"known/{axis}/") for spec in asked.specs]
    with ProcessPoolExecutor() as pool:
        recordings = list(pool.map(heard, specs, chunksize=8))
    compared = np.array([definition.compared for definition in catalogue().values()])
    for truth, extraction in recordings:
        label = min(truth.labels)
        if label not in known or truth.size_rad is None or not audible(truth):
            continue
        cases, sizes = known[label]
        values = extraction.features.values
        usable = compared & np.isfinite(values) & (np.isfinite(cases).mean(axis=0) > 0.8)
        scaling = Scaling.of(cases[:, usable], sizes)
        regression = Regression.of(scaling.apply(cases[:, usable]), sizes)
        found = regression.severity(PARAMETERS[label], scaling.apply(values[None, usable]))
        yield Told(label, truth.size_rad, found.value, found.low, found.high, float(np.median(sizes)))


def row(name: str, found: Sequence[Told]) -> Row:
    """Return the median factor by which sizes are off, beside that of the median, and how many intervals hold."""
    off = float(np.exp(np.median([abs(np.log(each.value / each.size)) for each in found])))
    middle = float(np.exp(np.median([abs(np.log(each.median / each.size)) for each in found])))
    hold = sum(each.low <= each.size <= each.high for each in found)
    note = (
        f"off by a factor of {off:.2f}, the median of the cases {middle:.2f}; intervals hold {said(hold, len(found))}"
    )
    return Row(name, 0.0, note=note)


def judged(half: bank.Half) -> list[Row]:
    """Size the recordings of one half."""
    found = {axis: list(told(half, axis)) for axis in bank.DESIGNS[half]}
    rows = [row(axis, each) for axis, each in found.items()]
    return [*rows, row("all", [one for each in found.values() for one in each])]


def run() -> list[Row]:
    """Size the half that may be worked with."""
    return judged("work")


def main() -> None:
    """Size one half."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.strange_sizes", description=__doc__)
    parser.add_argument("--half", choices=("work", "final"), default="work")
    half = parser.parse_args().half
    print(table(f"sizes of strangers' faults by simulated cases, half {half}", judged(half)))


if __name__ == "__main__":
    main()
