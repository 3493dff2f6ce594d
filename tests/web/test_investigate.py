"""Logs on the page that starts an investigation: columns become channels, and what is wrong stands at its column."""

import json
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from app.investigations import get_investigation
from benchmarks.harness.site import Site
from casebase.store.models import StoredJob
from tests.web.conftest import Opened
from tests.web.test_import import drop
from tests.web.test_pages import check_as_it_is

pytestmark = pytest.mark.browser


@pytest.fixture
def unnamed(tmp_path: Path) -> Path:
    """A log of 31 columns without names: the clock, an angle, its speed and its motor's current, a current of another
    motor, and others at rest."""
    columns = np.random.default_rng(7).normal(0.0, 1e-4, (31, 700))
    columns[0] = 1297.499 + np.arange(700) / 100
    columns[1], columns[7] = 2.0 * np.sin(columns[0]), 2.0 * np.cos(columns[0])
    columns[13], columns[14] = 5.0 * np.cos(columns[0]), np.sin(3.0 * columns[0])
    np.savetxt(tmp_path / "joint1.csv", columns.T, "%.4f", ",")
    return tmp_path / "joint1.csv"


def choose(page: Page, column: int, channel: str, unit: str) -> None:
    """By keyboard: a list that is focused takes what is typed."""
    for name, words in (("channel", channel), ("unit", unit)):
        expect(page.get_by_label(f"{name} of column {column}", exact=True)).to_be_enabled()
        page.get_by_label(f"{name} of column {column}", exact=True).focus()
        page.keyboard.type(words)


def started(page: Page) -> str:
    page.get_by_role("button", name="Investigate").press("Enter")
    page.wait_for_url("**/jobs/*")
    return page.url.rsplit("/", 1)[1]


def asked(site: Site, identity: str) -> tuple[object, str]:
    """Axis and channel map of an investigation."""
    with site.library().reading() as session:
        row = get_investigation(session, identity)
        return row.axis, str(row.inputs["channels"])


@pytest.mark.parametrize("_", ["first", "second"])
def test_logs_of_an_axis_without_description_are_investigated(
    opened: Opened, site: Site, unnamed: Path, _: str
) -> None:
    with opened("operator", "/investigations/new") as page:
        drop(page, unnamed)
        for column in ((1, "time", "s"), (2, "load position", "rad"), (14, "motor torque", "A")):
            choose(page, *column)
        page.get_by_label("constant of column 14", exact=True).fill("1")
        page.get_by_label("Axis or robot").select_option("new")
        page.get_by_role("button", name="Investigate").click()
        expect(page.locator("[data-problem-here]")).to_contain_text("name")
        page.get_by_label("Name of the new axis").fill("joint 1")
        assert asked(site, started(page))[0] == "joint 1"


def test_an_unnamed_log_is_investigated_and_its_map_is_kept(opened: Opened, site: Site, unnamed: Path) -> None:
    with opened("operator", "/investigations/new") as page:
        drop(page, unnamed)
        rows = page.locator("[data-columns] tbody tr")
        expect(rows).to_have_count(31)
        marks = ("always rises", "its speed is column 8", "the speed of column 2", "same joint as columns 2 and 8")
        for column, mark in zip((0, 1, 7, 13), marks, strict=True):
            expect(rows.nth(column)).to_contain_text(mark)
        expect(page.locator("[data-does]:not(:empty)")).to_have_count(4)
        page.get_by_label("Axis or robot").select_option("axis/bench")
        choose(page, 1, "time", "s")
        choose(page, 2, "motor position", "rad")
        choose(page, 14, "motor torque", "A")
        page.get_by_role("button", name="Investigate").click()
        expect(rows.nth(13)).to_contain_text("Give the number")
        page.get_by_label("constant of column 14", exact=True).fill("8.5")
        first = started(page)
        axis, text = asked(site, first)
        assert axis == "bench"
        assert json.loads(text)["motor_torque_nm"] == {"column": 14, "unit": "A", "factor": 8.5}
        page.goto(site.url + "/investigations/new")
        drop(page, unnamed)
        expect(rows).to_have_count(31)
        page.get_by_label("Axis or robot").select_option("axis/bench")
        expect(page.get_by_label("constant of column 14", exact=True)).to_have_value("8.5")
        assert asked(site, started(page)) == (axis, text)


def test_a_refusal_is_in_view_and_a_new_axis_is_chosen(opened: Opened, unnamed: Path) -> None:
    """It stands at its field; the axis is described in a tab that closes by itself."""
    with opened("admin", "/investigations/new") as page:
        drop(page, unnamed)
        expect(page.get_by_label("Start of the sound")).to_be_hidden()
        expect(page.locator("[data-lacks]")).to_contain_text("an axis")
        page.get_by_role("button", name="Investigate").click()
        expect(page.locator("[data-problem-here]")).to_be_in_viewport()
        expect(page.get_by_label("Axis or robot")).to_be_focused()
        with page.context.expect_page() as opening:
            page.get_by_role("link", name="Describe an axis by a form").click()
        form = opening.value
        form.get_by_label("Name of the axis").fill("waited for")
        form.get_by_role("button", name="Add the axis").click()
        expect(form.get_by_label("Inertia of the load")).to_be_focused()
        with form.expect_event("close"):
            form.get_by_label("Inertia of the load").fill("0")
            form.get_by_role("button", name="Add the axis").click(no_wait_after=True)
        expect(page.get_by_label("Axis or robot")).to_have_value("axis/waited for")


def test_what_is_wrong_with_a_log_stands_at_its_column(
    contexts: dict[str | None, BrowserContext], site: Site, unnamed: Path
) -> None:
    """The filled table is accessible, and fits a telephone."""
    with contexts["operator"].new_page() as page:
        page.goto(site.url + "/investigations/new")
        page.get_by_label("Log of the drive").set_input_files(unnamed)
        choose(page, 2, "time", "s")
        choose(page, 14, "motor torque", "N.m")
        rows = page.locator("[data-columns] tbody tr")
        expect(rows.nth(1)).to_contain_text("does not run forwards")
        choose(page, 15, "motor torque", "N.m")
        expect(rows.nth(14)).to_contain_text("is this already")
        check_as_it_is(page)


def test_a_job_that_failed_is_changed_and_tried_again(opened: Opened, site: Site, unnamed: Path) -> None:
    with site.server.client() as client:
        map_ = '{"time_s": {"column": 1}, "motor_position_rad": {"column": 2}, "motor_torque_nm": {"column": 3}}'
        parts = {"axis": (None, "bench"), "channels": (None, map_), "telemetry": ("joint1.csv", unnamed.read_bytes())}
        identity = client.post("/api/v1/investigations", files=parts).raise_for_status().json()["id"]
    library = site.library()
    with library.transaction("test") as session:
        job, row = session.get(StoredJob, identity), get_investigation(session, identity)
        assert job is not None
        job.state = row.state = "failed"
        job.error = row.error = "the torque is noise"
    library.close()
    with opened("operator", f"/jobs/{identity}") as page:
        page.get_by_role("link", name="Change it and try again").click()
        expect(page.get_by_text("the torque is noise")).to_be_visible()
        expect(page.get_by_label("channel of column 3", exact=True)).to_have_value("motor_torque_nm")
        page.get_by_label("channel of column 3", exact=True).select_option("")
        choose(page, 14, "motor torque", "N.m")
        axis, text = asked(site, started(page))
    assert axis == "bench"
    assert json.loads(text)["motor_torque_nm"]["column"] == 14
