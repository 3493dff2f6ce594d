"""The rule by which answers are judged."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.robot_bank.score import judge


def _answer(mechanism: str | None = None, place: str = "elbow", **more: Any) -> dict[str, Any]:
    hidden = []
    if mechanism:
        hidden = [
            {"mechanism": mechanism, "location": place, "as_parameter": False, "may_be_missed": False, "sizes": {}}
        ]
        hidden[0] |= more
    words = {"kind": mechanism or "null", "drives": "described", "motion": "fourier", "build": "elbow", "level": "full"}
    return {"hidden": hidden, "friction": {}, "noise": {"elbow": 0.5}, **words}


def _finding(mechanism: str, place: str, p: float = 0.95, *alike: str, **parameters: float) -> dict[str, Any]:
    return {
        "mechanism": mechanism,
        "location": place,
        "probability": p,
        "indistinguishable_from": list(alike),
        "parameters": [{"name": n, "value": v, "low": 0.9 * v, "high": 1.1 * v} for n, v in parameters.items()],
    }


def _document(*findings: dict[str, Any], verdict: str = "named", **more: Any) -> dict[str, Any]:
    return {"verdict": verdict, "findings": list(findings), "parameters": [], **more}


RIPPLE = _answer("torque_ripple", sizes={"torque_n_m": 2.0})


@pytest.mark.parametrize(
    ("document", "outcome"),
    [
        (_document(_finding("torque_ripple", "elbow")), "right"),
        (_document(_finding("torque_ripple", "elbow/output")), "right"),
        (_document(_finding("mesh_error", "elbow", 0.8, "torque_ripple")), "right"),
        (_document(_finding("mesh_error", "elbow", 0.8, "torque_ripple", "backlash", "hysteresis")), "wrong name"),
        (_document(_finding("torque_ripple", "elbow"), _finding("backlash", "wrist")), "and more"),
        (_document(_finding("torque_ripple", "elbow"), _finding("backlash", "wrist", 0.4)), "right"),
        (_document(_finding("torque_ripple", "wrist")), "wrong joint"),
        (_document(_finding("torque_ripple", "elbow", 0.4), verdict="nothing_missing"), "missed"),
        (_document(verdict="unnamed"), "unnamed"),
        (_document(_finding("payload", "payload")), "wrong joint"),
        (None, "failed"),
    ],
)
def test_what_is_hidden_counts_at_its_joint_and_alone(document: dict[str, Any] | None, outcome: str) -> None:
    assert judge(RIPPLE, document).outcome == outcome


def test_where_nothing_is_hidden_every_name_is_invented_but_friction_that_nobody_described() -> None:
    friction = _finding("coulomb_friction", "elbow", torque_n_m=3.3)
    bare = _answer() | {"friction": {"elbow": {"dry": 3.0, "viscous": 1.0}}}
    judged = judge(bare, _document(friction))
    assert judged.outcome == "right"
    assert judged.claims == ((0.95, True),)
    dry, viscous = judged.friction
    assert viscous is None
    assert dry is not None
    assert (dry.error, dry.covered) == (pytest.approx(0.1), True)
    assert judge(_answer(), _document(friction)).outcome == "invented"
    assert judge(bare, _document(_finding("stribeck_friction", "elbow"))).outcome == "invented"
    assert judge(_answer(), _document(verdict="unnamed")).outcome == "unnamed"


def test_a_number_that_is_described_otherwise_is_a_parameter_and_no_finding() -> None:
    answer = _answer("coulomb_friction", as_parameter=True, sizes={"coulomb_friction_n_m": 5.0})
    number = {"name": "elbow.motor.coulomb_friction_n_m", "nominal": 3.0, "estimate": 4.8, "low": 4.5, "high": 5.1}
    quiet = {"verdict": "nothing_missing", "parameters": [number]}
    assert judge(answer, _document(**quiet)).outcome == "right"
    assert judge(answer, _document(verdict="nothing_missing")).outcome == "missed"
    elsewhere = [number | {"name": "wrist.motor.coulomb_friction_n_m"}]
    assert judge(answer, _document(**quiet | {"parameters": elsewhere})).outcome == "missed"
    assert judge(answer, _document(_finding("coulomb_friction", "elbow"))).outcome == "wrong name"
