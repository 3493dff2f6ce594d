"""What the features alone reach on measured data, with a plain nearest neighbour; learned weights come later.

Run with `-s` to see the figures.
"""

import csv
import functools

import numpy as np
import pytest
import soundfile

from casebase.signals.condition import OperatingCondition
from casebase.signals.features import catalogue, extract
from casebase.signals.recording import Recording
from tests.shared_data import shared

NAMES = list(catalogue())
BUMPS = [NAMES.index("play_bump_12_200_hz"), NAMES.index("notch_bump_12_200_hz")]
BANDS = [k for k, name in enumerate(NAMES) if name.startswith("band_level")]
STEADY = OperatingCondition(steady=True)


def nearest(train: np.ndarray, labels: np.ndarray, test: np.ndarray) -> np.ndarray:
    """Return the label of the nearest standardised neighbour of every test row."""
    mean, scale = train.mean(axis=0), train.std(axis=0)
    known = np.isfinite(scale) & (scale > 0) & np.isfinite(test).all(axis=0)
    train, test = ((rows - mean)[:, known] / scale[known] for rows in (train, test))
    return labels[((test[:, None] - train[None]) ** 2).sum(axis=2).argmin(axis=1)]


@functools.cache
def joints() -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    folder = shared("data", "axis_recordings")
    with (folder / "manifest.csv").open() as file:
        rows = list(csv.DictReader(file))
    sounds = [soundfile.read(folder / row["file"], dtype="float32")[0] for row in rows]
    return sounds, np.array([row["label"] for row in rows]), np.array([row["gearbox"] for row in rows])


def left_out_accuracy(values: np.ndarray, labels: np.ndarray, groups: np.ndarray) -> float:
    right = 0
    for group in np.unique(groups):
        out = groups == group
        right += int((nearest(values[~out], labels[~out], values[out]) == labels[out]).sum())
    return right / labels.size


@pytest.mark.parametrize(
    ("name", "duration_s", "noise", "least"),
    [
        ("as recorded", 20.0, 0.0, 0.95),
        ("half as long", 10.0, 0.0, 0.95),
        ("a quarter as long, less than one cycle", 5.0, 0.0, 0.75),
        ("white noise of a third of the signal", 20.0, 0.33, 0.95),
        ("white noise as loud as the signal", 20.0, 1.0, 0.7),
    ],
)
def test_two_physical_features_tell_notch_from_play_on_gearboxes_never_seen(
    name: str, duration_s: float, noise: float, least: float
) -> None:
    sounds, labels, groups = joints()
    rng = np.random.default_rng(0)
    values = []
    for samples in sounds:
        middle = (samples.size - int(duration_s * 8000)) // 2
        piece = samples[middle : middle + int(duration_s * 8000)]
        piece = piece + (noise * samples.std() * rng.normal(size=piece.size)).astype(np.float32)
        values.append(extract(Recording(piece, 8000.0)).features.values[BUMPS])
    accuracy = left_out_accuracy(np.array(values), labels, groups)
    print(f"\nleave one gearbox out, play and notch bump, 1-NN, {name}: {accuracy:.2f}")
    assert accuracy >= least
