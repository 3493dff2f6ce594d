"""Plots of a robot: the torque of each joint, and for each finding the one that shows it, in the words of its joint."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim.discrepancy.report.cause_panels import cause_panels
from sim.discrepancy.report.formatting import named
from sim.discrepancy.report.panels import AS_DESCRIBED, EXTENDED, MEASURED, RIGID, Panel
from sim.discrepancy.report.residual_panels import channels
from sim.discrepancy.results import SAID
from sim.robot.joint_words import joint_words
from sim.robot.results import RobotInvestigation
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Robot, slides

Array = NDArray[np.float64]

REST = "left by the last"
MOST_ROWS = 1000  # of a plot


def torque_panels(result: RobotInvestigation) -> list[Panel]:
    """Measured and modelled torque of each joint over time, at the joint."""
    motion = result.shared.motion
    step = -(-motion.time_s.size // MOST_ROWS)
    clock = motion.time_s[::step]
    out = []
    for k, joint in enumerate(result.joints):
        measured, rigid = motion.torque[::step, k], result.shared.rigid[::step, k]
        extended = extended_torque(result, k)
        rows = [(MEASURED, measured), (RIGID, rigid)]
        rows += [] if extended is None else [(EXTENDED, extended[::step])]
        rows.append((REST, measured - rows[-1][1]))
        title = f"{k + 1}. {joint.name}"
        out.append(Panel(title, "time [s]", _at_the_joint(result, k), "time", clock - clock[0], tuple(rows)))
    return out


def _at_the_joint(result: RobotInvestigation, place: int) -> str:
    unit = result.torque_unit(place)
    return f"{'force' if unit == 'N' else 'torque'} at the joint [{unit}]"


def extended_torque(result: RobotInvestigation, place: int) -> Array | None:
    """Torque at a joint by the extended model, shape (rows,) [N m]; None without a model.

    A joint's own clock begins with the first row that counts.
    """
    motion, one = result.shared.motion, result.joints[place].investigation
    if one.selection is None:
        return None
    m = one.selection.problem.measurement
    _, left = channels(one.selection)[0].left[-1]
    modelled, clock = (m.torque - left) * result.robot.joints[place].axis.ratio, motion.time_s
    own = clock - clock[motion.counts][0]
    return np.asarray(np.interp(own, m.time_s, modelled, left=np.nan, right=np.nan), dtype=np.float64)


def finding_panels(result: RobotInvestigation) -> list[Panel | None]:
    """The plot of every finding, in the document's order; one that shows several of a joint stands at the first."""
    shown = {
        (place, finding.mechanism, finding.location): panel
        for place, joint in enumerate(result.joints)
        for finding, panel in zip(joint.investigation.findings, cause_panels(joint.investigation), strict=True)
    }
    out = []
    for located in result.findings():
        finding, place = located.finding, located.joint
        if place is None:
            out.append(_of_payload(result))
            continue
        panel = shown[place, finding.mechanism, finding.location]
        if panel is not None:
            panel = _in_its_words(result.robot, place, replace(panel, title=panel.title.rpartition(": ")[2]))
            title = f"{named(finding.mechanism, located.place)}: {panel.title}"
            panel = replace(panel, title=f"{title[:1].upper()}{title[1:]}")
        out.append(panel)
    return out


def _in_its_words(robot: Robot, place: int, panel: Panel) -> Panel:
    """A panel with the units of a joint that slides, and without a motor where none is described."""
    said = partial(joint_words, robot, place)
    x = panel.x * math.radians(1.0) if slides(robot, place) and "[°]" in panel.x_label else panel.x
    return replace(panel, title=said(panel.title), x=x, x_label=said(panel.x_label), y_label=said(panel.y_label))


def _of_payload(result: RobotInvestigation) -> Panel | None:
    """What hangs there asks for torque: of the joint where it stands highest above what the whole model leaves."""
    motion, shared = result.shared.motion, result.shared
    if shared.payload.probability < SAID:
        return None
    step = -(-motion.time_s.size // MOST_ROWS)
    ways = (each[::step] for each in (motion.position, motion.speed, motion.acceleration))
    body = RigidBody.of(result.robot)
    asked = body.regressor(*ways)[:, :, body.tool, :4] @ shared.payload.numbers
    heights: list[tuple[float, int, Array]] = []
    for place in range(len(result.joints)):
        extended = extended_torque(result, place)
        if extended is None:
            continue
        left = motion.torque[::step, place] - extended[::step]
        height = float(np.std(asked[:, place])) / max(float(np.sqrt(np.nanmean(left**2))), 1e-12)
        heights.append((height, place, left))
    if not heights:
        return None
    _, place, left = max(heights, key=lambda one: one[0])
    made, clock = asked[:, place], motion.time_s[::step]
    lines = ((MEASURED, left + made), (AS_DESCRIBED, np.zeros(made.size)), (EXTENDED, made))
    title = f"Payload: {_at_the_joint(result, place).split()[0]} of {result.joints[place].name} over time"
    return Panel(title, "time [s]", _at_the_joint(result, place), "time", clock - clock[0], lines)
