"""One sound is one case, counts once, and says so when it is asked again."""

from pathlib import Path

import pytest
import soundfile

from casebase.description import Labelling, RecordingDescription
from casebase.errors import DuplicateError
from casebase.library import CaseLibrary
from casebase.review import apply, review
from casebase.search.case_filter import CaseFilter
from casebase.store.bundle import export_cases, import_cases
from casebase.store.models import Case, StoredDiagnosis
from signals.condition import OperatingCondition
from signals.features import extract
from signals.reading.decode import read_recording
from tests.casebase.sounds import RATE_HZ, add_sound, write_sound

CONDITION = OperatingCondition(speed_rad_s=2.5, payload_kg_m2=40.0)


def copy_of(path: Path, name: str, gain: float = 0.5) -> Path:
    """Write the same sound more quietly in another container and return its path."""
    samples, _ = soundfile.read(path, dtype="float32")
    soundfile.write(path.with_name(name), gain * samples, RATE_HZ, subtype="PCM_24")
    return path.with_name(name)


def add_unasked(library: CaseLibrary, path: Path, label: str, gearbox: str) -> Case:
    """Make a case whatever there is of the same sound, as generated cases and older libraries do."""
    recording = read_recording(path)
    description = RecordingDescription(path.name, axis="axis-a", gearbox=gearbox, condition=CONDITION)
    with library.transaction("anna") as session:
        row = library.retain.recording(session, path, recording, extract(recording, CONDITION), description)
        return library.retain.case(session, row, Labelling(label, key=path.name))


def diagnosed(library: CaseLibrary, path: Path) -> StoredDiagnosis:
    recording = read_recording(path)
    extraction = extract(recording, CONDITION)
    with library.transaction("otto") as session:
        row = library.retain.recording(session, path, recording, extraction, RecordingDescription(path.name))
        return library.reuse.diagnose(session, row, extraction)


def test_a_copy_is_the_case_that_is_there(library: CaseLibrary, tmp_path: Path) -> None:
    path = write_sound(tmp_path / "a.wav", 1)
    case = add_sound(library, path, "notch", gearbox="g1")
    assert add_sound(library, copy_of(path, "a.flac"), "notch", gearbox="g1").id == case.id
    other = add_sound(library, write_sound(tmp_path / "b.wav", 2), "notch", gearbox="g1")
    assert other.id != case.id


@pytest.mark.parametrize(("label", "gearbox"), [("normal", "g1"), ("notch", "g2")])
def test_a_copy_with_another_label_or_gearbox_is_refused_with_the_case(
    library: CaseLibrary, tmp_path: Path, label: str, gearbox: str
) -> None:
    path = write_sound(tmp_path / "a.wav", 1)
    case = add_sound(library, path, "notch", gearbox="g1")
    with pytest.raises(DuplicateError, match=case.id) as caught:
        add_sound(library, copy_of(path, "a.flac"), label, gearbox=gearbox)
    assert (caught.value.case_id, caught.value.label, caught.value.gearbox) == (case.id, "notch", "g1")


def test_a_copy_has_one_vote_and_contradicting_ones_have_none(library: CaseLibrary, tmp_path: Path) -> None:
    agreed, disputed = write_sound(tmp_path / "a.wav", 1), write_sound(tmp_path / "b.wav", 2)
    kept = add_unasked(library, agreed, "notch", "g1")
    for number in range(3):
        add_unasked(library, copy_of(agreed, f"a{number}.flac", 0.3 + 0.1 * number), "notch", "g1")
    add_unasked(library, disputed, "play", "g2")
    add_unasked(library, copy_of(disputed, "b.flac"), "normal", "g2")
    with library.reading() as session:
        assert library.retrieve.table(session).ids.tolist() == [kept.id]
        assert len(library.retrieve.cases(session, CaseFilter()).items) == 6
    remarks = diagnosed(library, write_sound(tmp_path / "c.wav", 3)).document["remarks"]
    assert any("2 cases do not count" in each for each in remarks)  # type: ignore[attr-defined]


def test_a_contradiction_that_is_settled_counts_again(library: CaseLibrary, tmp_path: Path) -> None:
    path = write_sound(tmp_path / "a.wav", 1)
    case = add_unasked(library, path, "notch", "g1")
    other = add_unasked(library, copy_of(path, "a.flac"), "normal", "g1")
    with library.reading() as session:
        assert len(library.retrieve.table(session)) == 0
    with library.transaction("anna") as session:
        library.revise.retire(session, other.id)
    with library.reading() as session:
        assert library.retrieve.table(session).ids.tolist() == [case.id]


def test_the_review_lists_every_contradiction_and_every_copy(library: CaseLibrary, tmp_path: Path) -> None:
    path = write_sound(tmp_path / "a.wav", 1)
    cases = [
        add_unasked(library, path, "play", "g0"),
        add_unasked(library, copy_of(path, "a.flac"), "normal", "g98"),
        add_unasked(library, copy_of(path, "b.flac", 0.4), "play", "g97"),
        add_unasked(library, copy_of(path, "c.flac", 0.3), "play", "g0"),
    ]
    first, other_label, other_box, copy = (case.id for case in cases)
    with library.transaction("anna") as session:
        found = review(session, library.reuse.reasoner(session))
        pairs = {frozenset((each.case_id, str(each.other_id))) for each in found.contradictory}
        assert pairs == {
            frozenset(pair)
            for pair in (
                (first, other_label),
                (first, other_box),
                (other_label, other_box),
                (other_label, copy),
                (other_box, copy),
            )
        }
        reasons = {each.other_id: each.reason for each in found.contradictory if each.case_id == first}
        assert "normal" in reasons[other_label]
        assert "gearbox g97" in reasons[other_box]
        assert [(each.case_id, each.other_id) for each in found.redundant] == [(copy, first)]
        apply(library, session, found, "redundant")
        assert library.retrieve.case(session, copy).state == "retired"


def test_a_query_that_is_in_the_library_says_which_case_it_is_and_does_not_vote_for_itself(
    library: CaseLibrary, tmp_path: Path
) -> None:
    paths = [write_sound(tmp_path / f"{seed}.wav", seed) for seed in range(6)]
    labels = ("normal", "normal", "normal", "notch", "normal", "normal")
    cases = [add_sound(library, path, label) for path, label in zip(paths, labels, strict=True)]
    case = cases[3]
    document = diagnosed(library, copy_of(paths[3], "again.flac")).document
    assert document["recording"]["same_as_case"] == case.id  # type: ignore[index]
    assert f"this is case {case.id} (notch, gearbox g0)" in document["remarks"]  # type: ignore[operator]
    assert document["label"] != "notch", "no other case is a notch"
    new = diagnosed(library, write_sound(tmp_path / "new.wav", 9)).document
    assert new["recording"]["same_as_case"] is None  # type: ignore[index]


def test_a_bundle_with_copies_is_taken_but_for_those(library: CaseLibrary, tmp_path: Path) -> None:
    path = write_sound(tmp_path / "a.wav", 1)
    there = CaseLibrary.open(tmp_path / "there")
    add_sound(there, copy_of(path, "a.flac"), "normal", gearbox="g1")
    add_sound(there, write_sound(tmp_path / "b.wav", 2), "normal", gearbox="g1")
    with there.reading() as session:
        export_cases(there, session, tmp_path / "all.zip", CaseFilter())
    there.close()
    case = add_sound(library, path, "notch", gearbox="g1")
    done = import_cases(library, tmp_path / "all.zip", "bert")
    assert len(done.case_ids) == 1
    assert [case.id in reason for reason in done.refused.values()] == [True]
