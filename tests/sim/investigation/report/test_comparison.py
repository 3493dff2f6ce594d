"""Two investigations side by side: what came and what went, and a size that changed by more than both leave open."""

from typing import Any

import numpy as np
import pytest

from sim.investigation.report.comparison import findings_compared, values_compared

HALF_OF_90 = 1.6449  # standard deviations of a normal distribution


def backlash(value: float, error: float, **other: Any) -> dict[str, Any]:
    half = HALF_OF_90 * error
    size = {"name": "gap_rad", "value": value, "unit": "rad", "low": value - half, "high": value + half}
    return {"mechanism": "backlash", "location": "output", "probability": 0.95, "parameters": [size], **other}


def ripple(order: float, probability: float = 0.95) -> dict[str, Any]:
    parameters = [
        {"name": "torque_n_m", "value": 0.1, "unit": "N m", "low": 0.09, "high": 0.11},
        {"name": "order", "value": order, "unit": "1", "low": order, "high": order},
    ]
    return {"mechanism": "torque_ripple", "location": "motor", "probability": probability, "parameters": parameters}


def found(*findings: dict[str, Any], **document: Any) -> dict[str, Any]:
    return {"findings": list(findings), "parameters": [], **document}


def became(before: dict[str, Any], after: dict[str, Any]) -> dict[str, str]:
    return {row.mechanism: row.became for row in findings_compared(before, after)}


def test_what_came_and_what_went() -> None:
    gap, wave = backlash(1e-3, 1e-5), ripple(6.0)
    assert became(found(gap), found(wave)) == {"torque_ripple": "came", "backlash": "went"}
    assert became(found(gap), found(gap)) == {"backlash": "as before"}
    assert became(found(), found()) == {}


def test_what_is_only_suspected_is_not_compared() -> None:
    assert became(found(), found(ripple(6.0, probability=0.4))) == {}


def test_what_could_not_be_examined_neither_came_nor_went() -> None:
    gap, blind = backlash(1e-3, 1e-5), {"not_examined": {"backlash": "it was not listened for"}}
    assert became(found(gap), found(**blind)) == {"backlash": "not examined"}
    assert became(found(**blind), found(gap)) == {"backlash": "not examined"}


def test_ripples_of_two_orders_are_two() -> None:
    rows = findings_compared(found(ripple(6.0), ripple(12.0)), found(ripple(12.0), ripple(24.0)))
    assert sorted(row.became for row in rows) == ["as before", "came", "went"]


@pytest.mark.parametrize(("grown", "word"), [(1.5, "larger"), (0.5, "smaller")])
def test_a_size_changed_if_the_difference_is_beyond_both_intervals(grown: float, word: str) -> None:
    assert became(found(backlash(1e-3, 5e-5)), found(backlash(grown * 1e-3, 5e-5))) == {"backlash": word}


def test_one_gap_measured_twice_has_changed_one_time_in_ten() -> None:
    """The sizes of both come with normal errors of different spread; the intervals hold nine in ten."""
    random = np.random.default_rng(0)
    drawn = random.normal(1.0, [0.03, 0.08], (4000, 2))
    words = [became(found(backlash(first, 0.03)), found(backlash(second, 0.08)))["backlash"] for first, second in drawn]
    assert np.mean([word != "as before" for word in words]) == pytest.approx(0.1, abs=0.02)


def test_values_that_both_have_estimated_are_compared() -> None:
    def value(name: str, estimate: float) -> dict[str, Any]:
        return {"name": name, "estimate": estimate, "low": estimate - 0.1, "high": estimate + 0.1, "unit": "kg m2"}

    before = found(parameters=[value("load.inertia_kg_m2", 10.0), value("motor.inertia_kg_m2", 1.0)])
    after = found(parameters=[value("load.inertia_kg_m2", 12.0), value("stages.output.damping", 3.0)])
    (load,) = values_compared(before, after)
    assert (load.name, load.became, load.after.value) == ("load: inertia", "larger", "12.00 kg m²")
