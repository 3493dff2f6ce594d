"""What needs a person, and in which order; and what a case that is kept teaches."""

from functools import partial
from pathlib import Path

import numpy as np

from casebase.description import Labelling
from casebase.diagnoses import revise_diagnosis
from casebase.library import CaseLibrary
from casebase.queue import place_in, waiting
from casebase.reasoning.evaluation import Evaluation, Outcome, Proportion
from casebase.teaching import teaching
from tests.casebase.kept import keep
from tests.casebase.test_diagnoses import SIZE, diagnose, features, fill


def test_what_the_library_knows_least_stands_first_and_what_needs_nobody_is_not_there(library: CaseLibrary) -> None:
    fill(library)
    generator = np.random.default_rng(3)
    diagnose(library, features(generator, "normal"), seed=1)
    fault = diagnose(library, features(generator, "notch"), seed=2)
    between = diagnose(library, [4.0, 0.0, *[0.0] * (SIZE - 2)], seed=3)
    unlike = diagnose(library, [40.0, -40.0, *[0.0] * (SIZE - 2)], seed=4)
    named = {fault.recording_id}
    assert (fault.verdict, between.verdict, unlike.verdict) == ("diagnosed", "ambiguous", "not_in_library")
    with library.reading() as session:
        assert list(waiting(session, named)) == [unlike.id, between.id, fault.id]
        assert list(waiting(session, named, faults_first=True)) == [fault.id, between.id, unlike.id], "for a shift"
    again = diagnose(library, [40.0, -40.0, *[0.0] * (SIZE - 2)], seed=4)
    with library.reading() as session:
        assert list(waiting(session, named)) == [again.id, between.id, fault.id], "of a recording the newest diagnosis"
    with library.transaction("otto") as session:
        revise_diagnosis(session, fault.id, "confirmed")
        revise_diagnosis(session, again.id, "rejected")
        library.retain.diagnosis(session, between.id, label="notch")
        assert waiting(session, named) == {}


def test_the_work_for_the_queue_grows_as_the_library_does(tmp_path: Path) -> None:
    """Twice as many cases and twice as many that wait: about twice the steps of the database, not four times."""
    library, steps = CaseLibrary.open(tmp_path), []
    for _ in range(2):
        with library.transaction("test") as session:
            for each in range(100):
                recording = keep(session, "a", f"g{each}", None, {}, verdict="ambiguous" if each % 2 else "diagnosed")
                if not each % 2:
                    library.retain.case(session, recording, Labelling("normal"))
        with library.reading() as session:
            connection = session.connection().connection.driver_connection
            assert connection is not None
            counted: list[None] = []
            connection.set_progress_handler(partial(counted.append, None), 100)
            assert len(waiting(session, ())) == 50 * (1 + len(steps))
            connection.set_progress_handler(None, 0)
        steps.append(len(counted))
    library.close()
    assert steps[1] < 3 * steps[0]


def test_neighbours_in_the_queue() -> None:
    assert (place_in(["a", "b"], "b").before, place_in(["a", "b"], "b").after) == ("a", None)
    assert place_in([], "b").after is None


def evaluation(*outcomes: Outcome) -> Evaluation:
    none = Proportion(0, 0)
    return Evaluation("gearbox", "both", len(outcomes), 9, 3, none, none, none, {}, {}, {}, outcomes)


def outcome(case: str, truth: str, best: str, verdict: str = "diagnosed") -> Outcome:
    return Outcome(case, "measured", "g0", truth, best, verdict, 0.9)


def test_what_a_case_teaches_is_counted_on_the_same_recordings() -> None:
    """The case itself, and what was held out in one of the two alone, is in neither figure."""
    without = evaluation(
        outcome("a", "notch", "play"),
        outcome("b", "play", "play"),
        outcome("c", "normal", "normal", "not_in_library"),
        outcome("d", "normal", "normal"),
        outcome("gone", "normal", "normal"),
    )
    having = evaluation(
        outcome("a", "notch", "notch"),
        outcome("b", "play", "notch"),
        outcome("c", "normal", "normal"),
        outcome("d", "normal", "normal"),
        outcome("new", "notch", "play"),
    )
    found = teaching(without, having, "new")
    assert (found.right.before, found.right.after) == (Proportion(2, 4), Proportion(3, 4))
    assert (found.said.before, found.said.after) == (Proportion(2, 3), Proportion(3, 4))
    assert (found.called_new.before, found.called_new.after) == (Proportion(1, 4), Proportion(0, 4))
    assert [each.after.case_id for each in found.changes] == ["b", "a", "c"]
    assert (found.better, found.worse) == (2, 1)
    assert found.own is not None
    assert found.own.best == "play"
