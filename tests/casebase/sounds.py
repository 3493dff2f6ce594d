"""Real WAV files for the tests, made here."""

from pathlib import Path

import numpy as np
import soundfile

from casebase.description import Labelling, RecordingDescription
from casebase.library import CaseLibrary
from casebase.store.models import Case
from signals.condition import OperatingCondition
from signals.features import extract
from signals.motion_profile import MotionProfile
from signals.reading.decode import read_recording

RATE_HZ = 8000
MOTION = MotionProfile("sine", 3.0, 2.5)


def write_sound(path: Path, seed: int, *, duration_s: float = 3.0) -> Path:
    """Write noise with a click every half second and return its path."""
    generator = np.random.default_rng(seed)
    samples = 0.05 * generator.normal(size=int(duration_s * RATE_HZ))
    samples[:: RATE_HZ // 2] += 0.5
    soundfile.write(path, samples.astype(np.float32), RATE_HZ, subtype="PCM_16")
    return path


def add_sound(
    library: CaseLibrary, path: Path, label: str, *, gearbox: str = "g0", verified_by: str = "opened"
) -> Case:
    """Decode, extract, store and retain one file."""
    recording = read_recording(path)
    condition = OperatingCondition(speed_rad_s=2.5, payload_kg_m2=40.0, motion=MOTION)
    description = RecordingDescription(path.name, axis="axis-a", gearbox=gearbox, condition=condition)
    extraction = extract(recording, condition)
    with library.transaction("anna") as session:
        row = library.retain.recording(session, path, recording, extraction, description)
        return library.retain.case(session, row, Labelling(label, verified_by=verified_by))
