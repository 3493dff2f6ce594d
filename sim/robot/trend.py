"""What has changed at a joint between two logs of a robot: wear shows against the joint's own earlier numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sim.discrepancy.report.formatting import named, number
from sim.discrepancy.results import SAID, Estimate
from sim.discrepancy.unexplained import rounded
from sim.mechanisms.catalogue import kind_of
from sim.robot.results import JointInvestigation


@dataclass(frozen=True)
class Change:
    """A number of a joint that is another in a later log, by more than both intervals together."""

    joint: str
    what: str
    before: Estimate
    after: Estimate
    earlier: str
    later: str

    def __str__(self) -> str:
        """In one sentence."""
        unit = "" if self.after.unit == "1" else f" {self.after.unit}"
        way = "more" if abs(self.after.value) > abs(self.before.value) else "less"
        return (
            f"{self.joint}: {self.what} was {number(self.before.value)}{unit} in {self.earlier} and is "
            f"{number(self.after.value)}{unit} in {self.later}, {way} than both intervals allow."
        )

    def document(self) -> dict[str, object]:
        """JSON."""
        return {
            "joint": self.joint,
            "what": self.what,
            "unit": self.after.unit,
            "before": rounded(self.before.value),
            "after": rounded(self.after.value),
            "earlier": self.earlier,
            "later": self.later,
        }


def changed(names: Sequence[str], logs: Sequence[Sequence[JointInvestigation]]) -> tuple[Change, ...]:
    """Numbers of the last log that differ from those of the log before that has them; `logs`: joints of each log."""
    out = []
    for place, joint in enumerate(logs[-1]):
        for what, after in _numbers(joint).items():
            for earlier, joints in zip(reversed(names[:-1]), reversed(logs[:-1]), strict=True):
                before = _numbers(joints[place]).get(what)
                if before is None:
                    continue
                if abs(after.value - before.value) > math.hypot(_half(before), _half(after)):
                    out.append(Change(joint.name, what, before, after, earlier, names[-1]))
                break
    return tuple(out)


def _half(e: Estimate) -> float:
    return 0.5 * (e.high - e.low)


def _numbers(joint: JointInvestigation) -> dict[str, Estimate]:
    """The size of each finding that is said, and the friction that is described, by what it is called."""
    one = joint.investigation
    out = {}
    for f in one.findings:
        sizes = kind_of(f.mechanism).sizes()
        told = [e for e in f.parameters if e.name in sizes]
        if f.probability >= SAID and len(told) == 1:
            out[named(f.mechanism)] = told[0]
    return out | {e.name: e for e in one.parameters if "friction" in e.name}
