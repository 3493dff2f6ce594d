"""Cases whose features are known exactly, because they are made here."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from sqlalchemy.orm import Session

from casebase.description import Labelling, RecordingDescription
from casebase.library import CaseLibrary
from casebase.reasoning.novelty import kinds
from casebase.search.case_table import CaseTable
from casebase.store.models import Case, StoredRecording
from signals.condition import OperatingCondition
from signals.features import EXTRACTOR_VERSION, Extraction, FeatureVector, catalogue
from signals.motion import Motion
from signals.recording import Recording

VERSION = "made"
OF_THE_GEAR = [name for name, kind in zip(catalogue(), kinds(tuple(catalogue())), strict=True) if kind >= 0]
MARKS = "notch_bump_12_200_hz", "play_bump_12_200_hz"
NAMES = (*MARKS, *(name for name in OF_THE_GEAR if "bump" in name and name not in MARKS))
"""Features of one kind, those that mark a notch and play first."""


def extraction(values: Sequence[float], *, version: str = VERSION) -> Extraction:
    """Return an extraction with these values of the first of NAMES."""
    vector = FeatureVector(NAMES[: len(values)], np.array(values, dtype=np.float32))
    return Extraction(vector, (), Motion(), (), version)


def recording(seed: int) -> Recording:
    """Return a short recording of noise."""
    samples = np.random.default_rng(seed).normal(scale=0.1, size=80).astype(np.float32)
    return Recording(samples, 8000.0)


def store(
    library: CaseLibrary,
    session: Session,
    values: Sequence[float],
    *,
    seed: int = 0,
    gearbox: str | None = "g0",
    axis: str | None = "axis",
    version: str = VERSION,
) -> StoredRecording:
    """Store a recording whose audio is noise of this seed and whose features are these values."""
    sound = recording(seed)
    description = RecordingDescription(
        file_name=f"{seed}.wav", axis=axis, gearbox=gearbox, condition=OperatingCondition(speed_rad_s=2.0)
    )
    return library.retain.recording(
        session, sound.samples.tobytes(), sound, extraction(values, version=version), description
    )


def add_case(
    library: CaseLibrary,
    session: Session,
    values: Sequence[float],
    label: str,
    *,
    seed: int,
    gearbox: str | None = "g0",
    origin: str = "measured",
) -> Case:
    """Store a recording and make it a case."""
    row = store(library, session, values, seed=seed, gearbox=gearbox)
    return library.retain.case(session, row, Labelling(label, origin=origin))


def heard_table(heard: Callable[[str, int], Extraction], boxes: int, axis: str = "axis", apart: int = 10) -> CaseTable:
    """Return cases of gearboxes, two of each label; seeds of a gearbox are `apart` from those of the next."""
    made = [
        (box, label, apart * box + i) for box in range(boxes) for label in ("normal", "notch", "play") for i in (0, 1)
    ]
    vectors = [heard(label, seed).features for _, label, seed in made]
    values = np.array([each.values for each in vectors])
    return measured_table(vectors[0].names, values, [label for _, label, _ in made], [box for box, _, _ in made], axis)


def measured_table(
    names: Sequence[str],
    values: NDArray[np.floating],
    labels: Sequence[str],
    gearboxes: Sequence[int],
    axis: str = "axis",
) -> CaseTable:
    """Return measured cases of this extractor, each of a sound of its own; values of shape (cases, n)."""
    ids = np.array([f"{row:032x}" for row in range(len(values))])
    origins, axes = np.array(["measured"] * len(values)), np.array([axis] * len(values))
    boxes = np.array([f"g{box}" for box in gearboxes])
    said = np.array(labels)
    return CaseTable(
        1, EXTRACTOR_VERSION, tuple(names), ids, said, origins, axes, boxes, ids, np.asarray(values, np.float32)
    )
