# ruff: noqa: E501
"""One HTML file that shows an investigation step by step; plots are inline SVG, nothing is loaded from elsewhere."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sim.investigation.estimation.problem import MISTAKEN
from sim.investigation.model.nominal import DAMPING_SPREAD, LOSS_SPREAD, PAYLOAD_SPREAD, STATED_SPREAD
from sim.investigation.report.box import FLANKS, Entry, box_of, is_shown, unexplained_words
from sim.investigation.report.cause_panels import cause_panels
from sim.investigation.report.checks import checked
from sim.investigation.report.drawing import svg
from sim.investigation.report.formatting import (
    angle,
    changed,
    interval,
    likely,
    named,
    number,
    percent,
    unit_in_words,
    words_of,
)
from sim.investigation.report.panels import AS_DESCRIBED, SHOWS, Panel
from sim.investigation.report.summary import ALIKE, Candidate, asked_for, candidates, panels
from sim.investigation.report.wording import headline, not_examined, telling_apart

if TYPE_CHECKING:
    from sim.investigation.results import Estimate, Finding, Investigation

STYLE = """:root{--ink:#1b2226;--paper:#fff;--sheet:#f5f7f9;--edge:#c9d1d9;--quiet:#4c585e;--first:#0a6480;--second:#b45309;--third:#7a3e9d;--fourth:#4d6b1f;--band:rgba(110,125,140,.28)}
@media(prefers-color-scheme:dark){:root{--ink:#e6ebe9;--paper:#0d1117;--sheet:#161b22;--edge:#3d444d;--quiet:#b3bfc0;--first:#6cc3df;--second:#f0b465;--third:#c9a0ea;--fourth:#b9d67a;--band:rgba(150,165,180,.3)}}
*{box-sizing:border-box}body{font:16px/1.5 system-ui,sans-serif;max-width:72rem;margin:0 auto;padding:1rem;color:var(--ink);background:var(--paper);overflow-wrap:break-word}
h1{font-size:1.5rem;line-height:1.25;margin:.2rem 0}h2{margin:2.2rem 0 .5rem;border-top:2px solid var(--edge);padding-top:.8rem}h3{margin:1.2rem 0 .3rem}p{white-space:pre-line}
.box{background:var(--sheet);border:2px solid var(--edge);border-left-width:8px;border-radius:6px;padding:1rem}.box dl{display:grid;grid-template-columns:max-content 1fr;gap:.4rem 1rem;margin:.6rem 0 0}
.box dt{font-weight:600}.box dd{margin:0;min-width:0}.box section+section{border-top:1px solid var(--edge);margin-top:1rem;padding-top:.6rem}.quiet,figcaption+.quiet{color:var(--quiet)}
.entry{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,24rem),1fr));gap:.6rem 1.5rem}.entry dd:last-child{font-weight:600}
summary{cursor:pointer}summary h2{display:inline;border:0;padding:0}details{border-top:2px solid var(--edge);margin-top:1.2rem;padding-top:.8rem}
.scroll{overflow-x:auto}table{border-collapse:collapse;margin:.6rem 0}td,th{border:1px solid var(--edge);padding:.3rem .6rem;text-align:left;vertical-align:top}.n{text-align:right;white-space:nowrap}
.plots{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,26rem),1fr));gap:1rem}figure{margin:0;min-width:0}figcaption{font-weight:600}svg{display:block;width:100%;height:auto}
@media(max-width:34rem){.box{padding:.6rem 0;border-width:2px 0}.box h1,.box h3,.box>p,.box dl{padding:0 .5rem}.box dl{grid-template-columns:1fr;gap:0}.box dd{margin-bottom:.5rem}body{padding:1rem .7rem}table,tbody,td{display:block}thead{display:none}tr{display:grid;grid-template-columns:repeat(auto-fill,minmax(8rem,1fr));gap:.3rem .8rem;border-bottom:1px solid var(--edge);padding:.5rem 0}td{border:0;padding:0;text-align:left;white-space:normal}td::before{content:attr(data-label);display:block;font-size:.8rem;color:var(--quiet)}}@media print{h2,figure{break-inside:avoid}details::details-content{content-visibility:visible;display:block;block-size:auto}}"""
STEPS = (
    "Condition of the recordings",
    "Calibration of the described values",
    "The residual, and where it is",
    "Candidate causes, compared",
    "Verdict",
    "Extended model",
    "Gain on data not used for the fit",
    "What is still unexplained",
    "What looks the same in these data",
    "Next measurement",
)
"""Headings of the steps, in order."""

MOST_PLACES = 6
STANDS_OUT = "Nothing that repeats stands out: no frequency, speed, angle or time."
BELIEVED = f"How accurate described values are assumed to be (one standard deviation): inertias of motor and gears, stiffness and friction {percent(STATED_SPREAD)}, losses of a mesh {percent(LOSS_SPREAD)}, the load's inertia {percent(PAYLOAD_SPREAD)}, damping {percent(DAMPING_SPREAD)}. A value that the data put {MISTAKEN:g} standard deviations away is taken to be wrong, and is then fitted almost freely."
LINEAR = "If this is a linear axis, read N, m and kg for N m, rad and kg m²: N s/m for N m s/rad, m/s for rad/s."


def html_report(result: Investigation, files: Sequence[str] = (), causes: Sequence[Panel | None] | None = None) -> str:
    """The investigation as one HTML page; `files`: names of what was measured, where the caller knows them.

    `causes`: a plot of each finding, where the caller has others than `cause_panels`.
    """
    overlay, residual, sound = panels(result)
    weighed = candidates(result)
    bodies = (
        _condition(result),
        _calibration(result),
        _left(result, overlay, residual, sound),
        _compared(result, weighed),
        _verdict(result),
        _extended(result),
        _gain(result),
        _unexplained(result, residual),
        _alike(result, weighed),
        next_steps(result),
    )
    parts = [box(result, files, cause_panels(result) if causes is None else causes)]
    for place, (title, body) in enumerate(zip(STEPS, bodies, strict=True), start=1):
        parts += [f"<details><summary><h2>{place}. {title}</h2></summary>", *body, "</details>"]
    parts.append(_provenance(result))
    name = html.escape(result.axis.name)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>Investigation of {name}</title><style>{STYLE}</style></head><body>{''.join(parts)}</body></html>"
    )


def box(result: Investigation, files: Sequence[str], causes: Sequence[Panel | None]) -> str:
    """What a technician needs: what, where, how sure, what to do first, and the plot that shows it."""
    unexplained = "" if result.unexplained is None else unexplained_words(result.unexplained)
    entries = box_of(result.document(), result.axis)
    shown = [(entry, None if entry.finding is None else causes[entry.finding]) for entry in entries]
    rest = [("Also unexplained", unexplained)] if unexplained and result.verdict != "unnamed" else []
    rest.append(("Next measurement", result.next_measurement))
    several = result.selection is None and result.listening is None and not result.encoders
    silent = [] if several else not_examined(result)
    return drawn_box(", ".join([result.axis.name, *files]), headline(result), shown, rest, silent)


def drawn_box(
    measured: str,
    heading: str,
    entries: Iterable[tuple[Entry, Panel | None]],
    rest: Iterable[tuple[str, str]],
    silent: Sequence[str] = (),
) -> str:
    """The box; `measured`: what was held against what; `silent`: what was not examined."""
    found = "".join(_entry(*one) for one in entries)
    beyond = f"<h3>Not examined, and what these data can show</h3>{_list(silent)}" if silent else ""
    return (
        f'<header class="box"><p class="quiet">Model against measurement: {html.escape(measured)}</p>'
        f"<h1>{html.escape(heading)}</h1>{found}<section>{_facts(rest)}{beyond}</section></header>"
    )


def _entry(entry: Entry, panel: Panel | None) -> str:
    drawn = "" if panel is None else f"{svg(panel)}{_p(SHOWS, 'quiet') if AS_DESCRIBED in dict(panel.lines) else ''}"
    return f'<section class="entry"><div>{_facts(entry.facts)}</div><div>{drawn}</div></section>'


def _condition(result: Investigation) -> list[str]:
    """Sensors and recordings before any physics, also where all is well."""
    return [
        _p("Sensors and recorders are checked before any physics. Rows with such faults do not count."),
        table(("checked", "result"), checked(result)),
        *(_p(remark) for remark in (result.gate.remarks if result.gate else ())),
        *([] if result.axis.stages or result.selection is None else [_p(LINEAR)]),
    ]


def _calibration(result: Investigation) -> list[str]:
    """Numbers of the description, fitted before anything is called missing."""
    if result.encoders:
        return [_p("Without the motor torque no value of the model could be fitted.")]
    if not result.parameters:
        return [_p("Sound has no channel to which values of the model could be fitted.")]
    rows = [(words_of(e.name), described(e), *estimate_cells(e), f"{_change(e)}") for e in result.parameters]
    return [
        _p(
            "A described value that is off is no missing mechanism. So the described values are fitted first, and missing mechanisms are looked for after that."
        ),
        _p(BELIEVED),
        table(("number", "described", "found", "90 % interval", "unit", "change"), rows, numeric=(1, 2, 3, 5)),
    ]


def _change(e: Estimate) -> str:
    return changed(e.nominal, e.value, 1) if e.nominal else "–"


def described(e: Estimate) -> str:
    """What the description says of it."""
    return "–" if e.nominal is None else number(e.nominal)


def estimate_cells(e: Estimate) -> tuple[str, str, str]:
    """Value, 90 % interval and unit, with the digits that the interval deserves."""
    half = 0.5 * (e.high - e.low)
    return number(e.value, half), interval(e.low, e.high), unit_in_words(e.unit)


def _left(result: Investigation, overlay: list[Panel], residual: list[Panel], sound: list[Panel]) -> list[str]:
    if result.encoders:
        text = "The difference of the two encoders, in angle of the load: in steady motion away from reversals, or while the load was pulled by hand and the motor held."
        return [_p(text), _plots([*overlay, *residual])]
    if result.selection is None:
        text = "The sound is quieter where the axis stands still and turns back; strokes are laid over each other from there on. Inside the grey band it may be noise or, compared with the axis as new, a difference that good gearboxes show from day to day. The first recording is shown."
        return [_p(text), _plots([*overlay, *residual])]
    floor = "The residual is measured less simulated. The noise floor is taken from the quieter parts of the record, at each frequency from the model that fits better; what both models get wrong all the time counts as noise. Values over time are means of 10 ms (single rows of a slower log), bands over time are two standard deviations. Rows that do not count are left out."
    out = [_p(floor), _plots(overlay)]
    for title in ("Motor torque", "Torque at the load"):
        shown = [panel for panel in residual if panel.title.startswith(title)]
        if shown:
            out += [f"<h3>{title}: where the residual is</h3>", _plots(shown)]
    if sound:
        out += [
            "<h3>Sound</h3>",
            _p("Impacts at an order that no gear has, and at its multiples, come from a rolling bearing."),
            _plots(sound),
        ]
    return out


def _plots(shown: Sequence[Panel]) -> str:
    return f'<div class="plots">{"".join(svg(panel) for panel in shown)}</div>'


def _compared(result: Investigation, weighed: Sequence[Candidate]) -> list[str]:
    """What came in and what did not, with what it explains against what would have been needed."""
    rows = []
    if result.selection is not None:
        fit, gains = result.selection.fit, result.selection.gains
        rows = [
            (named(t.mechanism, t.location), number(gains[t.key]), number(asked_for(t, fit)), "Named: see the verdict.")
            for t in result.selection.found
        ]
    rows += [(named(c.mechanism, c.location), _explains(c), _needed(c), f"Rejected. {c.reason}") for c in weighed]
    if not rows:
        return [_p("No other mechanism explains the data nearly as well.")]
    text = "Explains: how far the squared residual falls with this candidate, in units of its noise. Needed: how far it must fall for one more mechanism."
    return [_p(text), table(("candidate", "explains", "needed", "outcome"), rows, numeric=(1, 2))]


def _explains(c: Candidate) -> str:
    if c.behind is not None and c.instead_of is not None:
        return f"{number(c.behind)} standard errors worse than {named(c.instead_of)}"
    return "–" if c.explains is None else number(c.explains)


def _needed(c: Candidate) -> str:
    return "–" if c.needed is None else number(c.needed)


def _verdict(result: Investigation) -> list[str]:
    out = [f"<p><strong>{html.escape(headline(result))}</strong></p>"]
    for f in result.findings:
        out.append(
            f"<h3>{html.escape(named(f.mechanism, f.location))}: {likely(f.probability, calibrated=f.calibrated)}</h3>"
        )
        out += [_p(f.explanation), f"<p><strong>What to do now:</strong> {html.escape(f.action)}</p>"]
    if result.findings:
        out.append(
            _p(
                "A figure in per cent is calibrated: of findings with 90 %, nine in ten are right. Findings from sound, faults of the recording and findings from several recordings have a number from 0 to 1 that is not: it only puts them in order."
            )
        )
    return out


def _extended(result: Investigation) -> list[str]:
    """What was added to the model, each number with its interval."""
    out = []
    for f in result.findings:
        rows = [row for e in f.parameters if (row := _number(f, e))]
        if rows:
            out += [
                f"<h3>{html.escape(named(f.mechanism, f.location))}</h3>",
                table(("number", "value", "90 % interval", "unit", "as an angle"), rows, numeric=(1, 2, 4)),
            ]
    entries = [named(entry.name, entry.location) for entry in result.extended.mechanisms]
    if result.encoders:
        return [*out, _p("The extended axis can be simulated. It has what was found; no other value is changed.")]
    if result.selection is None:
        return [*out, _p("Sound extends no model: it shows what is there, but not how much torque it takes.")]
    if not out:
        return [_p("Nothing was added. The model is the description with the calibrated values.")]
    return [
        *out,
        _p(
            f"The extended axis can be simulated. Added mechanisms: {', '.join(entries) or 'none, only its values are changed'}."
        ),
    ]


def _number(f: Finding, e: Estimate) -> tuple[str, str, str, str, str] | None:
    if not is_shown(f.mechanism, e.name, e.low, e.high):
        return None
    if e.name == "flank":
        return words_of(e.name), FLANKS.get(e.value, "not known"), "–", "", ""
    half = 0.5 * (e.high - e.low)
    degrees = angle(e.value, half) if e.unit == "rad" else ""
    return words_of(e.name), *estimate_cells(e), degrees


def _gain(result: Investigation) -> list[str]:
    """Error of both models on rows that their fit has not seen."""
    if not result.gain and result.encoders:
        return [_p("A load that was moved by hand follows no model, so no gain was measured.")]
    if not result.gain:
        return [_p("Sound has no channel that a model could be compared with, so no gain was measured.")]
    rows = [
        (
            words_of(g.channel), number(g.rms_before), number(g.rms_after), g.unit,
            "–" if not g.rms_before else changed(g.rms_before, g.rms_after),
            "more than chance" if g.significant else "may be chance",
        )
        for g in result.gain
    ]  # fmt: skip
    how = "Each quarter of the record is predicted by fits to the other three, below 40 Hz, or below half the rate of a slower log. Before: the calibrated description. After: the extended model."
    if result.encoders:
        how = "Each twentieth of the rows in steady motion is predicted by fits to the others. Before: the load follows the motor by the ratio. After: the extended model."
    if result.selection is not None and not result.selection.found:
        how += " Nothing was added to this model, so the two differ only by their calibration."
    head = ("channel", "error before, rms", "error after, rms", "unit", "change", "gain")
    return [_p(how), table(head, rows, numeric=(1, 2, 4))]


def _unexplained(result: Investigation, residual: Sequence[Panel]) -> list[str]:
    """What has no name, and where what is left is highest over its noise floor."""
    if result.encoders:
        return [_p(STANDS_OUT if result.unexplained is None else unexplained_words(result.unexplained))]
    if result.selection is None:
        return [_p("In sound alone nothing without a name is looked for.")]
    fit = result.selection.fit
    white = number(fit.misfit / fit.residual.size)
    told = STANDS_OUT if result.unexplained is None else unexplained_words(result.unexplained)
    out = [_p(f"{told} The squared residual of the last model is {white} times that of noise alone.")]
    if result.selection.nameless:
        out.append(_p("The last model also contains what has no name, so the plots show only the rest."))
    rows = sorted((place for panel in residual if (place := _highest(panel))), reverse=True)[:MOST_PLACES]
    shown = [(title, f"{ratio:.1f} times", f"{number(x)} {unit}") for ratio, title, x, unit in rows]
    return [
        *out,
        _p("Where the residual is highest over its noise floor:"),
        table(("plot", "noise floor", "at"), shown, (1, 2)),
    ]


def _highest(panel: Panel) -> tuple[float, str, float, str] | None:
    """How far the last model leaves more than noise at most, by the bins of a panel, and where."""
    _, values = panel.lines[-1]
    if panel.noise is None or panel.noise[0] < 0.0 or not np.isfinite(values).any():
        return None
    at = int(np.nanargmax(values))
    unit = panel.x_label.partition("[")[2].removesuffix("]")
    return float(values[at]) / panel.noise[1], panel.title, float(panel.x[at]), unit


def _alike(result: Investigation, weighed: Sequence[Candidate]) -> list[str]:
    """Classes of causes that these data hold for the same, what tells them apart, and what was out of reach."""
    guided = bool(result.encoders) or (result.selection is not None and result.selection.problem.guided)
    out = [
        f"{named(f.mechanism, f.location)} looks the same as {named(other)} in these data. {telling_apart(f.mechanism, other, guided)}"
        for f in result.findings
        for other in f.indistinguishable_from
    ]
    out += [
        f"{named(c.mechanism, c.location)} explains these data as well as {named(c.instead_of or '')}."
        for c in weighed
        if c.reason == ALIKE and not any(c.mechanism in f.indistinguishable_from for f in result.findings)
    ]
    if not out:
        found = "No other cause that was tried explains these data as well."
        out = [found if result.findings else "No two causes look the same here."]
    if result.listening is not None:
        out.append(f"Listened for: {', '.join(named(name) for name in result.examined)}.")
    return [_list([*out, *not_examined(result)])]


def next_steps(result: Investigation) -> list[str]:
    """The advice, and what each measurement that was simulated would tell."""
    out = [_p(result.next_measurement)]
    if result.next_measurements:
        how = "Each measurement was simulated with one cause, and the other cause was fitted to it. Separation: how much worse the wrong cause fits, as squared residual in units of the noise. Effort: a repeat of the same motion is 1."
        rows = [
            (t.text, " or ".join(t.between), number(t.separation), number(t.effort)) for t in result.next_measurements
        ]
        out += [_p(how), table(("measurement", "decides between", "separation", "effort"), rows, numeric=(2, 3))]
    return out


def _provenance(result: Investigation) -> str:
    rows = [(name.replace("_", " "), str(value)) for name, value in result.provenance.items() if value]
    return f'<details><summary><h2>Provenance</h2></summary><div class="quiet">{table(("what", "value"), rows)}</div></details>'


def _p(text: str, kind: str = "") -> str:
    return f"<p{f' class={kind}' if kind else ''}>{html.escape(text)}</p>"


def _list(items: Iterable[str]) -> str:
    return f"<ul>{''.join(f'<li>{html.escape(one)}</li>' for one in items)}</ul>"


def _facts(facts: Iterable[tuple[str, str]]) -> str:
    return f"<dl>{''.join(f'<dt>{html.escape(name)}</dt><dd>{html.escape(text)}</dd>' for name, text in facts)}</dl>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numeric: Sequence[int] = ()) -> str:
    """A table that scrolls by itself, and on a narrow screen is a card a row; `numeric`: columns of numbers, which stand to the right and do not break; empty columns are left out."""
    rows = list(rows)
    shown = [k for k in range(len(head)) if any(row[k] for row in rows)]
    kinds = [' class="n"' if k in numeric else "" for k in range(len(head))]
    top = "".join(f"<th{kinds[k]}>{html.escape(head[k])}</th>" for k in shown)
    names = [f' data-label="{html.escape(name)}"' for name in head]
    cells = [[f"<td{kinds[k]}{names[k]}>{html.escape(row[k])}</td>" for k in shown] for row in rows]
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in cells)
    return f'<div class="scroll" tabindex="0"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'
