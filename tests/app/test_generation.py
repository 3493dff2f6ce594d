"""Generated cases: into the library once, with their origin, however often and by whomever they are generated."""

from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import func, select

from app.simulated.generation import Campaign, generate, key_of, simulations
from casebase.library import CaseLibrary
from casebase.reasoning.severity import PARAMETERS
from casebase.search.case_filter import CaseFilter
from casebase.store.models import Case
from sim.description.axis import Motion
from sim.errors import ParameterError
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.scenario import MODEL_VERSION, scenario_of

COUNTS = {"normal": 2, "play": 1, "notch": 1}
CAMPAIGN = Campaign(PAPER_AXIS, COUNTS, seed=4, duration_s=3.0)


def _count(library: CaseLibrary) -> int:
    with library.reading() as session:
        return session.scalars(select(func.count()).select_from(Case)).one()


def test_generated_twice_is_there_once(tmp_path: Path) -> None:
    library = CaseLibrary.open(tmp_path)
    done: list[int] = []
    first = generate(library, CAMPAIGN, processes=1, batch="a", advance=done.append)
    assert (first.new, first.known, sum(done), _count(library)) == (4, 0, 4, 4)
    again = generate(library, CAMPAIGN, processes=1, batch="b", advance=done.append)
    assert (again.new, again.known, sum(done), _count(library)) == (0, 4, 8, 4)
    with library.reading() as session:
        cases = library.retrieve.cases(session, CaseFilter(origin="simulated")).items
    library.close()
    assert sorted(case.label for case in cases) == ["normal", "normal", "notch", "play"]
    for case in cases:
        assert (case.origin, case.model_version) == ("simulated", MODEL_VERSION)
        assert case.recording.axis == PAPER_AXIS.name
        mechanism = {"normal": None, "play": "backlash", "notch": "tooth_damage"}[case.label]
        assert case.mechanism == mechanism
        if case.label != "normal":
            assert case.severity == case.parameters[PARAMETERS[case.label]]
        assert scenario_of(case.parameters["scenario"]).duration_s == 3.0  # type: ignore[arg-type]


def test_a_task_of_the_job_can_be_repeated(tmp_path: Path) -> None:
    library = CaseLibrary.open(tmp_path)
    kind = simulations(library)
    parameters = CAMPAIGN.to_document()
    tasks = kind.plan(parameters)
    results = [kind.run(task, lambda _stage, _fraction: None) for task in (*tasks, tasks[0])]
    took = [result.pop("simulation_s") for result in results if isinstance(result, dict)]
    assert results == [{"new": 4, "known": 0}, {"new": 0, "known": 4}]
    assert took[0] > took[1] == 0, "nothing is simulated twice"
    finished = kind.finish(parameters, [{"new": 4, "known": 0, "simulation_s": took[0]}])
    assert finished == {"new": 4, "known": 0, "simulation_s": took[0], "counts": COUNTS}
    assert _count(library) == 4
    library.close()


def test_keys_depend_on_everything_that_is_heard(tmp_path: Path) -> None:
    plain = {key_of(each.scenario) for each in CAMPAIGN.planned()}
    assert len(plain) == 4
    other = Campaign(PAPER_AXIS, COUNTS, seed=4, duration_s=4.0)
    assert plain.isdisjoint(key_of(each.scenario) for each in other.planned())
    library = CaseLibrary.open(tmp_path)
    assert plain == {key_of(each.scenario) for each in Campaign.from_document(CAMPAIGN.to_document()).planned()}
    library.close()


def test_cases_follow_the_described_motion_or_any() -> None:
    axes = [replace(PAPER_AXIS, motion=Motion(period)) for period in (4.0, 5.0, 6.0)]
    described, any_motion = (
        [{key_of(each.scenario) for each in Campaign(axis, COUNTS, motion=motion).planned()} for axis in axes]
        for motion in ("described", "any")
    )
    assert len(set().union(*described)) == 12
    assert len(set().union(*any_motion)) == 4
    bare = replace(PAPER_AXIS, motion=Motion())
    assert Campaign(bare, COUNTS).planned() == Campaign(bare, COUNTS, motion="any").planned()


def test_wrong_campaigns_are_refused() -> None:
    with pytest.raises(ParameterError, match="cases can be generated at a time"):
        Campaign(PAPER_AXIS, {"normal": 0})
    with pytest.raises(ParameterError, match="duration_s: must be 1 to 120 s"):
        Campaign(PAPER_AXIS, {"normal": 1}, duration_s=0.1)
    with pytest.raises(ParameterError, match="cannot be generated"):
        Campaign(PAPER_AXIS, {"rust": 1})
