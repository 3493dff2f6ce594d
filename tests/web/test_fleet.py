"""The shift: open the fleet, go to the red one, listen to what shows it, take it back; a gearbox is exchanged."""

import json

import pytest
from playwright.sync_api import expect

from benchmarks.harness.site import Site, parts
from benchmarks.harness.sounds import sound
from tests.web.conftest import Opened

pytestmark = pytest.mark.browser


def test_the_shift(opened: Opened, site: Site) -> None:
    known = {"axis": "bench", "gearbox": "shift", "speed_rad_s": 2.5, "recorded_at": "2026-01-01T06:00:00Z"}
    told = json.dumps(known).encode()
    with site.server.client() as client:
        files = parts("shift.wav", sound(21, impacts=True), told)
        made = client.post("/api/v1/diagnoses", files=files).raise_for_status().json()
        verdict = {"verdict": "corrected", "label": "notch"}
        client.patch(f"/api/v1/diagnoses/{made['id']}", json=verdict).raise_for_status()
    with opened("operator", "/fleet") as page:
        row = page.get_by_role("row", name="bench, shift")
        expect(row).to_contain_text("Fault confirmed")
        expect(row).to_contain_text("Tooth damage: confirmed by ")
        row.get_by_role("link").click()
        page.wait_for_url("**/axes/bench/gearboxes/shift")
        page.get_by_role("link", name="The recording that shows it").click()
        page.wait_for_url(f"**/diagnoses/{made['id']}")
        page.wait_for_load_state()
        page.keyboard.press("Space")
        expect(page.locator("[data-play]")).to_have_text("Pause")
        page.keyboard.press("z")
        expect(page.get_by_text("Marked corrected")).to_have_count(0)
        page.goto(f"{site.url}/fleet")
        expect(page.get_by_role("row", name="bench, shift")).not_to_contain_text("confirmed by")
        page.get_by_role("link", name="bench, shift").click()
        page.get_by_label("Kind").select_option("exchange")
        page.get_by_label("What was done").fill("worn out")
        page.get_by_label("When").fill("2026-01-02T06:00")
        page.get_by_label("Name of the new gearbox").fill("shift 2")
        page.get_by_role("button", name="Note it").click()
        expect(page.get_by_text("its history ends here")).to_be_visible()
        page.goto(f"{site.url}/fleet")
        expect(page.get_by_role("row", name="bench, shift 2")).to_contain_text("not recorded yet")
        expect(page.get_by_role("link", name="bench, shift", exact=True)).to_have_count(0)


def test_a_zoomed_trend_stands_in_the_address(opened: Opened, site: Site) -> None:
    with site.server.client() as client:
        for day in range(1, 5):
            about = {"axis": "bench", "gearbox": "zoomed", "recorded_at": f"2026-11-{day:02}T06:00:00Z"}
            files = parts("zoomed.wav", sound(60 + day), json.dumps(about).encode())
            client.post("/api/v1/diagnoses", files=files).raise_for_status()
    with opened("viewer", "/axes/bench/gearboxes/zoomed") as page:

        def shown() -> int:
            plot.scroll_into_view_if_needed()
            expect(plot).to_have_attribute("data-ready", "true")
            return len(page.request.get(f"{page.url.partition('?')[0]}{plot.get_attribute('data-plot')}").json()["x"])

        plot = page.locator("[data-since]").first
        whole, box = shown(), plot.locator(".u-over").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 50)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 50)
        page.mouse.up()
        page.wait_for_url("**from=**")
        page.reload()
        expect(page.get_by_label("From")).not_to_have_value("")
        assert shown() < whole
