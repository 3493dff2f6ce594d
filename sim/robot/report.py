# ruff: noqa: E501
"""One HTML file of a robot: the arm with what was found at its joints, a table of all joints, then each joint's story."""

from __future__ import annotations

import html
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sim.discrepancy.report.drawing import svg
from sim.discrepancy.report.formatting import likely, number
from sim.discrepancy.report.html import STYLE, estimate_cells, html_report, table
from sim.discrepancy.report.joint_html import FOLD, STYLES, WIDTH, body_of
from sim.discrepancy.report.panels import MEASURED, Panel
from sim.discrepancy.results import SAID, Finding
from sim.robot.results import JointInvestigation, RobotInvestigation

SIZE = 520  # of the picture [px]
MARKS = {"nothing_missing": ("●", "var(--first)"), "named": ("▲", "var(--second)"), "unnamed": ("?", "var(--third)")}
SAYS = {"nothing_missing": "nothing is missing", "named": "something was named", "unnamed": "something without a name"}
USUAL = ("coulomb_friction", "viscous_friction")
MOST_ROWS = 1500  # of a plot
Array = NDArray[np.float64]


def headline(result: RobotInvestigation) -> str:
    """The result in one sentence."""
    if result.verdict == "nothing_missing":
        return "The rigid-body model and the description of the joints explain what was measured."
    said = [f for f in _findings(result) if f[1].probability >= SAID]
    beyond = [(place, f) for place, f in said if f.mechanism not in USUAL]
    usual = sum(f.mechanism in USUAL for _, f in said)
    words = [f"{f.mechanism.replace('_', ' ')} at {place}" for place, f in beyond[:3]]
    if usual:
        words.append(
            f"friction that the description lacks at {len({p for p, f in said if f.mechanism in USUAL})} joints"
        )
    if words:
        return f"The model of the robot lacks {', '.join(words)}."
    return "Something is missing from the model of the robot that no mechanism of the catalogue explains."


def lines(result: RobotInvestigation) -> Iterable[str]:
    """The result for a terminal."""
    yield headline(result)
    for place, f in _findings(result):
        yield f"  {f.mechanism} ({place}), {likely(f.probability, calibrated=f.calibrated)}: {f.explanation}"
        for e in f.parameters:
            yield f"    {e.name} = {e.value:.5g} {e.unit} ({e.low:.5g} to {e.high:.5g})"
    for joint in result.joints:
        for g in joint.investigation.gain:
            yield f"  {joint.name}: {g.channel} {g.rms_before:.4g} -> {g.rms_after:.4g} {g.unit} on held-out rows"
    for e in result.parameters:
        yield f"  {e.name}: described {e.nominal:.5g}, found {e.value:.5g} {e.unit} ({e.low:.5g} to {e.high:.5g})"
    for remark in result.remarks:
        yield f"  note: {remark}"
    yield result.next_measurement


def robot_report(result: RobotInvestigation) -> str:
    """The investigation of a robot as one HTML page that loads nothing."""
    pages = [html_report(joint.investigation) for joint in result.joints]
    head = "".join(dict.fromkeys(style for page in pages for style in STYLES.findall(page.split("<body")[0])))
    name = html.escape(result.robot.name)
    stories = [
        f'<details id="{html.escape(joint.name)}"><summary>{html.escape(joint.name)}: {SAYS[joint.investigation.verdict]}'
        f"</summary>{body_of(page, place)}</details>"
        for place, (joint, page) in enumerate(zip(result.joints, pages, strict=True), start=1)
    ]
    body = "\n".join(
        [
            f'<header class="box"><p class="quiet">Model against measurement: {name}</p><h1>{html.escape(headline(result))}</h1>'
            f"<p>Next measurement: {html.escape(result.next_measurement)}</p></header>",
            *(f"<p>{html.escape(remark)}</p>" for remark in result.remarks),
            "<h2>The arm</h2>", _picture(result),
            "<h2>All joints</h2>", _joints(result),
            "<h2>Findings</h2>", *_told(result),
            "<h2>Torque of each joint</h2>", '<div class="plots">', *(svg(p) for p in torque_panels(result)), "</div>",
            "<h2>Each joint by itself</h2>", *stories,
        ]
    )  # fmt: skip
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">{WIDTH}<title>Investigation of {name}</title>'
        f"<style>{STYLE}</style>{head}<style>{FOLD}</style></head><body>{body}</body></html>"
    )


def torque_panels(result: RobotInvestigation) -> list[Panel]:
    """Of each joint over time: measured torque, what the rigid body asks for, what it leaves."""
    shared, out = result.shared, []
    step = max(1, len(shared.motion.time_s) // MOST_ROWS)
    time_s = shared.motion.time_s[::step] - shared.motion.time_s[0]
    for k, joint in enumerate(result.joints):
        measured, rigid = shared.motion.torque[::step, k], shared.rigid[::step, k]
        rows = ((MEASURED, measured), ("rigid body, as described", rigid), ("left by it", measured - rigid))
        out.append(Panel(joint.name, "time [s]", "torque at the joint [N m]", "time", time_s, rows))
    return out


def _findings(result: RobotInvestigation) -> list[tuple[str, Finding]]:
    """Where, and what; the likeliest first, friction that nearly every robot lacks last."""
    out = [] if result.payload is None else [("the flange", result.payload)]
    out += [(joint.located(f.location), f) for joint in result.joints for f in joint.investigation.findings]
    return sorted(out, key=lambda one: (one[1].mechanism in USUAL, -one[1].probability))


def _told(result: RobotInvestigation) -> Iterable[str]:
    found = _findings(result)
    if not found:
        yield "<p>None.</p>"
    for place, f in found:
        title = f"{f.mechanism.replace('_', ' ')} at {place}: {likely(f.probability, calibrated=f.calibrated)}"
        yield f"<h3>{html.escape(title)}</h3><p>{html.escape(f.explanation)}</p>"
        yield table(
            ("parameter", "value", "90 % interval", "unit"), [(e.name, *estimate_cells(e)) for e in f.parameters]
        )
        if f.action and f.mechanism not in USUAL:
            yield f"<p>What to do now: {html.escape(f.action)}</p>"


def _joints(result: RobotInvestigation) -> str:
    rows = []
    for k, joint in enumerate(result.joints):
        one, shared = joint.investigation, result.shared
        gain = next((g for g in one.gain if g.channel == "motor_torque_nm"), None)
        said = ", ".join(f.mechanism.replace("_", " ") for f in one.findings if f.probability >= SAID) or "nothing"
        left = float(np.sqrt(np.mean((shared.motion.torque[:, k] - shared.rigid[:, k]) ** 2)))
        ratio = one.axis.ratio
        rows.append(
            (
                f"{MARKS[one.verdict][0]} {joint.name}",
                number(float(np.sqrt(np.mean(shared.motion.torque[:, k] ** 2)))),
                number(left),
                "" if gain is None else number(gain.rms_after * ratio),
                said,
                "" if one.unexplained is None else "something without a name",
            )
        )
    heads = (
        "joint",
        "torque measured [N m]",
        "left by the rigid body",
        "left by the extended model",
        "found",
        "left over",
    )
    return (
        table(heads, rows)
        + "<p class='quiet'>Effective values at the joint; of the extended model on rows that its fit has not seen.</p>"
    )


def _picture(result: RobotInvestigation) -> str:
    """The arm where its joints are farthest from their mean, seen from the front and above; joints marked by shape and colour."""
    points = _places(result)
    flat = _projected(points)
    span = max(float(np.ptp(flat, axis=0).max()), 1e-9)
    margin = 70.0
    at = (flat - flat.min(axis=0)) / span * (SIZE - 2 * margin) + margin
    at[:, 1] = SIZE - at[:, 1]
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
    marks = [_mark(joint, *at[k + 1]) for k, joint in enumerate(result.joints)]
    legend = ", ".join(f"{mark} {SAYS[verdict]}" for verdict, (mark, _) in MARKS.items())
    title = f"The arm of {html.escape(result.robot.name)} with its joints"
    return (
        f'<figure style="max-width:36rem"><svg viewBox="0 0 {SIZE} {SIZE}" role="img" aria-label="{title}">'
        f'<polyline points="{way}" fill="none" stroke="var(--quiet)" stroke-width="12" stroke-linejoin="round" stroke-linecap="round" opacity=".5"/>'
        f"{''.join(marks)}</svg><figcaption class='quiet'>{legend}</figcaption></figure>"
    )


def _mark(joint: JointInvestigation, x: float, y: float) -> str:
    mark, ink = MARKS[joint.investigation.verdict]
    name = html.escape(joint.name)
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="13" fill="var(--paper)" stroke="{ink}" stroke-width="3"/>'
        f'<text x="{x:.1f}" y="{y + 6:.1f}" text-anchor="middle" font-size="17" fill="{ink}">{mark}</text>'
        f'<text x="{x + 20:.1f}" y="{y + 5:.1f}" font-size="14" fill="currentColor">{name}</text>'
    )


def _places(result: RobotInvestigation) -> Array:
    """Base, joints and flange in space [m], shape (joints + 2, 3)."""
    from sim.robot.rigid_body import RigidBody

    motion = result.shared.motion
    far = motion.position[int(np.argmax(np.abs(motion.position - motion.position.mean(axis=0)).sum(axis=1)))]
    return RigidBody.of(result.robot).places(far)


def _projected(points: Array) -> Array:
    """Seen from 30 degrees to the side and 20 above, shape (n, 2)."""
    side, above = np.radians(30.0), np.radians(20.0)
    x, y, z = points.T
    depth = x * np.cos(side) + y * np.sin(side)
    return np.stack([-x * np.sin(side) + y * np.cos(side), z * np.cos(above) - depth * np.sin(above)], axis=1)
