"""Diagnoses to check, by keys alone: begin, answer, the next one opens, take it back."""

import json

import pytest
from playwright.sync_api import expect

from benchmarks.harness.site import Site, parts
from benchmarks.harness.sounds import sound
from tests.web.conftest import Opened

pytestmark = pytest.mark.browser


def test_the_queue_by_keys(opened: Opened, site: Site) -> None:
    with site.server.client() as client:
        for seed in (31, 32):
            known = json.dumps({"axis": "queue", "gearbox": f"q{seed}"}).encode()
            client.post("/api/v1/diagnoses", files=parts(f"{seed}.wav", sound(seed), known)).raise_for_status()
    with opened("admin", "/queue") as page:
        count = int(page.locator("h1").inner_text().split()[-2])
        page.keyboard.press("j")
        expect(page.locator("nav.queue")).to_contain_text(f"1 of {count} to check")
        first = page.url
        page.wait_for_load_state()  # a key that is pressed before the page's script runs is lost
        page.keyboard.press("x")
        expect(page.locator("select#label")).to_be_focused()  # a correction needs its label
        page.keyboard.press("Tab")
        page.locator("h1").first.click()
        page.keyboard.press("n")
        page.wait_for_url("**step=*")
        expect(page.locator(".notice")).to_contain_text("rejected")
        expect(page.locator("nav.queue")).to_contain_text(f"1 of {count - 1} to check")
        page.wait_for_load_state()
        page.keyboard.press("z")
        page.wait_for_url("**undone=1*")
        assert page.url.partition("?")[0] == first.partition("?")[0]
        expect(page.locator("nav.queue")).to_contain_text(f"1 of {count} to check")
