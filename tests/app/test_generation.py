"""Generated cases: into the library once, with their origin, however often and by whomever they are generated."""

import json
from pathlib import Path

import pytest
from sqlalchemy import func, select

from app.generation import Campaign, generate, key_of, simulations, stored_joint
from app.robots import add_robot
from casebase.case_filter import CaseFilter
from casebase.library import CaseLibrary
from casebase.models import Case
from casebase.severity import PARAMETERS
from sim.description.axis_document import write_axis
from sim.errors import ParameterError
from sim.experiment.design_of_experiments import LABELS
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.scenario import MODEL_VERSION, scenario_of
from sim.robot.foreign import check_foreign
from tests.app.inside import inside
from tests.live import gearcase
from tests.sim.robot.arms import two_links, urdf, write_robot

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
    assert plain == {
        key_of(each.scenario) for each in Campaign.from_document(CAMPAIGN.to_document(), library).planned()
    }
    library.close()


def robot_in(folder: Path) -> Path:
    """Two links of which the first has the paper's gears."""
    path = write_robot(folder, two_links())
    head, tail = path.read_text().split('name = "joint1"\n')
    path.write_text(f'{head}name = "joint1"\naxis = "axis.toml"\n{tail}')
    (folder / "axis.toml").write_text(write_axis(PAPER_AXIS))
    return path


def test_a_joint_of_a_robot_by_command_and_by_job_are_the_same_cases(tmp_path: Path) -> None:
    """The command reads files, the job a stored robot; a worker finds what the command made."""
    path, data = robot_in(tmp_path), tmp_path / "data"
    words = ["--robot", path, "--joint", "joint1", "--per-label", "1", "--duration", "2", "--processes", "1", "--json"]
    done = gearcase("generate", *words, data_dir=data)
    assert done.code == 0, done.stderr
    assert json.loads(done.stdout)["new"] == 3
    library = CaseLibrary.open(data)
    given = check_foreign(path.read_text(), (tmp_path / "arm.urdf").read_bytes(), {"axis.toml": write_axis(PAPER_AXIS)})
    with library.transaction("test") as session:
        add_robot(session, given)
    joint = stored_joint(library, "arm", "joint1")
    campaign = Campaign(joint.axis, dict.fromkeys(LABELS, 1), duration_s=2.0, joint=joint)
    kind = simulations(library)
    document = json.loads(json.dumps(campaign.to_document()))
    results = [kind.run(task, lambda _stage, _fraction: None) for task in kind.plan(document)]
    assert results == [{"new": 0, "known": 3, "simulation_s": 0.0}]
    with library.reading() as session:
        cases = library.retrieve.cases(session, CaseFilter(origin="simulated")).items
    library.close()
    assert sorted(case.label for case in cases) == ["normal", "notch", "play"]
    for case in cases:
        load = scenario_of(case.parameters["scenario"]).pose_load  # type: ignore[arg-type]
        assert load is not None
        assert (case.recording.axis, case.recording.description["extra"]["robot"]) == (PAPER_AXIS.name, "arm")
        assert (load.robot, load.joint, len(load.first_rad)) == ("arm", "joint1", 2)


def test_cases_of_a_joint_of_a_stored_robot_are_ordered_over_http(tmp_path: Path) -> None:
    joints = [{"name": "joint1", "axis": PAPER_AXIS.to_mapping()}, {"name": "joint2"}]
    robot = json.dumps({"name": "two links", "joints": joints})
    wanted = {"robot": "two links", "joint": "joint1", "per_label": 1, "duration_s": 1.0}
    with inside(tmp_path / "data") as service:
        files = {"robot": (None, robot), "urdf": ("arm.urdf", urdf(two_links()).encode())}
        stored = service.ask("POST", "/api/v1/robots", files=files)
        assert stored.status_code == 201, stored.text
        answer = service.ask("POST", "/api/v1/simulations", json=wanted)
        assert (answer.status_code, answer.json()["state"]) == (202, "queued"), answer.text
        for changed, status, said in (
            ({"joint": "joint2"}, 422, "joints[1].axis: missing"),
            ({"joint": None}, 422, "'robot' and 'joint'"),
            ({"axis": PAPER_AXIS.to_mapping()}, 422, "'robot' and 'joint'"),
            ({"robot": "nobody"}, 404, "no robot 'nobody'"),
            ({"payload_kg_m2": [1.0, 2.0]}, 422, "payload_kg_m2: "),
        ):
            refused = service.ask("POST", "/api/v1/simulations", json={**wanted, **changed})
            assert refused.status_code == status, refused.text
            assert said in refused.json()["detail"]


def test_wrong_campaigns_are_refused(tmp_path: Path) -> None:
    path = robot_in(tmp_path)
    for words, said in (
        (["--robot", path, "--per-label", "1"], "--robot ROBOT.toml with --joint NAME"),
        (["--robot", path, "--joint", "joint2", "--per-label", "1"], "joints[1].axis: missing"),
    ):
        done = gearcase("generate", *words, data_dir=tmp_path / "data")
        assert done.code == 2
        assert said in " ".join(done.stderr.split())
    with pytest.raises(ParameterError, match="cases can be generated at a time"):
        Campaign(PAPER_AXIS, {"normal": 0})
    with pytest.raises(ParameterError, match="duration_s: must be 1 to 120 s"):
        Campaign(PAPER_AXIS, {"normal": 1}, duration_s=0.1)
    with pytest.raises(ParameterError, match="cannot be generated"):
        Campaign(PAPER_AXIS, {"rust": 1})
