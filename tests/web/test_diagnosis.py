"""The page of one diagnosis: its first screen has all that is needed at the robot, and a person's verdict leads."""

import json

import pytest
from playwright.sync_api import Page, expect

from app.http.security import COOKIE, csrf_token
from benchmarks.harness.site import Site, browsing, parts
from benchmarks.harness.sounds import sound
from tests.web.conftest import Opened

pytestmark = pytest.mark.browser

NEEDED = ("h1", ".checks", ".player", "button[value=confirmed]", "#label")


def lowest(page: Page) -> float:
    """Where the last of what is needed ends, from the top of the page [px]."""
    boxes = [page.locator(each).first.bounding_box() for each in NEEDED]
    return max(box["y"] + box["height"] for box in boxes if box is not None)


@pytest.mark.parametrize(("width", "height", "screens"), [(1400, 900, 1), (360, 700, 2)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_all_that_is_needed_is_on_the_first_screens(
    opened: Opened, site: Site, width: int, height: int, screens: int, scheme: str
) -> None:
    size = {"width": width, "height": height}
    with opened("admin", f"/diagnoses/{site.diagnosis}", viewport=size, color_scheme=scheme) as page:
        assert lowest(page) <= screens * height
        expect(page.get_by_role("button", name="no fault")).to_be_visible()
        expect(page.locator(".glance")).to_contain_text("after the first reversal")
        expect(page.locator("#evidence")).to_be_hidden()
        expect(page.locator(".player [part=knock]").first).to_be_visible()


def test_playhead_and_marks_zoom_with_the_spectrogram(opened: Opened, site: Site) -> None:
    with opened("viewer", f"/diagnoses/{site.diagnosis}", viewport={"width": 1400, "height": 900}) as page:
        picture, mark = page.locator(".player img"), page.locator(".player [part=knock]").first
        expect(mark).to_be_visible()
        before = picture.bounding_box()
        page.get_by_label("Zoom").fill("4")
        after = picture.bounding_box()
        assert before is not None
        assert after is not None
        assert after["width"] == pytest.approx(4 * before["width"], rel=0.02)
        head = page.locator(".player [part=cursor]").bounding_box()
        assert head is not None
        assert head["y"] + head["height"] >= after["y"] + after["height"] - 1
        assert picture.evaluate("(image) => image.naturalWidth") > 0


@pytest.mark.parametrize(("said", "headline"), [("confirmed", "confirmed by"), ("rejected", "Rejected by")])
def test_the_verdict_of_a_person_is_the_headline(site: Site, said: str, headline: str) -> None:
    with site.server.client() as client:
        files = parts("verdict.wav", sound(41, impacts=True), json.dumps({"speed_rad_s": 2.5}).encode())
        made = client.post("/api/v1/diagnoses", files=files).raise_for_status().json()
    with browsing(site, "admin") as client:
        form = {"csrf": csrf_token(client.cookies[COOKIE]), "verdict": said}
        assert client.post(f"/diagnoses/{made['id']}/revise", data=form).status_code == 303
        for page in (f"/diagnoses/{made['id']}", f"/diagnoses/{made['id']}/report.html"):
            text = client.get(page).raise_for_status().text
            assert text.count('name="verification"') == 1 or page.endswith(".html")
            first = text.partition("<h1")[2].partition("</h1>")[0]
            assert headline in first
            assert ("damage" in first) == (said == "confirmed")
            assert ('part="knock"' in text) == (said == "confirmed" and not page.endswith(".html"))
