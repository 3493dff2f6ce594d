"""One HTML file of a robot: what was found, a table of all joints, then each joint's story.

`robot_story` is the same for a page that draws by itself.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from sim.investigation.report.box import FLANGE, box_of_robot, is_shown, rests_of_robot
from sim.investigation.report.drawing import svg
from sim.investigation.report.formatting import likely, named, number
from sim.investigation.report.html import STYLE, drawn_box, html_report, table
from sim.investigation.report.joint_html import FOLD, STYLES, WIDTH, body_of
from sim.investigation.results import SAID, Finding
from sim.mechanisms.catalogue import is_in_every_axis
from sim.robot.joint_panels import finding_panels, joint_panels, torque_panels
from sim.robot.results import SAYS, RobotInvestigation


def headline(result: RobotInvestigation) -> str:
    """The result in one sentence."""
    if result.verdict == "nothing_missing":
        return "The rigid-body model and the description of the joints explain what was measured."
    said = [f for f in _findings(result) if f[1].probability >= SAID]
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
        out.append(f"Something without a name is left at {', '.join(rests)}.")
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


def robot_report(result: RobotInvestigation, files: Sequence[str] = ()) -> str:
    """The investigation of a robot as one HTML page that loads nothing; `files`: names of what it was made of."""
    causes = finding_panels(result)
    pages = [html_report(joint.investigation, (), joint_panels(result, k)) for k, joint in enumerate(result.joints)]
    head = "".join(dict.fromkeys(style for page in pages for style in STYLES.findall(page.split("<body")[0])))
    name = html.escape(result.robot.name)
    stories = [
        f"<details><summary>{html.escape(joint.name)}: {SAYS[joint.investigation.verdict]}</summary>"
        f'<div id="joint-{place}">{body_of(page, place)}</div></details>'
        for place, (joint, page) in enumerate(zip(result.joints, pages, strict=True), start=1)
    ]
    document = result.document()
    entries, rests = box_of_robot(document), rests_of_robot(document)
    body = "\n".join(
        [
            drawn_box(
                ", ".join([result.robot.name, *files]), headline(result),
                [(entry, None if entry.finding is None else causes[entry.finding]) for entry in entries],
                [*([("Also unexplained", rests)] if rests else []), ("Next measurement", result.next_measurement)],
            ),
            *(f"<p>{html.escape(remark)}</p>" for remark in result.remarks),
            "<h2>The joints</h2>", _joints(result),
            "<h2>Torque of each joint</h2>", f'<p class="quiet">{TORQUES}</p>',
            '<div class="plots">', *(svg(p) for p in torque_panels(result)), "</div>",
            "<h2>Each joint by itself</h2>", *stories,
        ]
    )  # fmt: skip
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">{WIDTH}<title>Investigation of {name}</title>'
        f"<style>{STYLE}</style>{head}<style>{FOLD}</style></head><body>{body}</body></html>"
    )


TORQUES = (
    "Measured, as the rigid body of the description asks for, and with all that was found; and what the last leaves. "
    "At the joint."
)


def _findings(result: RobotInvestigation) -> list[tuple[str, Finding]]:
    """Where, and what; the likeliest first, friction that nearly every robot lacks last."""
    out = [(FLANGE if one.joint is None else one.place, one.finding) for one in result.findings()]
    return sorted(out, key=lambda one: is_in_every_axis(one[1].mechanism))


def _joints(result: RobotInvestigation) -> str:
    rows = []
    for k, joint in enumerate(result.joints, start=1):
        one, torque = joint.investigation, result.torque_rms_nm(k - 1)
        said = ", ".join(named(f.mechanism) for f in one.findings if f.probability >= SAID)
        rest = "" if one.unexplained is None else "something without a name"
        unit = result.torque_unit(k - 1)
        left = [
            f"{number(torque[name])} {unit}" if name in torque else "" for name in ("measured", "rigid", "extended")
        ]
        rows.append((f"{k}. {joint.name}", *left, said or "nothing", rest))
    heads = (
        "joint",
        "torque measured",
        "not explained by the description",
        "not explained with what was found",
        "found",
        "left over",
    )
    note = "Effective values at the joint; with what was found on rows that were not used for the fit."
    return f'{table(heads, rows, (1, 2, 3))}<p class="quiet">{note}</p>'
