"""The first hour on one's own axis: from nothing to how well the library does there, and what is said on the way."""

import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import soundfile
import soxr
from playwright.sync_api import Browser, Page, expect

from app.report.formatting import ENVIRONMENT
from app.web.first_hour import Hour
from benchmarks.harness.live import started
from benchmarks.harness.site import Site
from benchmarks.harness.sounds import RATE_HZ, hum
from casebase.reasoning.evaluation import Evaluation, Outcome, Proportion
from casebase.search.axis_cases import LabelCases
from casebase.store.models import AxisRevision
from tests.web.conftest import ARGUMENTS, NAMES, sign_in, watched

CAPTURED_HZ = 48_000
SECONDS = 8.0
SENTENCES: Any = ENVIRONMENT.get_template("_hour.html").module


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[Page]:
    """The first page of a service with an empty data directory, in a browser whose microphone hears a gearbox."""
    heard = tmp_path / "heard.wav"
    soundfile.write(heard, soxr.resample(hum(SECONDS, 1), RATE_HZ, CAPTURED_HZ), CAPTURED_HZ, subtype="PCM_16")
    fake = ("--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream")
    path = next(found for name in NAMES if (found := shutil.which(name)))
    capture = f"--use-file-for-fake-audio-capture={heard}"
    server = started(tmp_path / "data", worker=True)
    running = browser.browser_type.launch(executable_path=path, args=[*ARGUMENTS, *fake, capture])
    context, site = running.new_context(), Site(server, heard)
    sign_in(context, site, "admin")
    try:
        with watched(context.new_page(), site, "/") as opened:
            yield opened
    finally:
        running.close()
        server.stop()


@pytest.mark.browser
def test_the_first_hour_from_an_empty_data_directory(page: Page) -> None:
    """Describe an axis, record it with the microphone, simulate its cases, read how well it does and what is next."""
    page.get_by_role("link", name="the first hour on your axis").click()
    page.get_by_role("link", name="Spur or helical gears").click()
    page.get_by_label("Name of the axis").fill("wrist")
    page.get_by_label("Stiffness of the whole gear").fill("2e5")
    page.get_by_role("button", name="Add the axis").click()
    page.wait_for_url("**/axes/wrist/first-hour")
    banner, answers = page.locator("#next"), page.locator("#answers")
    expect(banner).to_contain_text("Next: Record its gearbox.")
    expect(answers).to_contain_text("Nothing is known yet")
    form = page.locator("#record form")
    form.get_by_role("button", name="Record now").click()
    expect(form.locator("[data-said]")).to_contain_text(re.compile(r"^[5-9] s"))
    form.get_by_role("button", name="Stop").click()
    expect(form.locator("[data-detected]")).to_contain_text(" MB, ")
    form.get_by_label("Gearbox (serial number)").fill("w1")
    form.get_by_label("How it was verified").select_option("opened")
    form.get_by_role("button", name="Check and keep it").click()
    page.wait_for_url("**recorded=*")
    expect(page.locator("#record tbody tr")).to_contain_text(["w1"])
    expect(page.locator("#record")).to_contain_text("1 measured case of 1 gearbox: 1 no fault.")
    expect(banner).to_contain_text("Next: Simulate its cases.")
    page.get_by_label("Cases of each of no fault, backlash, tooth damage").fill("1")
    page.get_by_role("button", name="Simulate", exact=True).click()
    simulated = page.locator("#simulated")
    expect(simulated).to_contain_text("3 simulated cases: 1 no fault, 1 tooth damage and 1 backlash.", timeout=120_000)
    expect(answers).to_contain_text(re.compile(r"it names [01] of 1 of your recordings rightly"), timeout=120_000)
    expect(answers).to_contain_text("whether it hears one is known from simulation alone")
    expect(banner).to_contain_text("Record 4 more normal recordings of gearbox w1.")
    for step, state in (("describe", "done"), ("simulate", "done"), ("how-well", "open")):
        expect(page.locator(f"#{step}-state")).to_have_text(state)


def hour(
    cases: Mapping[str, LabelCases], outcomes: tuple[Outcome, ...] = (), boxes: int = 0, stiffness: float | None = 1e5
) -> Hour:
    """Where an axis with these cases stands."""
    document = {"name": "bench", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 40.0}}
    stages = [{"name": "output", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": stiffness}]
    row = AxisRevision(name="bench", revision=1, document={**document, "stages": stages})
    nothing = Proportion(0, 0)
    found = Evaluation("gearbox", "both", len(outcomes), 0, boxes, nothing, nothing, nothing, {}, {}, {}, outcomes)
    return Hour(row, cases, (), None, found, boxes)


def outcome(case: str, answer: str, verdict: str = "diagnosed", origin: str = "measured") -> Outcome:
    return Outcome(case, origin, "g1", "normal", answer, verdict, 0.95)


def test_no_more_is_said_than_is_known() -> None:
    """Simulated answers are no measured ones, one gearbox is no two, and none of no fault says nothing of a fault."""
    simulated = {label: LabelCases(simulated=20) for label in ("normal", "notch", "play")}
    of_simulated = tuple(outcome(f"s{k}", "normal", origin="simulated") for k in range(20))
    words = SENTENCES.how_well(hour(simulated, of_simulated))
    assert "Of simulated gearboxes of this axis it names 20 of 20 rightly." in words
    assert "on your gearbox is not known" in words
    assert not hour(simulated, of_simulated).done["how-well"]
    kept = {**simulated, "normal": LabelCases(measured=5, gearboxes=frozenset({"g1"}), simulated=20)}
    answered = tuple(outcome(f"m{k}", "normal", "ambiguous" if k == 4 else "diagnosed") for k in range(5))
    whole = hour(kept, answered + of_simulated, boxes=1)
    assert "it names 4 of 5 of your recordings rightly" in SENTENCES.how_well(whole)
    assert "known from simulation alone" in SENTENCES.how_well(whole)
    kinds = {one.kind for one in whole.advice}
    assert "normal" not in kinds, "five are enough"
    assert {"second", "fault"} <= kinds


def test_what_is_named_wrongly_is_shown() -> None:
    kept = {"normal": LabelCases(measured=5, gearboxes=frozenset({"g1", "g2"}))}
    answered = (outcome("m0", "play"), *(outcome(f"m{k}", "normal") for k in range(1, 5)))
    known = hour(kept, answered, 2)
    assert "/cases/m0" in [one.path for one in known.advice]
    assert any("1 case of no fault" in SENTENCES.advised(one, known) for one in known.advice)


@pytest.mark.parametrize(("right", "of", "done"), [(0, 3, False), (3, 3, False), (5, 5, True)])
def test_a_library_that_names_too_little_rightly_is_not_done(right: int, of: int, done: bool) -> None:
    kept = {"normal": LabelCases(measured=of, gearboxes=frozenset({"g1", "g2"}))}
    answered = tuple(outcome(f"m{k}", "normal" if k < right else "play") for k in range(of))
    assert hour(kept, answered, 2).done["how-well"] == done


def test_a_description_that_cannot_be_simulated_is_to_be_completed() -> None:
    kept = {"normal": LabelCases(measured=5, gearboxes=frozenset({"g1"}))}
    rigid = hour(kept, stiffness=None)
    assert not rigid.done["simulate"]
    assert rigid.next.kind == "complete"
    assert "stiffness" in SENTENCES.advised(rigid.next, rigid)
    assert hour(kept).next != rigid.next
    few = {"normal": LabelCases(measured=1, gearboxes=frozenset({"g1"}))}
    assert hour(few, stiffness=None).advice[0].kind == "normal", "there is more to do than that"
