"""What a page says of a diagnosis: no more than the document bears out."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.commands.diagnose import is_fault
from app.report.charts import envelope
from app.report.diagnosis_view import evidence_of, facts_of
from app.report.formatting import NO_BREAK, percent
from app.report.svg import Series, line_chart
from app.report.words import CHECKS, remarks_beside, verdict_of
from sim.mechanisms import MECHANISMS
from sim.mechanisms.mechanism import Discriminating


def hypotheses(*probabilities: float) -> list[dict[str, Any]]:
    """Notch, play, and normal, which is excluded."""
    given = zip(("notch", "play", "normal"), probabilities, (0.9, 0.2, 0.01), strict=True)
    support = {"measured": 2, "simulated": 3}
    return [{"label": label, "probability": p, "p_value": q, "support": support} for label, p, q in given]


def document(**changes: object) -> dict[str, Any]:
    """A diagnosis of a notch with a size, a rejected rival and one that is still possible."""
    return {
        "verdict": "diagnosed",
        "label": "notch",
        "probability": 0.9,
        "hypotheses": hypotheses(0.9, 0.08, 0.02),
        "fault": {"present": None, "probability": None},
        "labels": ["notch"],
        "faults": [{"label": "notch", "probability": 0.9}],
        "remarks": [],
        "quality": [],
        "severity": {"parameter": "depth_rad", "value": 1.4e-3, "low": 5.6e-4, "high": 3.7e-3, "cases": 30},
        "evidence": [
            {"kind": "event", "quantity": "notch_phase", "value": 263.0, "statement": "an impact", "unit": "deg"},
            {"kind": "event", "quantity": "play_phase", "value": 329.0, "statement": "an impact", "unit": "deg"},
        ],
        "novelty": {"distance": 0.1, "threshold": 0.4},
        "provenance": {"gearboxes": 4},
        **changes,
    }


@pytest.mark.parametrize(("gearboxes", "doubt"), [(0, ", not calibrated"), (1, ", not calibrated"), (2, ""), (40, "")])
def test_how_sure_is_in_per_cent_and_says_where_not_calibrated(gearboxes: int, doubt: str) -> None:
    told = document(provenance={"gearboxes": gearboxes})
    assert f"How sure: {percent(0.9)}{doubt}. " in verdict_of(told).summary
    assert facts_of(told)[0][:2] == ("How sure", percent(0.9))
    assert ("not calibrated" in facts_of(told)[0][2]) == (gearboxes < 2)


def undecided(**changes: object) -> dict[str, Any]:
    """A fault for sure, of which the library cannot tell whether it is a notch or play."""
    given: dict[str, Any] = {
        "verdict": "ambiguous",
        "probability": 0.897,
        "hypotheses": hypotheses(0.897, 0.1, 0.003),
        "fault": {"present": True, "probability": 0.97},
        "labels": ["notch", "play"],
        "severity": None,
    }
    return document(**(given | changes))


def test_what_is_excluded_is_not_left() -> None:
    summary = verdict_of(undecided()).summary
    assert "backlash" in summary
    assert "no fault" not in summary
    assert "excluded" in verdict_of(undecided(labels=[])).summary, "nothing is left"


def test_of_a_fault_that_is_undecided_no_fault_is_headline() -> None:
    maybe = undecided(fault={"present": None, "probability": 0.62})
    assert "Fault likely" not in verdict_of(maybe).headline
    assert is_fault(undecided())
    assert is_fault(document())
    assert not is_fault(document(label="normal", fault={"present": False, "probability": 0.03}))
    assert not is_fault({"error": "no such file"})


SHORT = {"name": "too_short_for_motion", "severity": "poor", "reason": "the recording covers 0.8 cycles"}


@pytest.mark.parametrize("verdict", ["not_in_library", "ambiguous", "unusable"])
def test_of_a_recording_that_is_too_short_that_is_said_and_not_to_inspect_the_gearbox(verdict: str) -> None:
    named = {"label": None, "probability": None} if verdict != "ambiguous" else {}
    told = verdict_of(undecided(verdict=verdict, quality=[SHORT], remarks=["the recording is too poor"], **named))
    assert "too short" in told.headline or "cycles" in told.sure
    assert "unlike every known kind" not in told.headline
    assert not any("inspected" in check for check in told.checks)
    assert told.sure.count("cycles") <= 1
    assert told.again
    assert percent(0.897) not in told.sure


@pytest.mark.parametrize(("present", "said"), [(True, "A fault is likely"), (None, "also be good")])
def test_of_what_is_too_short_it_is_said_if_a_fault_is_likely(present: bool | None, said: str) -> None:
    told = verdict_of(undecided(quality=[SHORT], fault={"present": present, "probability": 0.8}))
    assert said in told.sure.partition(".")[0]
    assert told.open == ("notch", "play")


def test_no_fault_says_what_the_motion_cannot_show() -> None:
    told = document(label="normal", remarks=["no fault does not cover 52% of the turn of output"], detection_limit={})
    assert "No fault does not cover 52% of the turn of output." in verdict_of(told).sure
    assert remarks_beside(told) == []
    faulty = document(remarks=told["remarks"])
    assert remarks_beside(faulty) == told["remarks"]


def test_a_step_by_hand_begins_with_securing() -> None:
    """A load that nobody supports drops when the brake is released."""
    steps = [step for checks in CHECKS.values() for step in checks]
    steps += [text for kind in MECHANISMS.values() for text in (kind.action, kind.check)]
    steps += [way.value for way in Discriminating]
    moved = [step for step in steps if re.search(r"by hand|without current|brake open|[Oo]pen the|endoscope {", step)]
    assert len(moved) >= 7
    for step in moved:
        assert "may drop when the brake is released" in step


def test_a_check_has_the_time_in_the_cycle() -> None:
    period = {"kind": "motion", "quantity": "motion_period", "value": 4.0, "statement": "the motion", "unit": "s"}
    told = document(evidence=[*document()["evidence"], period])
    assert f"2.92{NO_BREAK}s after the first reversal" in verdict_of(told).checks[0]
    assert "time" not in verdict_of(document()).checks[0]


def test_evidence_with_no_share_is_not_shown() -> None:
    side = {"label": "notch", "low": 3.0, "high": 9.0}
    rows = [
        {"kind": "feature", "quantity": "rms", "value": 1.0, "unit": "1", "same": side, "other": None, "share": share}
        for share in (0.6, 0.004)
    ]
    shown = evidence_of(document(evidence=rows), (), {})["compared"]
    assert [row["share"] for row in shown] == [percent(0.6)]


def test_evidence_leads_only_to_plots_that_are_drawn() -> None:
    drawn = evidence_of(document(), {"fold"}, {"notch": 2.5})["seen"]
    assert [(row["plot"], row["at_s"]) for row in drawn] == [("fold", 2.5), ("fold", None)]
    assert [row["plot"] for row in evidence_of(document(), {"waveform"}, {})["seen"]] == [None, None]


@given(st.integers(2, 20_000), st.integers(100, 3000), st.integers(0, 2**32 - 1))
def test_envelope_loses_no_peak(samples: int, points: int, seed: int) -> None:
    """However long the sound, at most the points asked for are sent, and the largest and smallest are among them."""
    sound = np.random.default_rng(seed).standard_normal(samples).astype(np.float32)
    shown = envelope(sound, 8000.0, points)
    assert shown.x.size == shown.y.size <= points + 2
    assert shown.y.max() == sound.max()
    assert shown.y.min() == sound.min()
    assert np.all(np.diff(shown.x) >= 0)


def test_line_is_broken_where_nothing_was_measured() -> None:
    x = np.arange(5.0)
    series = Series("s", x, np.array([0.0, 1.0, np.nan, 1.0, 0.0]))
    drawn = line_chart("t", [series], "x", "y")
    path = drawn.split('class="series s1" d="')[1].split('"')[0]
    assert path.count("M") == 2
