"""What page, report and terminal show of a robot."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim.investigation.report.box import FLANGE, is_shown
from sim.investigation.report.cause_panels import cause_panels
from sim.investigation.report.formatting import likely, named
from sim.investigation.report.panels import EXTENDED, MEASURED, RIGID, Panel
from sim.investigation.report.residual_panels import channels
from sim.investigation.report.summary import story
from sim.investigation.results import REPORTED, Finding
from sim.mechanisms.catalogue import is_in_every_axis
from sim.robot.results import SAYS, RobotInvestigation
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


def headline(result: RobotInvestigation) -> str:
    """The result in one sentence."""
    if result.verdict == "nothing_missing":
        return "The rigid-body model and the description of the joints explain what was measured."
    said = [f for f in _findings(result) if f[1].probability >= REPORTED]
    joints = {place for place, f in said if is_in_every_axis(f.mechanism)}
    places: dict[str, list[str]] = {}
    for place, f in said:
        if not is_in_every_axis(f.mechanism):
            places.setdefault(f.mechanism, []).append(place)
    words = [named(mechanism, at[0] if len(at) == 1 else f"{len(at)} joints") for mechanism, at in places.items()]
    rests = [joint.name for joint in result.joints if joint.investigation.unexplained is not None]
    if not said:
        return "Something is there that no known mechanism explains."
    out = [f"Found: {', '.join(words)}." if words else "No fault was named."]
    if rests:
        out.append(f"Something of unknown cause is left at {', '.join(rests)}.")
    if joints:
        no_fault = ", but no fault" if words else ""
        out.append(f"Not described{no_fault}: friction at {len(joints)} joint{'s' if len(joints) > 1 else ''}.")
    return " ".join(out)


def lines(result: RobotInvestigation) -> Iterable[str]:
    """The result for a terminal."""
    yield headline(result)
    for place, f in _findings(result):
        yield f"  {f.mechanism} ({place}), {likely(f.probability, calibrated=f.calibrated)}: {f.explanation}"
        for e in f.parameters:
            if is_shown(f.mechanism, e.name, e.low, e.high):
                unit = "" if e.unit == "1" else f" {e.unit}"
                yield f"    {e.name} = {e.value:.5g}{unit} ({e.low:.5g} to {e.high:.5g})"
    for joint in result.joints:
        for g in joint.investigation.gain:
            yield f"  {joint.name}: {g.channel} {g.rms_before:.4g} -> {g.rms_after:.4g} {g.unit} on held-out rows"
    for e in result.parameters:
        yield f"  {e.name}: described {e.nominal:.5g}, found {e.value:.5g} {e.unit} ({e.low:.5g} to {e.high:.5g})"
    for remark in result.remarks:
        yield f"  note: {remark}"
    yield result.next_measurement


def robot_story(result: RobotInvestigation) -> dict[str, object]:
    """Headline, the torques of all joints, and the plots of what was found, as JSON."""
    return {
        "headline": headline(result),
        "overlay": [panel.document() for panel in torque_panels(result)],
        "causes": [{"finding": k, **panel.document()} for k, panel in enumerate(finding_panels(result)) if panel],
    }


def parts_of_robot(result: RobotInvestigation) -> list[tuple[str, dict[str, object]]]:
    """Each joint by itself: its title, and its document with its story, plots in the words of the joint."""
    return [
        (
            f"{joint.name}: {SAYS[joint.investigation.verdict]}",
            {**joint.investigation.document(), "story": story(joint.investigation, joint_panels(result, place))},
        )
        for place, joint in enumerate(result.joints)
    ]


def _findings(result: RobotInvestigation) -> list[tuple[str, Finding]]:
    """Where, and what; the likeliest first, friction that nearly every robot lacks last."""
    out = [(FLANGE if one.joint is None else one.place, one.finding) for one in result.findings()]
    return sorted(out, key=lambda one: is_in_every_axis(one[1].mechanism))
