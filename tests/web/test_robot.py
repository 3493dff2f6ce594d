"""A robot in the browser: its files are given, its joints are told one by one."""

from pathlib import Path

import pytest
from playwright.sync_api import expect

from app.investigations import get_investigation
from benchmarks.harness.plane_robot import MAP, ROBOT, log, urdf
from benchmarks.harness.site import Site
from casebase.store.models import now
from signals.reading.documents import parse_document
from sim.robot.foreign import kept_robot
from sim.robot.investigation import investigate_robot
from sim.robot.motion import read_log
from sim.robot.report import robot_story
from tests.web.conftest import Opened, Tab
from tests.web.test_pages import check


@pytest.fixture(scope="module")
def given() -> dict[str, dict[str, object]]:
    """The files of a robot by the labels of their fields."""
    named = {
        "Description of the robot": ("robot.toml", ROBOT.encode()),
        "URDF": ("arm.urdf", urdf()),
        "Log of the robot": ("log.csv", log()),
    }
    return {
        label: {"name": name, "mimeType": "text/plain", "buffer": content} for label, (name, content) in named.items()
    }


def test_a_robot_is_asked_for_and_told_joint_by_joint(
    opened: Opened, tab: Tab, site: Site, given: dict[str, dict[str, object]], tmp_path: Path
) -> None:
    with opened("operator", "/investigations/new") as page:
        form = page.locator("#robot_form")
        for label, file in given.items():
            form.get_by_label(label, exact=True).set_input_files(file)  # type: ignore[arg-type]
        map_ = form.get_by_label("Map of the joints' columns")
        expect(map_).to_have_attribute("placeholder", MAP_OF_SIX)
        map_.fill(MAP)
        form.get_by_role("button", name="Ask about the robot").click()
        page.wait_for_url("**/jobs/*")
        identity = page.url.rsplit("/", 1)[1]
    with site.server.client() as client:
        client.delete(f"/api/v1/jobs/{identity}").raise_for_status()
    library = site.library()
    with library.transaction("test") as session:
        row = get_investigation(session, identity)
        assert row.robot == "plane arm"
        row.document, row.state, row.finished_at = found(tmp_path), "done", now()
    library.close()
    with opened("viewer", f"/investigations/{identity}") as page:
        expect(page.get_by_role("heading", name="Coulomb friction", include_hidden=True).last).to_be_hidden()
        page.get_by_role("link", name="2. elbow").click()
        expect(page.locator("#joint-2").get_by_role("heading", name="Coulomb friction")).to_be_visible()
        expect(page.locator("#joint-1").get_by_role("heading", name="Coulomb friction")).to_be_hidden()
    check(tab, f"/investigations/{identity}")


def found(folder: Path) -> dict[str, object]:
    """What an investigation of the robot finds, without its report."""
    (folder / "log.csv").write_bytes(log())
    robot = kept_robot(parse_document(ROBOT), urdf())
    result = investigate_robot(robot, [read_log(robot, folder / "log.csv", MAP)])
    return {**result.document(), "story": robot_story(result)}


MAP_OF_SIX = """schema = "gearcase-channels/1"
[time_s]
column = 1
unit = "s"
[motor_position_rad]
column = [2, 3, 4, 5, 6, 7]
unit = "rad"
[motor_torque_nm]
column = [8, 9, 10, 11, 12, 13]
unit = "N.m"
"""
