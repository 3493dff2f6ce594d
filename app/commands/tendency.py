"""`gearcase tendency`: how features follow the size of a fault, payload and the frequency of the motion."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import frame_of
from app.tendency import FEATURES, SPECIMENS, Curve, curves
from casebase.signals.features import feature_words
from sim.experiment.paper_axis import PAPER_AXIS

MARKS = {"play": "o-", "notch": "s--"}


def register(app: typer.Typer) -> None:
    app.command("tendency")(tendency)


def tendency(
    context: typer.Context,
    out: Annotated[Path, typer.Option(metavar="PAGE.md", help="page to write, its plot beside it")],
    axis: Annotated[str | None, typer.Option(metavar=METAVAR, help=f"{MEANT} [the paper's axis]")] = None,
    points: Annotated[int, typer.Option(min=2, max=50, help="of each curve")] = 6,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Simulate and plot curves of features over fault size, payload and frequency."""
    frame = frame_of(context)
    described = axis_of(frame, axis) if axis else PAPER_AXIS
    with frame.progress() as progress:
        bar = progress.add_task("simulating", total=6 * points * len(SPECIMENS))
        found = curves(described, points, lambda: progress.advance(bar))
    picture = out.with_name(f"{out.stem}.svg")
    _draw(found, picture)
    out.write_text(_page(described.name, found, picture.name), encoding="utf-8")
    if json:
        frame.print_json([asdict(curve) for curve in found])
    else:
        frame.print(f"{out} and {picture}")


def _draw(found: list[Curve], path: Path) -> None:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    overs = list(dict.fromkeys(curve.over for curve in found))
    figure = Figure(figsize=(4 * len(overs), 3 * len(FEATURES)), layout="constrained")
    FigureCanvasSVG(figure)
    axes = figure.subplots(len(FEATURES), len(overs), squeeze=False, sharey="row")
    for curve in found:
        area = axes[FEATURES.index(curve.feature)][overs.index(curve.over)]
        (line,) = area.plot(curve.at, curve.mean, MARKS[curve.label], ms=4, label=curve.label)
        area.fill_between(curve.at, curve.low, curve.high, alpha=0.2, color=line.get_color())
        area.set_xlabel(f"{curve.over} [{curve.unit}]")
        if curve.over == "size":
            area.set_xscale("log")
            area.set_ylabel(feature_words(curve.feature), fontsize=7)
        area.grid(alpha=0.3)
        area.legend(fontsize=8)
    with mpl.rc_context({"svg.hashsalt": "gearcase"}):
        figure.savefig(path, metadata={"Date": None})


def _page(axis: str, found: list[Curve], picture: str) -> str:
    text = [
        "# How faults show as they grow",
        "",
        "Made by `gearcase tendency --out docs/tendency.md`: simulated sound of the axis",
        f"`{axis}`, {len(SPECIMENS)} specimens, mean and range. All else stays the same along a curve.",
        "",
        f"![Features over fault size, payload and frequency of the motion]({picture})",
        "",
        "| fault | over | from | to | feature | at the start | at the end |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for curve in found:
        ends = f"{curve.at[0]:.3g} | {curve.at[-1]:.3g} {curve.unit}"
        name = feature_words(curve.feature)
        text.append(f"| {curve.label} | {curve.over} | {ends} | {name} | {curve.mean[0]:.2f} | {curve.mean[-1]:.2f} |")
    return "\n".join([*text, ""])
