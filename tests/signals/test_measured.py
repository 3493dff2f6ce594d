"""Two physical features alone tell faults of measured gearboxes that were never seen."""

import csv

import numpy as np
import pytest
import soundfile

from signals.features import catalogue, extract
from signals.recording import Recording
from tests.shared_data import shared

NAMES = list(catalogue())
BUMPS = [NAMES.index("play_bump_12_200_hz"), NAMES.index("notch_bump_12_200_hz")]


def nearest(train: np.ndarray, labels: np.ndarray, test: np.ndarray) -> np.ndarray:
    """Return the label of the nearest standardised neighbour of every test row."""
    mean, scale = train.mean(axis=0), train.std(axis=0)
    train, test = ((rows - mean) / scale for rows in (train, test))
    return labels[((test[:, None] - train[None]) ** 2).sum(axis=2).argmin(axis=1)]


@pytest.mark.parametrize(
    ("duration_s", "noise", "least"),
    [(20.0, 0.0, 0.95), (10.0, 0.0, 0.95), (5.0, 0.0, 0.75), (20.0, 0.33, 0.95), (20.0, 1.0, 0.7)],
    ids=["whole", "half", "less than one cycle", "noise of a third of the signal", "noise as loud as the signal"],
)
def test_two_physical_features_tell_notch_from_play_on_gearboxes_never_seen(
    duration_s: float, noise: float, least: float
) -> None:
    folder = shared("data", "axis_recordings")
    with (folder / "manifest.csv").open() as file:
        rows = list(csv.DictReader(file))
    labels, groups = np.array([row["label"] for row in rows]), np.array([row["gearbox"] for row in rows])
    rng, values = np.random.default_rng(0), np.empty((len(rows), len(BUMPS)))
    for place, row in enumerate(rows):
        samples, _ = soundfile.read(folder / row["file"], dtype="float32")
        middle = (samples.size - int(duration_s * 8000)) // 2
        piece = samples[middle : middle + int(duration_s * 8000)]
        piece = piece + (noise * samples.std() * rng.normal(size=piece.size)).astype(np.float32)
        values[place] = extract(Recording(piece, 8000.0)).features.values[BUMPS]
    found = np.empty_like(labels)
    for group in np.unique(groups):
        out = groups == group
        found[out] = nearest(values[~out], labels[~out], values[out])
    assert np.mean(found == labels) >= least
