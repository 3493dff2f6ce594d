"""The rule by which answers are judged."""

from __future__ import annotations

import math
from typing import Any

import pytest

from benchmarks.hidden_effects.scoring import judge


def _answer(*hidden: tuple[str, str | None, dict[str, float]], verdict: str = "named") -> dict[str, Any]:
    return {
        "hidden": [
            {"mechanism": name, "location": place, "true_location": place, "size": size, "strength": 1.0}
            for name, place, size in hidden
        ],
        "size": {key: value for _, _, size in hidden for key, value in size.items()},
        "verdict": verdict,
        "may_be_unnamed": False,
        "group": "mechanics",
    }


def _finding(name: str, place: str | None, p: float, value: float = 1.0, *alike: str) -> dict[str, Any]:
    numbers = [{"name": "gap_rad", "value": value, "low": 0.9 * value, "high": 1.1 * value}]
    return {
        "mechanism": name,
        "location": place,
        "probability": p,
        "parameters": numbers,
        "indistinguishable_from": list(alike),
    }


def _document(*findings: dict[str, Any], verdict: str = "named", **rest: object) -> dict[str, Any]:
    return {"verdict": verdict, "findings": list(findings), "unexplained": None, **rest}


BACKLASH = _answer(("backlash", "output", {"gap_rad": 1.0}))
NOTHING = _answer(verdict="nothing_missing")
UNNAMED = _answer(("unnamed", None, {"frequency_hz": 9.0}), verdict="unnamed")


@pytest.mark.parametrize(
    ("answer", "document", "outcome"),
    [
        (BACKLASH, _document(_finding("backlash", "output", 0.9)), "right"),
        (BACKLASH, _document(_finding("backlash", "transfer", 0.9)), "wrong place"),
        (BACKLASH, _document(_finding("stiffness_hardening", "output", 0.9, 1.0, "backlash")), "right"),
        (BACKLASH, _document(_finding("hysteresis", "output", 0.9, 1.0, "a", "b", "backlash")), "wrong"),
        (BACKLASH, _document(_finding("hysteresis", "output", 0.9)), "wrong"),
        (BACKLASH, _document(_finding("backlash", "output", 0.4), verdict="nothing_missing"), "missed"),
        (BACKLASH, _document(_finding("backlash", "output", 0.9), _finding("hysteresis", None, 0.6)), "wrong"),
        (BACKLASH, _document(verdict="unnamed"), "missed"),
        (BACKLASH, None, "failed"),
        (NOTHING, _document(verdict="nothing_missing"), "right"),
        (NOTHING, _document(verdict="unnamed"), "false alarm"),
        (NOTHING, _document(_finding("backlash", "output", 0.7)), "false alarm"),
        (UNNAMED, _document(verdict="unnamed", unexplained={"frequency_hz": 9.5}), "right"),
        (UNNAMED, _document(verdict="unnamed") | {"unexplained": {"frequency_hz": 18.0}}, "wrong place"),
        (UNNAMED, _document(_finding("backlash", "output", 0.7)), "wrong"),
        (UNNAMED, _document(verdict="nothing_missing"), "missed"),
    ],
)
def test_outcome(answer: dict[str, Any], document: dict[str, Any] | None, outcome: str) -> None:
    judgement = judge(answer, document)
    assert judgement.outcome == outcome
    assert judgement.solved == (outcome == "right")


def test_one_of_two_is_incomplete() -> None:
    answer = _answer(("backlash", "output", {"gap_rad": 1.0}), ("viscous_friction", None, {}))
    assert judge(answer, _document(_finding("backlash", "output", 0.9))).outcome == "incomplete"
    both = _document(_finding("backlash", "output", 0.9), _finding("viscous_friction", "motor", 0.8))
    assert judge(answer, both).outcome == "right"


def test_sizes_within_fifteen_percent_and_angles_within_two_degrees_across_the_turn() -> None:
    (check,) = judge(BACKLASH, _document(_finding("backlash", "output", 0.9, 1.14))).sizes
    assert (check.within, check.covered) == (True, False)
    (check,) = judge(BACKLASH, _document(_finding("backlash", "output", 0.9, 1.16))).sizes
    assert not check.within
    answer = _answer(("tooth_damage", "output", {"angle_rad": 0.01}))
    finding = _finding("tooth_damage", "output", 0.9)
    finding["parameters"] = [{"name": "angle_rad", "value": 2 * math.pi - 0.01, "low": 6.2, "high": 6.3}]
    (check,) = judge(answer, _document(finding)).sizes
    assert check.error == pytest.approx(0.02)
    assert check.within
    assert check.covered
