"""The report tells every step in order, with a floor in every plot of what is left, and an action for every cause."""

import re
from dataclasses import replace
from html import unescape
from typing import Any

import numpy as np
import pytest

from casebase.signals.telemetry import Telemetry
from sim.description.axis_document import read_axis
from sim.discrepancy.hypotheses.catalogue import terms_of
from sim.discrepancy.investigation import advised, investigate
from sim.discrepancy.report.box import box_of, refused, size_of, unexplained_words
from sim.discrepancy.report.cause_panels import cause_panels
from sim.discrepancy.report.checks import checked
from sim.discrepancy.report.drawing import svg
from sim.discrepancy.report.formatting import angle, interval, number, percent
from sim.discrepancy.report.html import STEPS, html_report
from sim.discrepancy.report.maintenance_actions import action, measurement
from sim.discrepancy.report.panels import AS_DESCRIBED, EXTENDED, FLOOR, MEASURED, Panel
from sim.discrepancy.report.residual_panels import TAKEN
from sim.discrepancy.report.summary import candidates, panels, story
from sim.discrepancy.report.wording import explain, headline, next_measurement
from sim.discrepancy.results import Estimate, Finding, Investigation
from sim.discrepancy.search.proposals import Rival
from sim.discrepancy.unexplained import Unexplained, unexplained_document, unexplained_of
from sim.mechanisms import MECHANISMS
from sim.mechanisms.mechanism import Mechanism
from tests.sim.discrepancy.acoustic.test_fusion import AXIS, recording, running
from tests.sim.discrepancy.telemetry_of import one_body, swing

MOTOR = {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02}
BODY = read_axis({"name": "one <body>", "motor": MOTOR, "load": {"inertia_kg_m2": 0.0}})
DENT = {"angle_rad": 2.7, "depth_rad": 9e-4, "form": 2.0}


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


PAGES: dict[int, str] = {}


def page_of(result: Investigation) -> str:
    """The report of a result that lives as long as this module."""
    return PAGES.setdefault(id(result), PAGES.get(id(result)) or html_report(result))


def words(page: str) -> str:
    return unescape(re.sub(r"<svg.*?</svg>|<style>.*?</style>|<[^>]+>", " ", page, flags=re.DOTALL))


def finding(mechanism: str, probability: float = 0.95, **given: Any) -> Finding:
    return Finding(mechanism, "output", probability, (), (), "", **given)


def test_every_step_is_told_in_order(any_result: Investigation) -> None:
    headings = re.findall(r"<h2>\d+\. (.*?)</h2>", page_of(any_result))
    assert tuple(unescape(one) for one in headings) == STEPS


def test_the_report_loads_nothing_and_fits_a_phone(any_result: Investigation) -> None:
    page = html_report(any_result, ["a <b>.csv"])
    bare = re.sub(r'xmlns(:\w+)?="[^"]*"', "", page)
    assert not re.search(r'<script|<link|<img|@import|url\(["\']?http|(src|href)="(?!#)', bare)
    assert '<meta name="viewport" content="width=device-width' in page
    assert "a &lt;b&gt;.csv" in page
    assert "<b>" not in page
    for table in re.finditer("<table>", page):
        assert page[: table.start()].endswith('<div class="scroll" tabindex="0">')


def test_it_begins_with_what_a_technician_needs(rising: Investigation) -> None:
    box = words(page_of(rising).split("</header>")[0])
    for told in ("What ", "Where ", "How sure ", "Do first ", "Not examined", "Next measurement "):
        assert told in box
    assert percent(rising.findings[0].probability) in box
    assert "rolling bearings were not examined" in box


def test_the_plot_of_a_mechanism_is_the_torque_that_was_hidden(rising: Investigation) -> None:
    """Over speed, away from where friction turns its sign: the law itself, and as described none of it."""
    (panel,) = cause_panels(rising)
    assert panel is not None
    lines, law = dict(panel.lines), 0.6 * np.exp(-((panel.x / 6.0) ** 2)) * np.sign(panel.x)
    moving = np.abs(panel.x) > 3.0
    for name in (MEASURED, EXTENDED):
        assert np.abs(lines[name] - law)[moving].max() < 0.1 * 0.6
    assert not lines[AS_DESCRIBED].any()


@pytest.mark.parametrize("mechanism", sorted(MECHANISMS))
def test_every_mechanism_has_the_four_answers(good: Investigation, mechanism: str) -> None:
    """In words without a blank to fill in; below 0.5 it is only suspected and stands below what is said."""
    numbers = {**DENT, "frequency_hz": 12.0, "order": 2.0, "speed_rad_s": 3.0, "amplitude_rad": 1e-3, "gap_rad": 1e-3}
    kind = MECHANISMS[mechanism]
    known = {p.name: numbers.get(p.name, p.default) for p in kind.parameters}
    estimates = tuple(Estimate(p.name, known[p.name], p.unit, known[p.name], known[p.name]) for p in kind.parameters)
    place = next((place for place in kind.locations(AXIS) if place), None)
    told = Finding(mechanism, place, 0.95, estimates, (), explain(mechanism, place, known))
    document = replace(good, axis=AXIS, verdict="named", findings=(advised(AXIS, told), finding("backlash", 0.4)))
    entry, suspected = box_of(document.document(), AXIS)
    assert [name for name, _ in entry.facts] == ["What", "Where", "How sure", "Do first"]
    assert all(text and "{" not in text for _, text in entry.facts)
    assert "_" not in f"{entry.what}{entry.where}"
    assert entry.do_first.endswith(".")
    assert suspected.title == "Suspected: backlash (play)"


def test_the_box_says_what_to_do_where_nothing_has_a_name(good: Investigation) -> None:
    (nothing,) = box_of(good.document(), BODY)
    unnamed = replace(good, verdict="unnamed", unexplained=Unexplained("speed", "motor_torque_nm", 0.4, 9.0, {}))
    (without,) = box_of(unnamed.document(), BODY)
    for entry in (nothing, without, refused("telemetry has no torque: name it.")):
        assert all(text for _, text in entry.facts)
        assert "Change no parts" in entry.do_first
    assert good.next_measurement in without.do_first
    assert "name it" in refused("telemetry has no torque: name it.").do_first


def test_small_angles_stand_in_minutes_of_arc_with_their_interval() -> None:
    """0.0012 rad are 4.13 minutes: 1 rad is 3437.75."""
    size = size_of("backlash", {"name": "gap_rad", "value": 0.0012, "unit": "rad", "low": 0.0011, "high": 0.0013})
    assert size.value == "0.00120 rad (4.1\xa0arc min)"
    assert size.interval == "0.00110 to 0.00130 rad (3.8 to 4.5\xa0arc min)"


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


def test_the_condition_is_told_even_where_all_is_well(any_result: Investigation) -> None:
    rows = dict(checked(any_result))
    for check in (
        "rows or samples missing, or held while it moves",
        "values cut at their extremes",
        "hum of the mains",
    ):
        assert rows[check].startswith("none found")
    page = words(page_of(any_result))
    told: Any = story(any_result)["checked"]
    assert [(one["check"], one["result"]) for one in told] == list(checked(any_result))
    assert all(result in page for result in rows.values())


def test_a_fault_of_the_recording_stands_in_its_condition() -> None:
    whole = one_body(0.3, 1.0, 0.02, 9)
    kept = np.ones(whole.rows, dtype=bool)
    kept[3000:3100] = False
    gap = Telemetry(whole.time_s[kept], {name: values[kept] for name, values in whole.channels.items()})
    result = investigate(BODY, gap)
    assert headline(result).startswith("The measurement has faults: lost samples.")
    assert "100 rows are missing" in dict(checked(result))["rows or samples missing, or held while it moves"]


def test_a_model_that_was_not_extended_is_not_drawn(good: Investigation) -> None:
    assert "with what was found" not in page_of(good)


def test_noise_that_was_taken_away_is_drawn_beside_what_is_left(good: Investigation) -> None:
    assert good.selection is not None
    assert good.gate is not None
    assert TAKEN not in page_of(good)
    assert any(remark.startswith("Without reference_position_rad") for remark in good.remarks)
    noise = 0.1 * np.random.default_rng(3).standard_normal(good.gate.measurement.samples)
    louder = replace(good.gate.measurement, torque=good.gate.measurement.torque + noise)
    drawn = panels(replace(good, gate=replace(good.gate, measurement=louder)))[0][3]
    lines = dict(drawn.lines)
    assert [*lines][-1] == FLOOR
    rate_hz = good.gate.measurement.rate_hz
    assert np.median(lines[TAKEN]) == pytest.approx(10.0 * np.log10(2.0 * 0.1**2 / rate_hz), abs=1.0)


def test_a_bad_model_does_not_widen_the_noise_floor(rising: Investigation) -> None:
    """The description leaves friction, the extended model does not: the floor is that of the better one."""
    assert rising.selection is not None
    left = next(panel for panel in panels(rising)[0] if panel.title == "Motor torque: residual")
    worse = replace(rising, selection=replace(rising.selection, fit=rising.selection.base))
    floor = next(panel for panel in panels(worse)[0] if panel.title == "Motor torque: residual")
    assert left.noise is not None
    assert floor.noise is not None
    assert left.noise[1] <= floor.noise[1] * 1.001


@pytest.fixture(scope="module")
def weighed(good: Investigation) -> Investigation:
    """With candidates that explain much and little, of a size as new and beyond it."""
    selection = good.selection
    assert selection is not None
    problem = selection.problem
    offset, *_ = (
        t for t in terms_of(BODY, problem.measurement, problem.chain((), {})) if t.mechanism == "torque_offset"
    )
    rivals = tuple(
        Rival(offset, gain, {}, beyond)
        for gain, beyond in ((-3.0, 5.0), (900.0, -1.0), (900.0, 1.5), (4.0, 5.0), (900.0, 9.0))
    )
    return replace(good, selection=replace(selection, rejected=rivals))


def test_what_was_rejected_has_a_reason_and_no_probability(weighed: Investigation) -> None:
    found = candidates(weighed)
    assert len({candidate.reason for candidate in found}) == len(found) == 5
    assert all("probability" not in candidate.document() for candidate in found)
    told: Any = story(weighed)["candidates"]
    assert [one["reason"] for one in told] == [candidate.reason for candidate in found]
    section = page_of(weighed).split("4. Candidate causes")[1].split("</details>")[0]
    assert "%" not in words(section)
    assert all(candidate.reason in words(section) for candidate in found)


def test_what_is_needed_parts_those_that_explain_too_little(weighed: Investigation) -> None:
    for candidate in candidates(weighed):
        assert candidate.explains is not None
        assert candidate.needed is not None
        less = candidate.explains < candidate.needed
        assert less == ("explains" in candidate.reason and "another" not in candidate.reason)


@pytest.mark.parametrize("mechanism", sorted(MECHANISMS))
def test_there_is_something_to_do_and_to_measure_about_every_mechanism(mechanism: str) -> None:
    numbers = {"frequency_hz": 12.0, **DENT}
    for text in (
        action(AXIS, mechanism, "output", numbers, 0.95),
        measurement(AXIS, mechanism, "output", numbers),
        measurement(AXIS, mechanism, None, {}),
        action(AXIS, mechanism, None, {}, 0.95),
    ):
        assert text.endswith(".")
        assert "{" not in text
        assert "nan" not in text or mechanism == "structural_resonance"
    assert action(AXIS, mechanism, "output", numbers, 0.6).startswith("It is not sure yet")


@pytest.mark.parametrize("kind", MECHANISMS.values(), ids=MECHANISMS.keys())
def test_every_mechanism_of_the_catalogue_has_an_action_and_a_check_of_its_own(kind: type[Mechanism]) -> None:
    assert kind.action != Mechanism.action
    assert kind.check != Mechanism.check


def test_a_damaged_tooth_is_to_be_looked_for_at_its_angle_and_number_soon() -> None:
    text = action(AXIS, "tooth_damage", "output", DENT, 0.95)
    assert "154.7°" in text
    assert "tooth 65 of 150" in text
    assert "Within a week" in text
    assert "Before the next shift" in action(AXIS, "tooth_damage", "output", {**DENT, "form": 10.0}, 0.95)


def test_the_document_says_what_to_do_last(rising: Investigation) -> None:
    told: Any = rising.document()["findings"]
    assert told[0]["explanation"].endswith(rising.findings[0].action)
    assert rising.findings[0].action


def test_a_fault_of_the_measurement_is_none_of_the_machine(good: Investigation) -> None:
    lost = replace(good, verdict="named", findings=(finding("lost_samples"),))
    assert headline(lost).startswith("The measurement has faults: lost samples.")
    both = replace(good, verdict="named", findings=(finding("backlash"), finding("lost_samples")))
    assert headline(both) == "Found: backlash (play) at output. The measurement also has faults: lost samples."


def test_a_sound_says_what_was_listened_for_and_what_was_not(heard: Investigation) -> None:
    assert headline(heard).startswith("No fault is heard. Listened for:")
    assert "nothing else was examined" in headline(heard)
    box = words(page_of(heard).split("</header>")[0])
    assert "Not examined" in box
    assert "friction, stiffness" in box


def test_what_is_unexplained_is_never_more_than_all() -> None:
    text = unexplained_words(Unexplained("frequency", "motor_torque_nm", 36.7, 9.0, {"frequency_hz": 9.1}))
    assert percent(1.0) in text
    assert "9.10 Hz" in text


def test_every_number_of_what_has_no_name_is_said() -> None:
    """Half of what both encoders differ by, peak to peak, is an angle."""
    rest = Unexplained("error_over_angle", "load_position_rad", 0.3, 9.0, {"error_rad": 1e-3})
    assert "error of 3.44\xa0arc min" in unexplained_words(rest)
    assert unexplained_of(unexplained_document(rest)) == rest


def test_the_next_measurement_tells_rivals_apart_and_never_compares_a_fault_with_itself() -> None:
    faults = [advised(AXIS, finding(name)) for name in ("lost_samples", "clipping", "time_delay", "torque_offset")]
    for fault in faults:
        text = next_measurement(AXIS, [fault], [], True)
        assert "compare the size" not in text
        assert text == MECHANISMS[fault.mechanism].check
    near = replace(finding("eccentricity"), indistinguishable_from=("encoder_error",))
    assert "dial gauge" in next_measurement(AXIS, [near], [], True)


def test_numbers_have_the_digits_that_their_interval_deserves() -> None:
    assert number(0.001190123, 0.00009) == "0.00119"
    assert interval(0.001100123, 0.001280321) == "0.00110 to 0.00128"
    assert number(152_712.0, 120.0) == "152\u202f710"
    assert number(0.0) == "0"
    assert number(3.2e-6, 5e-7) == "3.2 × 10⁻⁶"
    assert angle(np.radians(154.7), np.radians(0.3)) == "154.7°"
    assert angle(0.00119, 0.00009).endswith("arc min")


def test_names_of_shafts_are_text() -> None:
    x = np.linspace(0.0, 1.0, 5)
    drawn = svg(Panel('by "<b>" $x$', "<i> [°]", "y", "x", x, (("line", x), (FLOOR, x)), markers=((0.5, "<u>"),)))
    assert "<b>" not in drawn
    assert "<i>" not in drawn
    assert "<u>" not in drawn
    assert 'aria-label="by &quot;&lt;b&gt;&quot; $x$"' in drawn
