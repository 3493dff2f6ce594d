"""What page, report and terminal show of a robot."""

from __future__ import annotations

from collections.abc import Iterable

from sim.investigation.report.box import FLANGE, is_shown
from sim.investigation.report.formatting import likely, named
from sim.investigation.report.summary import story
from sim.investigation.results import REPORTED, Finding
from sim.mechanisms.catalogue import is_in_every_axis
from sim.robot.joint_panels import finding_panels, joint_panels, torque_panels
from sim.robot.results import SAYS, RobotInvestigation


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
