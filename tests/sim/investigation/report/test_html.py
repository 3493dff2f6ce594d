"""The report has every step in order, a floor in every plot of what is left, and an action for every cause."""

import re
from dataclasses import replace
from html import unescape
from typing import Any

import numpy as np
import pytest

from app.report.investigation_report import investigation_report
from benchmarks.harness.telemetry_of import one_body, swing
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate
from sim.investigation.report.cause_panels import cause_panels
from sim.investigation.report.panels import AS_DESCRIBED, EXTENDED, MEASURED
from sim.investigation.report.summary import panels, story
from sim.investigation.results import Investigation, Limit
from sim.mechanisms import MECHANISMS
from sim.mechanisms.mechanism import Mechanism
from tests.sim.investigation.acoustic.test_fusion import AXIS, recording, running

MOTOR = {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
BODY = read_axis({"name": "one <body>", "motor": MOTOR, "load": {"inertia_kg_m2": 0.0}})


@pytest.fixture(scope="module")
def rising() -> Investigation:
    """Friction that rises at low speed, which the description lacks."""
    _, _, speed, _ = swing()
    return investigate(
        BODY, one_body(0.3, 1.0, 0.02, 6, extra=0.6 * np.exp(-((speed / 6.0) ** 2)) * np.tanh(speed / 0.01))
    )


@pytest.fixture(scope="module")
def good() -> Investigation:
    return investigate(BODY, one_body(0.3, 1.0, 0.02, 9))


@pytest.fixture(scope="module")
def heard() -> Investigation:
    return investigate(AXIS, None, recording(running(17)))


@pytest.fixture(scope="module", params=["rising", "good", "heard"])
def any_result(request: pytest.FixtureRequest) -> Investigation:
    result: Investigation = request.getfixturevalue(request.param)
    return result


def page_of(result: Investigation) -> str:
    document = {**result.document(), "story": story(result)}
    return investigation_report(document, result.axis, ["a <b>.csv"])


def test_every_step_is_there_in_order_and_nothing_is_loaded(any_result: Investigation) -> None:
    page = page_of(any_result)
    assert [int(one) for one in re.findall(r"<h2>(\d+)\. ", page)] == list(range(1, 11))
    bare = re.sub(r'xmlns(:\w+)?="[^"]*"', "", page)
    assert not re.search(r'<script|<link|<img|@import|url\(["\']?http|(src|href)="(?!#)', bare)
    assert "a &lt;b&gt;.csv" in page
    assert "<b>" not in page


def test_what_limits_all_findings_stands_before_them(good: Investigation) -> None:
    first = page_of(replace(good, remarks=("Plain.", Limit("Use no number.")))).partition('<dl class="box">')[0]
    assert [each in first for each in ("Plain.", "Use no number.")] == [False, True]


def test_the_plot_of_a_mechanism_is_the_torque_that_was_hidden(rising: Investigation) -> None:
    """Over speed, away from where friction turns its sign: the law itself, and as described none of it."""
    (panel,) = cause_panels(rising)
    assert panel is not None
    lines, law = dict(panel.lines), 0.6 * np.exp(-((panel.x / 6.0) ** 2)) * np.sign(panel.x)
    moving = np.abs(panel.x) > 3.0
    for name in (MEASURED, EXTENDED):
        assert np.abs(lines[name] - law)[moving].max() < 0.1 * 0.6
    assert not lines[AS_DESCRIBED].any()


def test_what_is_left_is_always_held_against_its_noise(rising: Investigation, good: Investigation) -> None:
    for result in (rising, good):
        overlay, residual, _ = panels(result)
        left = [panel for panel in (*overlay, *residual) if "measured" not in dict(panel.lines)]
        assert len(left) >= 8
        assert all(panel.has_floor for panel in left)
        titles = " ".join(panel.title for panel in left)
        for by in ("angle", "order", "speed", "load", "direction", "time", "spectrum"):
            assert by in titles


def test_page_and_report_show_the_same_panels(any_result: Investigation) -> None:
    told: dict[str, Any] = story(any_result)
    drawn = re.findall("<figcaption>(.*?)</figcaption>", page_of(any_result))
    assert sorted(unescape(one) for one in drawn) == sorted(
        panel["title"] for part in ("causes", "overlay", "residual", "sound") for panel in told[part]
    )


def test_a_bad_model_does_not_widen_the_noise_floor(rising: Investigation) -> None:
    """The description leaves friction, the extended model does not: the floor is that of the better one."""
    assert rising.selection is not None
    left = next(panel for panel in panels(rising)[0] if panel.title == "Motor torque: residual")
    worse = replace(rising, selection=replace(rising.selection, fit=rising.selection.base))
    floor = next(panel for panel in panels(worse)[0] if panel.title == "Motor torque: residual")
    assert left.noise is not None
    assert floor.noise is not None
    assert left.noise[1] <= floor.noise[1] * 1.001


@pytest.mark.parametrize("kind", MECHANISMS.values(), ids=MECHANISMS.keys())
def test_every_mechanism_of_the_catalogue_has_an_action_and_a_check_of_its_own(kind: type[Mechanism]) -> None:
    assert kind.action != Mechanism.action
    assert kind.check != Mechanism.check


def test_the_document_says_what_to_do_last(rising: Investigation) -> None:
    told: Any = rising.document()["findings"]
    assert told[0]["explanation"].endswith(rising.findings[0].action)
    assert rising.findings[0].action
