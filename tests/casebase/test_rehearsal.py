"""Disturbed copies of the library's own recordings: the same ones each time, and of all that can still be heard."""

from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from casebase.augmentation import AUGMENTATIONS, PEAK, disturbed_copies
from casebase.learning import LearningStoppedError
from casebase.rehearsal import MOST_REHEARSED, rehearsed

from casebase.case_table import load_table
from casebase.library import CaseLibrary
from casebase.models import Case
from casebase.signals.features import EXTRACTOR_VERSION
from casebase.signals.recording import Recording
from tests.casebase.signals.synthetic import RATE_HZ, Joint, sound
from tests.casebase.sounds import add_sound, write_sound

RECORDING = Recording(sound(Joint("notch", seed=1, duration_s=8.0)), RATE_HZ)


def test_copies_are_the_same_each_time_and_no_two_alike() -> None:
    first, again = disturbed_copies(RECORDING), disturbed_copies(replace(RECORDING, samples=RECORDING.samples.copy()))
    assert len(first) == len(AUGMENTATIONS)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.samples, other.samples)
    assert len({copy.sha256 for copy in (*first, RECORDING)}) == len(first) + 1


def test_copies_differ_from_the_original_by_more_than_gain() -> None:
    for copy in disturbed_copies(RECORDING):
        assert np.abs(copy.samples).max() == pytest.approx(PEAK, abs=1e-3)
        if copy.samples.size == RECORDING.samples.size:
            alike = np.corrcoef(copy.samples, RECORDING.samples)[0, 1]
            assert alike < 0.9999


def test_two_recordings_are_not_disturbed_alike() -> None:
    other = replace(RECORDING, samples=RECORDING.samples[::-1].copy())
    sizes = [{copy.samples.size for copy in disturbed_copies(each)} for each in (RECORDING, other)]
    assert sizes[0] != sizes[1]


def test_silence_is_no_division_by_nothing() -> None:
    for copy in disturbed_copies(Recording(np.zeros(16000, np.float32), RATE_HZ)):
        assert np.isfinite(copy.samples).all()


@pytest.fixture
def filled(sqlite_library: CaseLibrary, tmp_path: Path) -> tuple[CaseLibrary, list[Case]]:
    """A library of three cases with sound."""
    paths = [write_sound(tmp_path / f"{seed}.wav", seed) for seed in range(3)]
    return sqlite_library, [add_sound(sqlite_library, path, "normal", gearbox=path.stem) for path in paths]


def test_every_case_is_rehearsed_in_every_way(filled: tuple[CaseLibrary, list[Case]]) -> None:
    library, cases = filled
    with library.reading() as session:
        table = load_table(session, EXTRACTOR_VERSION)
        found, again = (rehearsed(session, library.audio, table) for _ in range(2))
    assert set(found.rows.tolist()) == {0, 1, 2}
    assert found.values.shape == (found.rows.size, len(table.names))
    assert found.rows.size <= len(cases) * len(AUGMENTATIONS)
    np.testing.assert_array_equal(found.values, again.values)
    assert not any((value == table.values[row]).all() for row, value in zip(found.rows, found.values, strict=True))


def test_audio_that_is_gone_is_passed_over(filled: tuple[CaseLibrary, list[Case]]) -> None:
    """Erased, or destroyed on the disk."""
    library, _ = filled
    with library.reading() as session:
        table = load_table(session, EXTRACTOR_VERSION)
        rows = [library.retrieve.case(session, str(key)).recording for key in table.ids]
    library.audio.path(rows[0].file_sha256).unlink()
    library.audio.path(rows[1].file_sha256).write_bytes(b"no sound any more")
    with library.reading() as session:
        assert set(rehearsed(session, library.audio, table).rows.tolist()) == {2}
    library.audio.path(rows[2].file_sha256).unlink()
    with library.reading() as session:
        nothing = rehearsed(session, library.audio, table)
    assert nothing.values.shape == (0, len(table.names))


def test_it_stops_where_it_is_asked_to(filled: tuple[CaseLibrary, list[Case]]) -> None:
    library, _ = filled
    stop = Event()
    stop.set()
    with library.reading() as session, pytest.raises(LearningStoppedError):
        rehearsed(session, library.audio, load_table(session, EXTRACTOR_VERSION), stop)


def test_of_many_cases_some_of_all_are_rehearsed(
    filled: tuple[CaseLibrary, list[Case]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The number is bounded, for each costs as much as ten recordings do."""
    assert MOST_REHEARSED < 100
    library, _ = filled
    monkeypatch.setattr("casebase.rehearsal.MOST_REHEARSED", 2)
    with library.reading() as session:
        table = load_table(session, EXTRACTOR_VERSION)
        assert set(rehearsed(session, library.audio, table).rows.tolist()) == {0, 2}
