"""The drive train as a picture, motor to load, with what was found marked at its gear."""

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup, escape

from app.web.svg import shape_path
from app.web.words import name_of
from casebase.gearbox_state import Reason, Standing
from sim.discrepancy.report.formatting import named

STEP, TOP, HEIGHT = 150.0, 96.0, 236.0
SMALL, LARGE = 22.0, 52.0
LIKELY = 0.5
ROW = 17.0
GEAR_FAULTS = ("notch", "play")
"""Labels of faults that sit where teeth mesh."""


def drive_picture(
    document: Mapping[str, Any], findings: Sequence[Mapping[str, Any]], standing: Standing | None
) -> tuple[Markup, str] | None:
    """Return the picture of an axis and a sentence on its marks; None for a direct drive.

    Args:
        document: the description of the axis.
        findings: of the newest investigation; the likely ones are marked.
        standing: a fault that the sound names is marked where there is one gear pair that can have it.
    """
    stages = document.get("stages") or []
    if not stages:
        return None
    marks: dict[str, list[str]] = {}
    for finding in findings:
        if finding.get("location") and finding.get("probability", 0.0) >= LIKELY:
            marks.setdefault(str(finding["location"]), []).append(named(str(finding["mechanism"])))
    heard = _heard(standing)
    if heard and len(stages) == 1:
        marks.setdefault(stages[0]["name"], []).append(name_of(heard))
    places = ["motor", *(stage["name"] for stage in stages), "load"]
    placed = {place: words for place, words in marks.items() if place in places}
    return _drawn(stages, placed), _said(heard, len(stages), placed)


def _heard(standing: Standing | None) -> str | None:
    if standing is None or standing.recording is None or standing.reason not in (Reason.NAMED, Reason.FOUND):
        return None
    label = standing.recording.label
    return label if label in GEAR_FAULTS and standing.recording.left in ((), (label,)) else None


def _said(heard: str | None, stages: int, marks: Mapping[str, Sequence[str]]) -> str:
    if heard and stages > 1 and not marks:
        return f"The sound names {name_of(heard)}, not the gear pair. An investigation of a telemetry log says where."
    if marks and heard and stages == 1:
        return "Marked is what the sound names, and what the newest investigation found."
    if marks:
        return "Marked is what the newest investigation found."
    return "Nothing was found at a gear."


def _drawn(stages: Sequence[Mapping[str, Any]], marks: Mapping[str, Sequence[str]]) -> Markup:
    width = STEP * (len(stages) + 1) + 120
    said = escape(_aloud(stages, marks))
    parts = [
        f'<path class="shaft" d="M60 {TOP}H{STEP}"/>',
        f'<rect class="part" x="10" y="{TOP - 24}" width="58" height="48" rx="5"/>',
        _text(39, TOP + 5, "motor"),
    ]
    level = TOP
    for number, stage in enumerate(stages, start=1):
        x = STEP * number
        driven = level + (SMALL + LARGE if number % 2 else -(SMALL + LARGE))
        end = STEP * (number + 1) if number < len(stages) else width - 78
        parts += [
            f'<path class="shaft" d="M{x} {driven}H{end}"/>',
            _gear(x, level, SMALL, "gear"),
            _gear(x, driven, LARGE, f"gear{' found' if stage['name'] in marks else ''}"),
            _text(x + 12, driven + (LARGE - 12 if driven > level else -LARGE + 20), _teeth(stage), "start"),
            _text(x + 12, driven - 8, str(stage["name"]), "start"),
        ]
        level = driven
    parts += [
        f'<rect class="part" x="{width - 78}" y="{level - 24}" width="58" height="48" rx="5"/>',
        _text(width - 49, level + 5, "load"),
    ]
    at = {"motor": (39.0, TOP - 36), "load": (width - 49, level - 36)}
    level = TOP
    for number, stage in enumerate(stages, start=1):
        level += SMALL + LARGE if number % 2 else -(SMALL + LARGE)
        at[str(stage["name"])] = (STEP * number, level + (LARGE + 4 if number % 2 else -LARGE - 22))
    lowest = max((at[place][1] + 19 + ROW * (len(words) - 1) for place, words in marks.items()), default=0.0)
    size = f"0 0 {width:.0f} {max(HEIGHT, lowest):.0f}"
    parts.insert(0, f'<svg class="drive" viewBox="{size}" role="img" aria-label="{said}">')
    for place, words in marks.items():
        x, y = at[place]
        parts.append(f'<path class="mark" d="{shape_path("notch", x - 18, y + 8, 7.0)}"/>')
        parts += [_text(x - 6, y + 13 + ROW * row, word, "start", "mark-word") for row, word in enumerate(words)]
    return Markup("".join([*parts, "</svg>"]))  # noqa: S704  every text above is escaped


def _gear(x: float, y: float, radius: float, kind: str) -> str:
    """Draw a gear from the side: its rim is a narrow box across the shaft."""
    return f'<rect class="{kind}" x="{x - 7}" y="{y - radius}" width="14" height="{2 * radius}" rx="3"/>'


def _text(x: float, y: float, words: str, anchor: str = "middle", kind: str = "") -> str:
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}"{f" class={kind!r}" if kind else ""}>{escape(words)}</text>'


def _teeth(stage: Mapping[str, Any]) -> str:
    if stage.get("driver_teeth") and stage.get("driven_teeth"):
        return f"{stage['driver_teeth']} : {stage['driven_teeth']} teeth"
    return f"ratio {float(stage['ratio']):.4g}" if stage.get("ratio") else ""


def _aloud(stages: Sequence[Mapping[str, Any]], marks: Mapping[str, Sequence[str]]) -> str:
    """Say what the picture shows, for whoever cannot see it."""
    chain = ", ".join(["motor", *(str(stage["name"]) for stage in stages), "load"])
    found = "; ".join(f"{', '.join(words)} at {place}" for place, words in marks.items())
    return f"Drive train: {chain}. {found or 'Nothing is marked'}."
