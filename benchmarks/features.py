"""All features of a 30 s, 8 kHz recording, against one scipy spectrogram and librosa's comparable subset."""

import tempfile
from pathlib import Path

import librosa
import numpy as np
import soundfile
from scipy import signal

from benchmarks import Row, best_seconds
from signals.features import catalogue, extract
from signals.reading.decode import read_recording, warm_up
from signals.recording import Recording

RATE_HZ = 8000
SECONDS = 30


def back_and_forth(seed: int = 0) -> np.ndarray:
    """Return the sound of a joint that reverses every 3.1 s and knocks once per cycle, shape (240000,)."""
    rng = np.random.default_rng(seed)
    time = np.arange(SECONDS * RATE_HZ) / RATE_HZ
    speed = np.minimum(1, np.abs((time % 3.1) - 1.55) / 0.35 + 0.05)
    samples = 0.05 * speed * rng.normal(size=time.size)
    for start in np.arange(0.4, SECONDS - 0.1, 6.2):
        since = time - start
        samples += 0.1 * (since >= 0) * np.exp(-np.maximum(since, 0) / 0.02) * np.sin(2 * np.pi * 55 * since)
    return samples.astype(np.float32)


def librosa_subset(samples: np.ndarray) -> tuple[np.ndarray, ...]:
    """Level, band energies, onset strength and its autocorrelation: what librosa has of the same kind."""
    level = librosa.feature.rms(y=samples, frame_length=512, hop_length=128)
    bands = librosa.feature.melspectrogram(y=samples, sr=RATE_HZ, n_fft=512, hop_length=128, n_mels=16)
    onset = librosa.onset.onset_strength(S=librosa.power_to_db(bands), sr=RATE_HZ, hop_length=128)
    flatness = librosa.feature.spectral_flatness(y=samples, n_fft=512, hop_length=128)
    return level, bands, flatness, librosa.autocorrelate(onset)


def run() -> list[Row]:
    """Measure features, spectrogram, librosa and decoding in turns."""
    samples = back_and_forth()
    recording = Recording(samples, float(RATE_HZ))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.wav"
        soundfile.write(path, samples, RATE_HZ, subtype="PCM_16")
        warm_up()
        ours, spectrogram = f"extract: {len(catalogue())} features, quality, motion, events", "scipy spectrogram"
        worker, direct = "decode in the worker, checked", "soundfile.read in process"
        seconds = best_seconds(
            {
                spectrogram: lambda: signal.spectrogram(samples, RATE_HZ, nperseg=512, noverlap=384),
                ours: lambda: extract(recording),
                "librosa: level, 16 bands, flatness, onset, autocorrelation": lambda: librosa_subset(samples),
                direct: lambda: soundfile.read(path, dtype="float32"),
                worker: lambda: read_recording(path),
            }
        )
    notes = {ours: "target: at most 3"}
    reference = {worker: direct, direct: direct}
    return [
        Row(name, taken, taken / seconds[against], against, notes.get(name, ""))
        for name, taken in seconds.items()
        for against in [reference.get(name, spectrogram)]
    ]
