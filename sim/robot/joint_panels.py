"""Plots of a robot: the torque of each joint, and for each finding the one that shows it, in the words of its joint."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim.investigation.report.cause_panels import cause_panels
from sim.investigation.report.formatting import named
from sim.investigation.report.panels import EXTENDED, MEASURED, RIGID, Panel
from sim.investigation.report.residual_panels import channels
from sim.robot.results import RobotInvestigation
from sim.robot.robot import joint_words, slides

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


def joint_panels(result: RobotInvestigation, place: int) -> list[Panel | None]:
    """The plot of every finding at a joint, in its units; one that shows several stands at the first."""
    joint, said = result.joints[place], partial(joint_words, result.robot, place)
    in_metres, out = slides(result.robot, place), []
    for finding, panel in zip(joint.investigation.findings, cause_panels(joint.investigation), strict=True):
        if panel is not None:
            title = f"{named(finding.mechanism, joint.located(finding.location))}: "
            title += said(panel.title.rpartition(": ")[2])
            x = panel.x * math.radians(1.0) if in_metres and "[°]" in panel.x_label else panel.x
            panel = replace(
                panel, title=f"{title[:1].upper()}{title[1:]}", x=x, x_label=said(panel.x_label),
                y_label=said(panel.y_label),
            )  # fmt: skip
        out.append(panel)
    return out


def finding_panels(result: RobotInvestigation) -> list[Panel | None]:
    """The same in the document's order; of a payload, which the torques of all joints show, none."""
    shown = [joint_panels(result, place) for place, _ in enumerate(result.joints)]
    return [None if one.joint is None else shown[one.joint][one.number] for one in result.findings()]
