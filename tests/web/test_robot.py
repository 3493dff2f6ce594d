"""A robot in the browser: its files are given, its joints are told one by one."""

from pathlib import Path

from playwright.sync_api import expect

from app.investigations import get_investigation
from benchmarks.harness.plane_robot import ROBOT, log, urdf
from benchmarks.harness.site import Site
from casebase.store.models import now
from signals.reading.documents import parse_document
from sim.robot.foreign import kept_robot
from sim.robot.investigation import investigate_robot
from sim.robot.motion import read_log
from sim.robot.report import robot_story
from tests.web.conftest import Opened, Tab
from tests.web.test_import import drop
from tests.web.test_pages import check


def test_a_robot_of_a_urdf_is_stored_and_told_joint_by_joint(
    opened: Opened, tab: Tab, site: Site, tmp_path: Path
) -> None:
    """Its files are dropped on the page; a channel that is chosen for one joint is chosen for the next column, too."""
    (tmp_path / "arm.urdf").write_bytes(urdf().replace(b'name="arm"', b'name="plane arm"'))
    rows = log().split(b"\n", 1)[1]
    (tmp_path / "log.csv").write_bytes(rows)
    with opened("admin", "/investigations/new") as page:
        drop(page, *tmp_path.iterdir())
        page.get_by_role("button", name="Store this robot").click()
        expect(page.get_by_label("Axis or robot")).to_have_value("robot/plane arm")
        page.get_by_label("channel of column 1", exact=True).select_option("time_s")
        page.get_by_label("unit of column 1", exact=True).select_option("s")
        for column, channel, unit in ((2, "motor_position_rad", "rad"), (4, "motor_torque_nm", "N.m")):
            page.get_by_label(f"channel of column {column}", exact=True).select_option(channel)
            page.get_by_label(f"unit of column {column}", exact=True).select_option(unit)
        expect(page.get_by_label("joint of column 5", exact=True)).to_have_value("1")
        page.get_by_role("button", name="Investigate").click()
        page.wait_for_url("**/jobs/*")
        identity = page.url.rsplit("/", 1)[1]
    with site.server.client() as client:
        client.delete(f"/api/v1/jobs/{identity}").raise_for_status()
    library = site.library()
    with library.transaction("test") as session:
        row = get_investigation(session, identity)
        assert row.robot == "plane arm"
        row.document, row.state, row.finished_at = found(tmp_path, str(row.inputs["channels"])), "done", now()
    library.close()
    with opened("viewer", f"/investigations/{identity}") as page:
        expect(page.get_by_role("heading", name="Coulomb friction", include_hidden=True).last).to_be_hidden()
        page.get_by_role("link", name="2. elbow").click()
        expect(page.locator("#joint-2").get_by_role("heading", name="Coulomb friction")).to_be_visible()
        expect(page.locator("#joint-1").get_by_role("heading", name="Coulomb friction")).to_be_hidden()
    check(tab, f"/investigations/{identity}")


def found(folder: Path, channels: str) -> dict[str, object]:
    """What an investigation of the robot finds, without its report."""
    robot = kept_robot(parse_document(ROBOT), urdf())
    result = investigate_robot(robot, [read_log(robot, folder / "log.csv", channels)])
    return {**result.document(), "story": robot_story(result)}
