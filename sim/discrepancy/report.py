# ruff: noqa: E501
"""One HTML file that shows an investigation step by step; plots are inline SVG, nothing is loaded from elsewhere."""

from __future__ import annotations

import html
import io
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import welch

from sim.chain_model import Array
from sim.discrepancy.fit import Fit, Problem
from sim.discrepancy.sound_story import sound_panels
from sim.discrepancy.story import Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sim.discrepancy.investigation import Investigation

STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1b1f24;background:#fff}
table{border-collapse:collapse;margin:1rem 0}td,th{border:1px solid #c9d1d9;padding:.3rem .6rem;text-align:right}
td:first-child,th:first-child{text-align:left}svg{max-width:100%;height:auto}.verdict{font-size:1.3rem;font-weight:600}
@media(prefers-color-scheme:dark){body{color:#e6edf3;background:#0d1117}svg{background:#fff}}"""
VERDICTS = {
    "nothing_missing": "Nothing is missing in the model.",
    "named": "The model misses what is listed here.",
    "unnamed": "The model misses something that no catalogued mechanism explains.",
}


def html_report(result: Investigation) -> str:
    """The investigation as one HTML page."""
    parts = [
        f"<h1>Model against measurement: {html.escape(result.axis.name)}</h1>",
        f'<p class="verdict">{VERDICTS[result.verdict]}</p>',
    ]
    parts += [f"<p>{html.escape(remark)}</p>" for remark in result.remarks]
    parts += _findings(result)
    if result.selection is not None:
        problem, base, fit = result.selection.problem, result.selection.base, result.selection.fit
        parts.append("<h2>Measurement, model and what is left</h2>")
        parts += [_svg(figure) for figure in _figures(problem, base, fit)]
        parts += _numbers(result)
    if result.listening is not None:
        overlay, where = sound_panels(result.listening)
        parts.append("<h2>What was heard</h2>")
        parts += [_svg(_panel_figure(panel)) for panel in (*overlay, *where)]
    parts.append(f"<h2>Next measurement</h2><p>{html.escape(result.next_measurement)}</p>")
    body = "\n".join(parts)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Investigation of {html.escape(result.axis.name)}</title>'
        f"<style>{STYLE}</style></head><body>{body}</body></html>"
    )


def _findings(result: Investigation) -> list[str]:
    out = ["<h2>Findings</h2>"]
    for f in result.findings:
        place = f" at {html.escape(f.location)}" if f.location else ""
        out.append(
            f"<h3>{html.escape(f.mechanism)}{place}: probability {f.probability:.2f}</h3><p>{html.escape(f.explanation)}</p>"
        )
        rows = [(e.name, f"{e.value:.5g}", f"{e.low:.5g} to {e.high:.5g}", e.unit) for e in f.parameters]
        out.append(_table(("parameter", "value", "90 % interval", "unit"), rows))
        if f.indistinguishable_from:
            out.append(f"<p>These data cannot tell it from {', '.join(f.indistinguishable_from)}.</p>")
    if not result.findings:
        out.append("<p>No mechanism.</p>")
    if result.unexplained is not None:
        where = ", ".join(f"{k} = {v:.4g}" for k, v in result.unexplained.numbers.items())
        out.append(
            f"<p>Unexplained: {where}, in {result.unexplained.channel} ({result.unexplained.share:.0%} of what is left).</p>"
        )
    if result.rejected:
        out.append("<h3>Considered and rejected</h3>")
        rejected = [(name, f"{gain:.0f}") for name, gain in result.rejected]
        out.append(_table(("mechanism", "drop of the squared residual, in units of its noise"), rejected))
    return out


def _numbers(result: Investigation) -> list[str]:
    rows = [
        (e.name, f"{e.nominal:.5g}", f"{e.value:.5g}", f"{e.low:.5g} to {e.high:.5g}", e.unit)
        for e in result.parameters
    ]
    out = ["<h2>Calibration</h2>", _table(("number", "described", "found", "90 % interval", "unit"), rows)]
    gains = [
        (
            g.channel,
            f"{g.rms_before:.4g}",
            f"{g.rms_after:.4g}",
            g.unit,
            "" if g.significant else "not distinguishable from zero",
        )
        for g in result.gain
    ]
    return [
        *out,
        "<h2>Gain on rows that the fit has not seen</h2>",
        _table(("channel", "before", "after", "unit", "remark"), gains),
    ]


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def _figures(problem: Problem, base: Fit, fit: Fit) -> list[Figure]:
    m = problem.measurement
    before = problem.raw_residuals((), base.values, weighted=False)
    after = problem.raw_residuals(fit.terms, fit.values, weighted=False)
    out = [_time_figure(m.time_s, m.torque, before[0], after[0], m.rate_hz)]
    out.append(_spectrum_figure("motor torque", "N m", before[0], after[0], m.rate_hz))
    if after[1].size:
        rate = m.rate_hz / problem.guide_stride
        out.append(_spectrum_figure("torque missing at the load", "N m", before[1], after[1], rate))
    return out


def _plain(title: str, rows: int) -> tuple[Figure, list[Any]]:
    from matplotlib.figure import Figure as NewFigure

    figure = NewFigure(figsize=(9, 2.6 * rows), layout="constrained")
    axes = [figure.add_subplot(rows, 1, k + 1) for k in range(rows)]
    axes[0].set_title(title)
    return figure, list(axes)


def _time_figure(time: Array, torque: Array, before: Array, after: Array, rate: float) -> Figure:
    figure, (top, bottom) = _plain("Motor torque: first seconds", 2)
    part = slice(0, int(min(time.size, 8 * rate)), 4)
    top.plot(time[part], torque[part], "k-", lw=1.0, label="measured")
    top.plot(time[part], (torque - after)[part], "C1--", lw=1.0, label="extended model")
    top.legend(loc="upper right")
    top.set_ylabel("N m")
    width = max(1, int(0.01 * rate))
    kernel = np.ones(width) / width
    bottom.plot(time[part], np.convolve(before, kernel, "same")[part], "C0-", lw=0.8, label="left by the description")
    bottom.plot(time[part], np.convolve(after, kernel, "same")[part], "C1-", lw=0.8, label="left by the extended model")
    noise = float(np.median(np.abs(np.convolve(after, kernel, "same")))) / 0.6745
    bottom.axhspan(-2 * noise, 2 * noise, color="0.85", label="noise floor, two deviations")
    bottom.legend(loc="upper right")
    bottom.set_ylabel("N m")
    bottom.set_xlabel("time [s]")
    return figure


def _spectrum_figure(title: str, unit: str, before: Array, after: Array, rate: float) -> Figure:
    figure, (panel,) = _plain(f"Spectrum of what is left: {title}", 1)
    size = int(min(4 * rate, before.size // 2))
    for values, style, label in ((before, "C0-", "description"), (after, "C1--", "extended model")):
        frequency, power = welch(values, rate, nperseg=size)
        panel.loglog(frequency[1:], np.sqrt(power[1:]), style, lw=0.9, label=label)
    panel.legend(loc="upper right")
    panel.set_xlabel("frequency [Hz]")
    panel.set_ylabel(f"{unit}/√Hz")
    return figure


def _panel_figure(panel: Panel) -> Figure:
    figure, (plot,) = _plain(panel.title, 1)
    for (name, values), style in zip(panel.lines, ("C0-", "C1--", "C2-."), strict=False):
        plot.plot(panel.x, values, style, lw=0.9, label=name)
    if panel.noise is not None:
        plot.axhspan(*panel.noise, color="0.85", label="what noise reaches")
    for x, text in panel.markers:
        plot.axvline(x, color="0.5", lw=0.6, ls=":")
        plot.annotate(text, (x, 1.0), xycoords=("data", "axes fraction"), fontsize=6, rotation=90, va="top")
    plot.legend(loc="best")
    plot.set_xlabel(panel.x_label)
    plot.set_ylabel(panel.y_label)
    return figure


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "gearcase", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return f"<figure>{text[text.index('<svg') :]}</figure>"
