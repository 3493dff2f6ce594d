"""Diagnosis of sound that was stored with loss, by a library of sound that was not.

Needs the measured data (GEARCASE_SHARED, default `../shared` beside the checkout). Every recording is stored by each
codec and read back as an upload is; the library has the recordings of the other gearboxes as they were.
"""

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks import Row
from benchmarks.diagnosis import Sound, axis_sounds
from benchmarks.encoded_sounds import encode
from casebase.reasoning.diagnosis import Reasoner
from casebase.search.case_table import CaseTable
from signals.features import EXTRACTOR_VERSION, Extraction, catalogue, extract
from signals.reading.decode import read_recording
from signals.recording import Recording

CODECS = {
    "MP3, 64 kbit/s, 48 kHz": ("mp3", "libmp3lame", 64_000, 48_000),
    "AAC, 64 kbit/s, 48 kHz": ("mp4", "aac", 64_000, 48_000),
    "Opus, 24 kbit/s": ("ogg", "libopus", 24_000, 48_000),
    "AMR, 12.2 kbit/s": ("amr", "libopencore_amrnb", 12_200, 8000),
    "mu-law": ("wav", "pcm_mulaw", None, 8000),
    "ADPCM": ("wav", "adpcm_ima_wav", None, 8000),
}
"""Container, codec, bit rate and sample rate, by what is printed."""


def run() -> list[Row]:
    """Return, by codec, how many labels are those of the recording as it was, and how many verdicts are wrong."""
    sounds = axis_sounds()
    labels = np.array([each.label for each in sounds])
    gearboxes = np.array([each.group for each in sounds])
    recorded = [each.extraction() for each in sounds]
    whole = np.array([each.features.values for each in recorded])
    reasoners = {name: reasoner(whole, labels, gearboxes, gearboxes != name) for name in np.unique(gearboxes)}

    def said(found: Sequence[Extraction]) -> tuple[NDArray[np.str_], NDArray[np.bool_]]:
        """The most probable label of each recording, and whether the verdict names it."""
        judged = [reasoners[name].judge(each.features.values) for name, each in zip(gearboxes, found, strict=True)]
        best = np.array([each.best.label for each in judged])
        verdicts = [each.verdict(one.poor) for each, one in zip(judged, found, strict=True)]
        return best, np.array(verdicts) == "diagnosed"

    before, _ = said(recorded)
    rows = [Row("as recorded", 0.0, note=f"{int((before == labels).sum())} of {labels.size} labels right")]
    with TemporaryDirectory() as folder:
        for name in CODECS:
            start = time.perf_counter()
            after, named = said([coded(sound, Path(folder) / "sound", name) for sound in sounds])
            seconds = (time.perf_counter() - start) / labels.size
            kept, wrong = int((after == before).sum()), int((named & (after != labels)).sum())
            note = f"{kept} of {labels.size} labels kept; verdict diagnosed {int(named.sum())}, {wrong} of them wrong"
            rows.append(Row(name, seconds, note=note))
    return rows


def reasoner(
    values: NDArray[np.float32], labels: NDArray[np.str_], gearboxes: NDArray[np.str_], rows: NDArray[np.bool_]
) -> Reasoner:
    """What a library of the recordings in `rows` says."""
    ids = np.array([f"{number:06d}" for number in range(labels.size)])
    column = partial(np.full, labels.size)
    table = CaseTable(
        1,
        EXTRACTOR_VERSION,
        tuple(catalogue()),
        ids,
        labels,
        column("measured"),
        column("axis"),
        gearboxes,
        ids,
        values,
    ).take(rows)
    return Reasoner(table)


def coded(sound: Sound, path: Path, name: str) -> Extraction:
    """Features of a sound after it was stored by a codec."""
    container, codec, bit_rate, rate = CODECS[name]
    samples = Recording(sound.samples, sound.rate_hz).resampled(rate).samples
    recording = read_recording(encode(path, samples, rate, container, codec, bit_rate))
    return extract(recording, sound.condition)
