"""The interface for programs is found, read and tried out in a browser, with its session or without."""

import os
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Locator, Page, expect

from benchmarks.harness.site import Site, browsing
from tests.web.conftest import Opened, Tab
from tests.web.test_pages import AXE, OPTIONS, SERIOUS

pytestmark = pytest.mark.browser


def tried(page: Page) -> Locator:
    """Search an operation and try it out with its example, by the keyboard alone; return the status that came."""
    page.get_by_label("Search").fill("make KEY")
    operations = page.locator(".opblock")
    expect(operations).to_have_count(1)
    operations.locator(".opblock-summary-control").press("Enter")
    page.get_by_role("button", name="Try it out").press("Enter")
    page.get_by_role("button", name="Execute").press("Enter")
    return page.locator(".live-responses-table tbody .response-col_status")


def test_what_is_tried_out_has_the_role_of_the_session(
    opened: Opened, contexts: dict[str | None, BrowserContext], site: Site
) -> None:
    with opened("admin", "/docs") as page:
        expect(tried(page)).to_have_text(re.compile("201"))
    nobody = contexts[None].new_page()
    nobody.goto(f"{site.url}/docs")
    expect(tried(nobody)).to_have_text(re.compile("401"))
    nobody.close()


def test_the_description_fits_and_is_accessible(tab: Tab) -> None:
    if not AXE.exists():
        pytest.skip("axe-core is not installed: make setup installs it")
    with tab("/docs") as page:
        for scheme, width in (("light", 1280), ("dark", 360)):
            page.emulate_media(color_scheme=scheme)
            page.set_viewport_size({"width": width, "height": 700})
            expect(page.locator(".opblock").first).to_be_visible()
            page.evaluate(AXE.read_text())
            assert page.evaluate(SERIOUS, OPTIONS) == []
            assert page.evaluate("() => document.documentElement.scrollWidth") <= width


def test_the_first_call_on_the_page_of_the_interface_runs(site: Site, tmp_path: Path) -> None:
    if shutil.which("curl") is None or shutil.which("bash") is None:
        pytest.skip("no curl to run the example with")
    with browsing(site, None) as client:
        page = client.get("/docs").raise_for_status().text
    example = unescape(page.partition('<pre id="curl">')[2].partition("</pre>")[0])
    environment = {**os.environ, "GEARCASE_KEY": site.server.keys["operator"]}
    done = subprocess.run(
        ["bash", "-ec", example], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert '"verdict"' in done.stdout
