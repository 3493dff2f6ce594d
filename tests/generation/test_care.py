"""Severity and review: on vectors made for the purpose, whose right answer is known."""

from pathlib import Path

import numpy as np
import pytest

from casebase.description import Labelling, RecordingDescription
from casebase.errors import InvalidRequestError, NotFoundError
from casebase.library import CaseLibrary
from casebase.review import apply, review, undo
from casebase.severity import estimate
from casebase.signals.features import EXTRACTOR_VERSION, Extraction, FeatureVector, catalogue
from casebase.signals.motion import Motion
from casebase.signals.recording import Recording

NAMES = tuple(catalogue())


def test_a_size_that_the_features_follow_is_found_within_a_quarter() -> None:
    random = np.random.default_rng(0)
    sizes = np.exp(random.uniform(np.log(2e-4), np.log(3e-3), 200))
    direction = random.standard_normal(len(NAMES))
    known = random.standard_normal((200, len(NAMES))) * 0.3 + np.log(sizes)[:, None] * direction
    errors, covered = [], 0
    for row in range(0, 200, 4):
        rest = np.arange(200) != row
        found = estimate("gap_rad", known[rest], sizes[rest], known[row])
        assert found is not None
        errors.append(abs(found.value / sizes[row] - 1))
        covered += found.low <= sizes[row] <= found.high
    assert np.median(errors) < 0.25
    assert 40 <= covered <= 50, "nine of ten intervals hold the truth"


def test_features_that_say_nothing_give_a_wide_interval() -> None:
    random = np.random.default_rng(1)
    sizes = np.exp(random.uniform(np.log(2e-4), np.log(3e-3), 100))
    found = estimate("gap_rad", random.standard_normal((100, len(NAMES))), sizes, random.standard_normal(len(NAMES)))
    assert found is not None
    assert found.high / found.low > 5


def _add(library: CaseLibrary, values: np.ndarray, label: str, origin: str, gearbox: str, number: int) -> str:
    samples = np.random.default_rng(number).standard_normal(800).astype(np.float32)
    extraction = Extraction(FeatureVector(NAMES, values.astype(np.float32)), (), Motion(), (), EXTRACTOR_VERSION)
    with library.transaction("test") as session:
        description = RecordingDescription(file_name=f"{number}.wav", gearbox=gearbox)
        row = library.store_recording(session, samples.tobytes(), Recording(samples, 8000.0), extraction, description)
        return library.retain(session, row, Labelling(label, origin=origin)).id


@pytest.fixture
def library(tmp_path: Path) -> CaseLibrary:
    return CaseLibrary.open(tmp_path)


def test_review_finds_what_was_put_there_and_edits_can_be_undone(library: CaseLibrary) -> None:
    random = np.random.default_rng(2)
    middle = {"normal": np.zeros(len(NAMES)), "notch": np.full(len(NAMES), 8.0)}
    number = 0
    for label, centre in middle.items():
        for gearbox in range(6):
            number += 1
            _add(library, centre + random.standard_normal(len(NAMES)), label, "measured", f"g{gearbox}", number)
            number += 1
            _add(library, centre + random.standard_normal(len(NAMES)), label, "simulated", "", number)
    wrong = _add(library, middle["notch"] + random.standard_normal(len(NAMES)), "normal", "measured", "g9", 100)
    away = _add(library, np.full(len(NAMES), 60.0), "notch", "simulated", "", 101)
    with library.reading() as session:
        found = review(session, library.reasoner(session))
    assert wrong in {each.case_id for each in found.suspect}
    assert away in {each.case_id for each in found.far}
    assert found.plan == {"normal": 14, "notch": 13}, "twenty simulated cases of each label"
    with library.transaction("test") as session:
        version = apply(library, session, found, "far").version
        assert "away" in str(library.case(session, away).quarantine_reason)
    with library.reading() as session:
        assert away not in set(library.reasoner(session).table.ids.tolist())
    with library.transaction("test") as session:
        assert undo(library, session, version) >= 1
        assert library.case(session, away).quarantine_reason is None
    with library.transaction("test") as session:
        with pytest.raises(InvalidRequestError, match="nothing redundant"):
            apply(library, session, found, "redundant")
        with pytest.raises(NotFoundError):
            undo(library, session, 99)
    library.close()
