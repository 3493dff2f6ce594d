"""A joint that is unlike its own earlier log is said to be; what both intervals allow is not."""

from dataclasses import replace

import pytest

from sim.discrepancy.results import Estimate, Finding, Investigation
from sim.robot.results import JointInvestigation
from sim.robot.robot import rigid_joint
from sim.robot.trend import changed


def joint(name: str, dry_n_m: float, half: float, probability: float = 0.95) -> JointInvestigation:
    axis = rigid_joint(name).axis
    size = Estimate("torque_n_m", dry_n_m, "N m", dry_n_m - half, dry_n_m + half)
    said = Finding("coulomb_friction", None, probability, (size,), (), "")
    return JointInvestigation(name, Investigation(axis, "named", (said,), None, (), (), "", axis, {}))


@pytest.mark.parametrize(("after", "is_said"), [(14.0, False), (16.0, True), (8.0, True)])
def test_friction_beyond_both_intervals_has_changed(after: float, is_said: bool) -> None:
    """Half widths of 2 and 3 allow differences of 3.6."""
    logs = [[joint("a", 12.0, 2.0), joint("b", 5.0, 1.0)], [joint("a", after, 3.0), joint("b", 5.1, 1.0)]]
    told = changed(["spring.csv", "autumn.csv"], logs)
    assert [change.joint for change in told] == (["a"] if is_said else [])
    for change in told:
        document = change.document()
        assert (document["before"], document["after"]) == (12.0, after)
        assert "spring.csv" in str(change)
        assert ("more" if after > 12.0 else "less") in str(change)


def test_a_log_is_held_against_the_last_one_that_tells_the_number() -> None:
    """In the log between, friction was not said: it is held against the one before."""
    logs = [[joint("a", 12.0, 1.0)], [joint("a", 30.0, 1.0, probability=0.2)], [joint("a", 12.5, 1.0)]]
    assert not changed(["1.csv", "2.csv", "3.csv"], logs)
    (told,) = changed(["1.csv", "3.csv"], [logs[0], [replace(joint("a", 20.0, 1.0), name="a")]])
    assert told.earlier == "1.csv"


def test_one_log_alone_has_no_trend() -> None:
    assert changed(["1.csv"], [[joint("a", 12.0, 1.0)]]) == ()
