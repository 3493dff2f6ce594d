"""What an investigation of a robot finds; its document is that of one axis, with joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.investigation.results import (
    Estimate,
    Finding,
    Investigation,
    estimate_document,
    finding_document,
    gain_document,
)
from sim.investigation.unexplained import rounded, unexplained_document
from sim.robot.robot import SCHEMA, Robot, position_key

if TYPE_CHECKING:
    from sim.robot.shared_fit import SharedFit

PAYLOAD = "payload"
SAYS = {
    "nothing_missing": "nothing was found",
    "named": "something was found",
    "unnamed": "something of unknown cause",
    "unusable": "its torque says nothing",
}
"""The verdict of a joint in words."""


@dataclass(frozen=True)
class JointInvestigation:
    """One joint: its own investigation, with the torque that the rigid body asks for as known."""

    name: str
    investigation: Investigation

    def located(self, location: str | None) -> str:
        """Where a finding of this joint is, as the robot's document says it."""
        axis = self.investigation.axis
        return f"{self.name}/{location}" if location in {stage.name for stage in axis.stages} else self.name


@dataclass(frozen=True)
class Located:
    """A finding of a robot; `place`: where it is, `joint`: of which joint, by its place in the log, None of no one;
    `number`: which it is of the joint's own."""

    finding: Finding
    place: str
    joint: int | None
    number: int = 0

    def document(self) -> dict[str, object]:
        return {**finding_document(self.finding), "location": self.place}


@dataclass(frozen=True)
class RobotInvestigation:
    """What the rigid-body model of a robot misses, joint by joint; `document()` is the contract's JSON."""

    robot: Robot
    verdict: str
    payload: Finding | None
    joints: tuple[JointInvestigation, ...]
    shared: SharedFit
    parameters: tuple[Estimate, ...]
    next_measurement: str
    provenance: Mapping[str, object]
    remarks: tuple[str, ...] = ()

    def torque_rms_nm(self, place: int) -> dict[str, float]:
        """Effective torque at a joint [N m]: `measured`, left by the `rigid` body, and by the `extended` model.

        The last on rows that its fit has not seen, and missing where no model could be fitted; none of an unusable
        joint.
        """
        measured, one = self.shared.motion.torque[:, place], self.joints[place].investigation
        if one.verdict == "unusable":
            return {}
        left = measured - self.shared.rigid[:, place]
        out = {name: float(np.sqrt(np.mean(each**2))) for name, each in (("measured", measured), ("rigid", left))}
        ratio = self.robot.joints[place].axis.ratio
        gains = [g.rms_after * ratio for g in one.gain if g.channel == "motor_torque_nm"]
        return out | ({"extended": gains[0]} if gains else {})

    def torque_unit(self, place: int) -> str:
        """Unit of a joint's torque; a force where it slides."""
        return "N" if self.robot.joints[place].name in self.robot.urdf.prismatic else "N m"

    def findings(self) -> list[Located]:
        """All that was found, the likeliest first."""
        out = [] if self.payload is None else [Located(self.payload, PAYLOAD, None)]
        for place, joint in enumerate(self.joints):
            out += [Located(f, joint.located(f.location), place, k) for k, f in enumerate(joint.investigation.findings)]
        return sorted(out, key=lambda one: -round(one.finding.probability, 4))

    def document(self) -> dict[str, object]:
        """JSON of the contract: finite numbers only, the same for the same bytes."""
        ones = [(joint.name, joint.investigation) for joint in self.joints]
        rests = [
            (one.unexplained.score, {**unexplained_document(one.unexplained), "joint": name})
            for name, one in ones
            if one.unexplained is not None
        ]
        parameters = [
            {**estimate_document(e), "name": f"{name}.{e.name}"} for name, one in ones for e in one.parameters
        ]
        gains = [{**gain_document(g), "joint": name} for name, one in ones for g in one.gain]
        return {
            "verdict": self.verdict,
            "findings": [one.document() for one in self.findings()],
            "unexplained": max(rests, key=lambda one: one[0])[1] if rests else None,
            "parameters": [*map(estimate_document, self.parameters), *parameters],
            "gain": gains,
            "next_measurement": self.next_measurement,
            "extended_axis": self.extended(),
            "joints": [
                {
                    "name": joint.name,
                    "verdict": joint.investigation.verdict,
                    "unit": self.torque_unit(k),
                    "unexplained": None
                    if joint.investigation.unexplained is None
                    else unexplained_document(joint.investigation.unexplained),
                    "torque_rms_nm": {name: rounded(value) for name, value in self.torque_rms_nm(k).items()},
                    "remarks": list(joint.investigation.remarks),
                }
                for k, joint in enumerate(self.joints)
            ],
            "remarks": list(self.remarks),
            "provenance": dict(self.provenance),
        }

    def extended(self) -> dict[str, object]:
        """The robot's description with what was found: an axis for each joint, and the payload."""
        payload = self.robot.payload
        mass, center = payload.mass_kg, list(payload.center_m)
        if self.payload is not None and self.payload.probability > 0.5:
            numbers = {e.name: e.value for e in self.payload.parameters}
            mass, center = numbers["mass_kg"], [numbers[f"center_{way}_m"] for way in "xyz"]
        urdf = self.robot.urdf
        held = [{"name": name, position_key(urdf, name): at} for name, at in self.robot.held.items()]
        return {
            "schema": SCHEMA,
            "name": self.robot.name,
            "urdf": self.robot.document.get("urdf", f"{self.robot.name}.urdf"),
            "gravity_m_s2": list(self.robot.gravity_m_s2),
            "payload": {"mass_kg": rounded(mass), "center_m": [rounded(x) for x in center]},
            "joints": [{"name": j.name, "axis": j.investigation.extended.to_mapping()} for j in self.joints],
            **({"held": held} if held else {}),
        }
