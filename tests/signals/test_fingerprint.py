"""One sound is known again in another container, at another rate, gain and beginning; another recording is not."""

import csv
import io
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import soundfile
import soxr
from numpy.typing import NDArray

from benchmarks.harness.sounds import hum
from signals.fingerprint import LARGEST_DIFFERENCE, difference, fingerprints, same_samples
from signals.reading.decode import read_recording
from signals.recording import Recording
from tests.shared_data import shared

RATE_HZ = 8000
Samples = NDArray[np.float32]
Change = Callable[[Samples], tuple[Samples, float]]


def alike(known: Recording, heard: Recording) -> bool:
    """Whether one is found by a word of the other, and taken for the same."""
    return looked_up(known, heard) and same_samples(heard, known)


def looked_up(known: Recording, heard: Recording) -> bool:
    """Whether the fingerprints have a word in common and differ in few bits."""
    first, others = fingerprints(known)[0], fingerprints(heard)
    found = set(first.keys) & {word for each in others for word in each.keys}
    return bool(found) and min(difference(each.words, first.words) for each in others) <= LARGEST_DIFFERENCE


def at(rate_hz: int) -> Change:
    return lambda samples: (soxr.resample(samples, RATE_HZ, rate_hz), float(rate_hz))


def coded(container: str, subtype: str, rate_hz: int) -> Change:
    def change(samples: Samples) -> tuple[Samples, float]:
        file = io.BytesIO()
        soundfile.write(file, soxr.resample(samples, RATE_HZ, rate_hz), rate_hz, format=container, subtype=subtype)
        file.seek(0)
        again, rate = soundfile.read(file, dtype="float32")
        return again, float(rate)

    return change


def noise(samples: Samples, level: float) -> Samples:
    random = np.random.default_rng(5)
    return samples + (level * samples.std() * random.normal(size=samples.size)).astype(np.float32)


CHANGES: dict[str, Change] = {
    "48 kHz": at(48_000),
    "44.1 kHz": at(44_100),
    "16 kHz": at(16_000),
    "-34 dB at 16 bit": lambda samples: (np.round(samples * 0.02 * 32768) / np.float32(32768), RATE_HZ),
    "inverted": lambda samples: (-samples, RATE_HZ),
    "dithered": lambda samples: (noise(samples, 1e-3), RATE_HZ),
    "noise 34 dB below": lambda samples: (noise(samples, 0.02), RATE_HZ),
    "beginning cut": lambda samples: (samples[2961:], RATE_HZ),
    "end cut": lambda samples: (samples[:-4000], RATE_HZ),
    "silence before": lambda samples: (np.concatenate([np.zeros(4001, np.float32), samples]), RATE_HZ),
    "Ogg Vorbis": coded("OGG", "VORBIS", 32_000),
    "MP3": coded("MP3", "MPEG_LAYER_III", 32_000),
}


@pytest.mark.parametrize("name", CHANGES)
def test_the_same_sound_is_known_however_it_was_kept(name: str) -> None:
    path = shared("data", "axis_recordings")
    for file in sorted(path.glob("*.wav"))[::5]:
        known = read_recording(file)
        samples, rate_hz = CHANGES[name](known.samples)
        assert alike(known, Recording(samples.astype(np.float32), rate_hz)), file.name


def test_recordings_of_the_same_gearbox_in_the_same_motion_are_not_the_same_sound() -> None:
    folder = shared("data", "axis_recordings")
    with (folder / "manifest.csv").open() as file:
        assert sum(1 for _ in csv.DictReader(file)) >= 30
    words = [fingerprints(read_recording(path))[0].words for path in sorted(folder.glob("*.wav"))]
    assert min(difference(one, other) for one, other in combinations(words, 2)) > LARGEST_DIFFERENCE + 0.1


def meshes(seed: int, snr_db: float, *, together: bool) -> Recording:
    """Tones of two meshes in a motion to and fro of 4 s, and noise below them; `together`: the teeth meet as in all."""
    random = np.random.default_rng(seed)
    part = np.arange(20 * RATE_HZ) / RATE_HZ % 4.0
    speed = np.where(part < 2, 1, -1) * np.clip(np.minimum(part % 2, 2 - part % 2) / 0.4, 0, 1)
    turned = np.cumsum(speed) / RATE_HZ
    orders = [mesh * harmonic for mesh in (90, 317) for harmonic in range(1, 9)]
    phases = np.zeros(len(orders)) if together else random.uniform(0, 2 * np.pi, len(orders))
    tones = sum(np.cos(2 * np.pi * order * turned + phase) for order, phase in zip(orders, phases, strict=True))
    tones = tones * np.abs(speed)
    rough = 10 ** (-snr_db / 20) * np.std(tones) * random.normal(size=part.size)
    return Recording((0.02 * (tones + rough)).astype(np.float32), RATE_HZ)


@pytest.mark.parametrize(("together", "snr_db"), [(True, 30.0), (True, 60.0), (False, 60.0)])
def test_tones_of_one_motion_are_not_the_same_sound(together: bool, snr_db: float) -> None:
    """Eight of twelve independent recordings were refused as copies: with little noise, tones make the fingerprint."""
    recordings = [meshes(seed, snr_db, together=together) for seed in range(3)]
    pairs = list(combinations(recordings, 2))
    assert any(looked_up(*pair) for pair in pairs)
    assert not any(same_samples(*pair) for pair in pairs)


def test_a_piece_of_a_recording_is_another_recording() -> None:
    samples = hum(6.0, 2)
    assert not alike(Recording(samples, RATE_HZ), Recording(samples[: 2 * RATE_HZ], RATE_HZ))


@pytest.mark.parametrize(
    "samples",
    [
        np.zeros(5 * RATE_HZ, np.float32),
        np.ones(5 * RATE_HZ, np.float32),
        np.random.default_rng(0).normal(size=RATE_HZ // 2).astype(np.float32),
    ],
    ids=["silence", "constant", "half a second"],
)
def test_what_has_no_fine_structure_has_no_fingerprint(samples: Samples) -> None:
    assert fingerprints(Recording(samples, RATE_HZ)) == ()


def test_the_copies_from_the_field(tmp_path: Path) -> None:
    folder = shared("data", "field", "13-same-recording-twice")
    copies = [read_recording(path) for path in sorted(folder.glob("*.*")) if path.suffix != ".md"]
    assert len(copies) == 3
    assert all(alike(one, other) for one, other in combinations(copies, 2))
