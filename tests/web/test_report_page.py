"""The report in a real browser: readable on a phone and in the dark, with no access to anything."""

from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route

from app.http.headers import self_contained
from app.report.investigation_report import investigation_report
from benchmarks.harness.telemetry_of import one_body, swing
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate
from sim.investigation.report.summary import story

SMALLEST = """[...document.querySelectorAll("svg text")].map(
    one => parseFloat(getComputedStyle(one).fontSize) * Math.hypot(one.getScreenCTM().a, one.getScreenCTM().b))"""
LOOKS = """[...document.querySelectorAll("h1, svg *")].map(one => {
    const look = getComputedStyle(one);
    return ["fill", "stroke", "strokeWidth", "fontSize", "textAnchor", "color"].map(name => look[name]).join(" ")})"""


@pytest.fixture(scope="module")
def report() -> str:
    _, _, speed, _ = swing()
    motor = {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
    axis = read_axis({"name": "one body", "motor": motor, "load": {"inertia_kg_m2": 0.0}})
    rise = 0.6 * np.exp(-((speed / 6.0) ** 2)) * np.tanh(speed / 0.01)
    result = investigate(axis, one_body(0.3, 1.0, 0.02, 6, extra=rise))
    return investigation_report({**result.document(), "story": story(result)}, axis)


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
    page.evaluate("document.querySelectorAll('details').forEach(one => (one.open = true))")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert min(page.evaluate(SMALLEST)) >= (9.0 if width >= 390 else 8.0)
    assert asked == []
    page.context.close()


@pytest.mark.browser
def test_what_is_folded_is_printed(browser: Browser, report: str) -> None:
    page, _ = shown(browser, report, 1200)
    seen = "[...document.querySelectorAll('details figure')].map(one => one.checkVisibility())"
    assert not any(page.evaluate(seen))
    page.emulate_media(media="print")
    assert all(page.evaluate(seen))
    page.context.close()


@pytest.mark.browser
def test_the_policy_lets_its_own_styles_in_and_no_other(browser: Browser, report: str) -> None:
    """It looks as the file does, where the policy is not there; a style that somebody added is refused."""
    answer = self_contained(report)
    assert "unsafe" not in answer.headers["content-security-policy"]
    evil = bytes(answer.body).decode().replace("</body>", "<style>h1{color:red}</style></body>")
    plain, _ = looked_at(browser, report, {})
    allowed, told = looked_at(browser, evil, {"content-security-policy": answer.headers["content-security-policy"]})
    assert plain == allowed
    assert len(plain) > 50
    assert len([text for text in told if "Content Security Policy" in text]) == 1


def looked_at(browser: Browser, body: str, headers: dict[str, str]) -> tuple[list[str], list[str]]:
    """How the parts of a page look that is served with these headers, and what the browser says of it."""

    def serve(route: Route) -> None:
        route.fulfill(body=body, headers={**headers, "content-type": "text/html; charset=utf-8"})

    context = browser.new_context()
    page = context.new_page()
    told: list[str] = []
    page.on("console", lambda message: told.append(message.text))
    page.route("http://report.example/", serve)
    page.goto("http://report.example/")
    looks: list[str] = page.evaluate(LOOKS)
    context.close()
    return looks, told
