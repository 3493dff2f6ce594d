"""The report in a real browser: readable on a phone and in the dark, with no access to anything."""

from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from sim.axis import read_axis
from sim.discrepancy.investigation import investigate
from sim.discrepancy.report import html_report
from tests.discrepancy.telemetry_of import one_body, swing

SMALLEST = """[...document.querySelectorAll("svg text")].map(
    one => parseFloat(getComputedStyle(one).fontSize) * Math.hypot(one.getScreenCTM().a, one.getScreenCTM().b))"""
INKS = """[...document.querySelectorAll("svg text")].map(one => getComputedStyle(one).fill)"""


@pytest.fixture(scope="module")
def report() -> str:
    _, _, speed, _ = swing()
    motor = {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"name": "one body", "motor": motor, "load": {"inertia_kg_m2": 0.0}})
    rise = 0.6 * np.exp(-((speed / 6.0) ** 2)) * np.tanh(speed / 0.01)
    return html_report(investigate(axis, one_body(0.3, 1.0, 0.02, 6, extra=rise)))


def shown(browser: Browser, report: str, width: int, **given: Any) -> tuple[Page, list[str]]:
    context = browser.new_context(viewport={"width": width, "height": 800}, offline=True, **given)
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.set_content(report)
    return page, asked


@pytest.mark.browser
@pytest.mark.parametrize("width", [360, 390, 1200])
def test_nothing_runs_off_and_plots_can_be_read(browser: Browser, report: str, width: int) -> None:
    page, asked = shown(browser, report, width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert min(page.evaluate(SMALLEST)) >= (9.0 if width >= 390 else 8.0)
    assert asked == []
    page.context.close()


@pytest.mark.browser
def test_plots_follow_the_colours_of_the_page(browser: Browser, report: str) -> None:
    for scheme in ("light", "dark"):
        page, _ = shown(browser, report, 1200, color_scheme=scheme)
        assert set(page.evaluate(INKS)) == {page.evaluate("getComputedStyle(document.body).color")}
        page.context.close()
