"""What a page says is so, as a browser shows it: one thing has one place, one colour and one word."""

import re
import shlex
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from benchmarks.harness.site import Site
from casebase.store.models import StoredJob, new_id, now
from sim.investigation.report.panels import AS_DESCRIBED, DESCRIBED, EXTENDED, FLOOR, MEASURED
from tests.app.test_page_errors import RESULTS
from tests.web.conftest import Opened, Tab, settle

pytestmark = pytest.mark.browser

INKS = range(1, 8)
STROKES = """numbers => numbers.map((number) => {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
    svg.setAttribute("class", "chart");
    line.setAttribute("class", `series s${number}`);
    document.body.append(svg);
    svg.append(line);
    const { stroke, strokeDasharray } = getComputedStyle(line);
    svg.remove();
    return [stroke, strokeDasharray];
})"""
LEGENDS = """() => [...document.querySelectorAll(".legend .line")]
    .map((one) => [one.firstChild.nextSibling.data, one.querySelector("path").getAttribute("class")])"""


def test_the_page_of_a_job_that_is_over_opens(tab: Tab, site: Site) -> None:
    """Of every kind and result; that of every state, without a browser, is in tests/app/test_page_errors.py."""
    library = site.library()
    rows = [
        StoredJob(id=new_id(), kind=kind, parameters={}, state=state, result=result, error=error, finished_at=end)
        for kind, results in RESULTS.items()
        for state, result, error, end in (
            *(("done", result, None, now()) for result in results),
            ("failed", None, "task 0: motor: missing table [motor]", now()),
        )
    ]
    told = [(row.id, row.state, row.error) for row in rows]
    with library.transaction("test") as session:
        session.add_all(rows)
    with tab("/jobs") as page:
        for identity, state, error in told:
            answer = page.goto(f"{site.url}/jobs/{identity}")
            assert answer is not None
            assert (answer.status, answer.headers["content-type"]) == (200, "text/html; charset=utf-8")
            expect(page.locator(".page-head")).to_contain_text(state)
            if error:
                expect(page.locator(".notice")).to_contain_text("missing table [motor]")
        page.goto(site.url + "/jobs")
    with library.transaction("test") as session:
        for identity, _, _ in told:
            session.delete(session.get_one(StoredJob, identity))
    library.close()


def test_the_line_of_the_circle_is_the_phase_of_the_text(tab: Tab, site: Site) -> None:
    """One number in fact, evidence and circle, and it is called what it is: no angle of a gear."""
    with tab(f"/diagnoses/{site.diagnosis}") as page:
        page.locator("#details > summary").click()
        fact = page.locator(".facts div", has_text="Time in the cycle").inner_text()
        found = re.search(r"phase (\d+)°", fact)
        assert found is not None
        assert page.locator(".polar [data-phase]").get_attribute("data-phase") == found[1]
        expect(page.locator(".polar-sheet")).to_contain_text(f"phase {found[1]}°")
        expect(page.locator("#evidence")).to_contain_text(f"a phase of {found[1]} degrees")
        assert "angle" not in page.locator("section.verdict").inner_text().lower()
        # where the circle is highest is where its line points
        highest = page.evaluate(
            """() => {
                const sectors = [...document.querySelectorAll(".polar .sector, .polar .unvisited")];
                const reach = sectors.map((one) => one.getTotalLength());
                return (360 * reach.indexOf(Math.max(...reach))) / sectors.length;
            }"""
        )
        assert abs((highest + 2.5 - float(found[1]) + 180) % 360 - 180) < 15


def test_a_thing_has_one_colour_and_stroke_over_panels_page_and_report(
    only_page: Page, tab: Tab, site: Site, tmp_path: Path
) -> None:
    path = f"/investigations/{site.investigation}"
    with tab(path) as page:
        settle(page)
        drawn = {(name.strip(), look) for name, look in page.evaluate(LEGENDS)}
        looks = dict(drawn)
        assert len(looks) == len(drawn)  # no name with two looks
        assert {MEASURED, DESCRIBED, EXTENDED, FLOOR} <= looks.keys()
        # no two things with one look: by either name it is the model without what was found
        assert len(set(looks.values())) == len(looks.keys() - {AS_DESCRIBED})
        strokes = page.evaluate(STROKES, list(INKS))
        shown = {int(look.rpartition("s")[2]) for look in looks.values()}
        dashes = [dash for number, (_, dash) in zip(INKS, strokes, strict=True) if number in shown]
        assert len(set(dashes)) == len(dashes)  # told apart without colour
        numbers = page.request.get(f"{site.url}{path}/panels/overlay/0").json()["series"]
        assert {f"series s{one['style']}" for one in numbers} == {looks[one["name"]] for one in numbers}
        (tmp_path / "report.html").write_text(page.request.get(f"{site.url}{path}/report.html").text(), "utf-8")
    only_page.goto((tmp_path / "report.html").as_uri())
    assert only_page.evaluate(STROKES, list(INKS)) == strokes


def test_an_unknown_axis_is_said(opened: Opened, site: Site) -> None:
    with opened("admin", "/library?axis=nobody") as page:
        expect(page.get_by_role("status")).to_contain_text("No axis is known as 'nobody'; ")
        for path in ("/axes/nobody", "/simulate?axis=nobody", "/library/simulate?axis=nobody"):
            answer = page.request.get(site.url + path, headers={"Accept": "text/html"})
            assert (answer.status, "nobody" in answer.text()) == (404, True), path
        page.goto(site.url + "/diagnoses/new")
        form = page.locator("main form")
        form.get_by_label("Recording", exact=True).set_input_files(site.recording)
        form.get_by_label("Axis", exact=True).fill("nobody")
        form.get_by_label("a new axis").check()
        form.get_by_role("button", name="Diagnose", exact=True).click()
        expect(page.locator(".crumbs")).to_contain_text("nobody (not described)")
        expect(page.locator("#evidence")).to_contain_text("No axis is described as 'nobody'")
        command = shlex.split(page.locator("#curl").text_content() or "")
        assert f'file=@"{site.recording.name}"' in command  # a name with a space and a comma


def test_what_was_typed_stays_at_a_refusal(only_page: Page, site: Site) -> None:
    only_page.goto(site.url + "/alarms")
    only_page.get_by_text("Make a receiver").click()
    form = only_page.locator("form[action$=receivers]")
    form.get_by_label("Who or what").fill("tickets")
    form.get_by_label("Kind").select_option("webhook")
    form.get_by_label("Address").fill("http://127.0.0.1/secret")
    form.get_by_role("button", name="Make the receiver").click()
    expect(form.get_by_role("status")).to_contain_text("127.0.0.1")
    expect(form.get_by_label("Who or what")).to_have_value("tickets")


def test_a_key_that_is_not_listed_stores_nothing(opened: Opened, site: Site) -> None:
    with opened("operator", f"/diagnoses/{site.diagnosis}") as page:
        page.locator("h1").first.click()
        page.keyboard.press("u")
        page.reload()
        expect(page.get_by_role("region", name="Your verdict, after a look").get_by_text("Marked")).to_have_count(0)
        assert page.locator("[data-key=u]").count() == 0
