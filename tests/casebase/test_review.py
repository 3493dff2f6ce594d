"""Severity and review: on vectors made for the purpose, whose right answer is known."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.cli import run
from casebase.description import Labelling, RecordingDescription
from casebase.errors import InvalidRequestError, NotFoundError
from casebase.library import CaseLibrary
from casebase.reasoning.severity import _left_out, estimate
from casebase.review import apply, quarantine_far, review, undo
from signals.condition import UNKNOWN, OperatingCondition
from signals.features import EXTRACTOR_VERSION, Extraction, FeatureVector, catalogue
from signals.motion import Motion
from signals.recording import Recording
from sim.description.axis_document import write_axis
from sim.experiment.paper_axis import PAPER_AXIS

NAMES = tuple(catalogue())


def test_a_size_that_the_features_follow_is_found_within_a_quarter() -> None:
    random = np.random.default_rng(0)
    sizes = np.exp(random.uniform(np.log(2e-4), np.log(3e-3), 200))
    direction = random.standard_normal(len(NAMES))
    known = random.standard_normal((200, len(NAMES))) * 0.3 + np.log(sizes)[:, None] * direction
    errors, covered = [], 0
    for row in range(0, 200, 8):
        rest = np.arange(200) != row
        found = estimate("gap_rad", known[rest], sizes[rest], known[row])
        assert found is not None
        errors.append(abs(found.value / sizes[row] - 1))
        covered += found.low <= sizes[row] <= found.high
    assert np.median(errors) < 0.25
    assert covered >= 20, "nine of ten of 25 intervals hold the truth"


def test_errors_are_those_without_the_specimen() -> None:
    """The closed form by blocks is what a fit without the block's cases would have said."""
    random = np.random.default_rng(4)
    points, target = random.standard_normal((12, 3)), random.standard_normal(12)
    kernel = points @ points.T + np.eye(12)
    inverse = np.asarray(np.linalg.inv(kernel), dtype=np.float64)
    blocks = [np.arange(first, first + 3) for first in range(0, 12, 3)]
    errors = _left_out(inverse, inverse @ target, blocks)
    for block in blocks:
        rest = np.setdiff1d(np.arange(12), block)
        said = kernel[np.ix_(block, rest)] @ np.linalg.solve(kernel[np.ix_(rest, rest)], target[rest])
        np.testing.assert_allclose(errors[block], target[block] - said, atol=1e-9)


def _add(
    library: CaseLibrary,
    values: np.ndarray,
    label: str,
    origin: str,
    gearbox: str,
    number: int,
    condition: OperatingCondition = UNKNOWN,
) -> str:
    samples = np.random.default_rng(number).standard_normal(800).astype(np.float32)
    extraction = Extraction(FeatureVector(NAMES, values.astype(np.float32)), (), Motion(), (), EXTRACTOR_VERSION)
    with library.transaction("test") as session:
        description = RecordingDescription(file_name=f"{number}.wav", gearbox=gearbox, condition=condition)
        row = library.retain.recording(session, samples.tobytes(), Recording(samples, 8000.0), extraction, description)
        return library.retain.case(session, row, Labelling(label, origin=origin)).id


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
        found = review(session, library.reuse.reasoner(session))
    assert wrong in {each.case_id for each in found.suspect}
    assert away in {each.case_id for each in found.far}
    assert found.plan == {"normal": 14, "notch": 13}, "twenty simulated cases of each label"
    with library.transaction("test") as session:
        version = apply(library, session, found, "far").version
        assert "away" in str(library.retrieve.case(session, away).quarantine_reason)
    with library.reading() as session:
        assert away not in set(library.reuse.reasoner(session).table.ids.tolist())
    with library.transaction("test") as session:
        assert undo(library, session, version) >= 1
        assert library.retrieve.case(session, away).quarantine_reason is None
    with library.transaction("test") as session:
        with pytest.raises(InvalidRequestError, match="nothing redundant"):
            apply(library, session, found, "redundant")
        with pytest.raises(NotFoundError):
            undo(library, session, 99)
    assert quarantine_far(library, "test") == len(found.far), "what generation does by itself is the same edit"
    with library.reading() as session:
        assert library.retrieve.case(session, away).quarantine_reason is not None
    library.close()


def test_holes_become_a_plan_that_generate_fills(
    library: CaseLibrary, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    random, number = np.random.default_rng(3), 0
    for payload, speed in ((20.0, 2.1), (50.0, 2.8)):
        number += 1
        there = OperatingCondition(speed_rad_s=speed, payload_kg_m2=payload)
        _add(library, random.standard_normal(len(NAMES)), "normal", "measured", "g1", number, there)
    for _ in range(20):
        number += 1
        there = OperatingCondition(speed_rad_s=2.1, payload_kg_m2=20.0)
        _add(library, random.standard_normal(len(NAMES)), "normal", "simulated", "", number, there)
    library.close()
    axis, plan = tmp_path / "axis.toml", tmp_path / "plan.json"
    axis.write_text(write_axis(PAPER_AXIS))
    command = ["--data-dir", str(tmp_path), "--json"]
    assert run([*command, "cases", "review", "--plan", str(plan)]) == 0
    assert json.loads(capfd.readouterr().out)["plan"]["campaigns"] == json.loads(plan.read_text())["campaigns"]
    wanted = ["generate", "--axis", str(axis), "--plan", str(plan), "--duration", "3", "--processes", "1"]
    assert run([*command, *wanted]) == 0
    assert json.loads(capfd.readouterr().out)["new"] == 4
    again = CaseLibrary.open(tmp_path)
    with again.reading() as session:
        assert review(session, again.reuse.reasoner(session)).uncovered == ()
    again.close()
