"""`gearcase investigate`: hold measured data of an axis against its description."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from app.commands.frame import Frame, frame_of
from casebase.signals.decode import read_recording
from casebase.signals.telemetry import read_telemetry
from sim.axis import read_axis
from sim.discrepancy.explanation import headline
from sim.discrepancy.investigation import Investigation, investigate
from sim.discrepancy.report import html_report


def register(app: typer.Typer) -> None:
    app.command("investigate")(run)


def run(
    context: typer.Context,
    axis: Annotated[
        Path,
        typer.Option(metavar="AXIS.toml", help="what the axis is believed to be; sound alone uses its motion.period_s"),
    ],
    telemetry: Annotated[Path | None, typer.Option(metavar="T.csv", help="measured channels, CSV or Parquet")] = None,
    sound: Annotated[
        list[Path] | None,
        typer.Option(metavar="S.wav", help="recording of the same motion; without telemetry, several of the same axis"),
    ] = None,
    sound_offset: Annotated[
        float, typer.Option(metavar="S", help="start of the sound after the telemetry's, in s")
    ] = 0.0,
    report: Annotated[
        Path | None, typer.Option(metavar="OUT.html", help="one file with plots that works offline")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Say what the simulation of an axis gets wrong, why, and what the extended model gains."""
    frame = frame_of(context)
    described = read_axis(axis)
    measured = None if telemetry is None else read_telemetry(telemetry)
    heard = [replace(read_recording(one), name=one.name) for one in sound or ()]
    result = _watched(frame, lambda watch: investigate(described, measured, heard, watch, sound_offset))
    if report is not None:
        files = [path.name for path in (axis, telemetry, *(sound or ())) if path is not None]
        report.write_text(html_report(result, files), encoding="utf-8")
        frame.say(f"report: {report}")
    if json:
        frame.print_json(result.document())
    else:
        _show(frame, result)


def _watched(frame: Frame, work: object) -> Investigation:
    """Run with a line on stderr for every stage."""
    last = ""

    def watch(stage: str, share: float) -> None:
        nonlocal last
        if stage != last:
            frame.say(f"{share:4.0%} {stage}")
            last = stage

    return work(watch)  # type: ignore[operator, no-any-return]


def _show(frame: Frame, result: Investigation) -> None:
    frame.print(headline(result))
    for f in result.findings:
        place = f" ({f.location})" if f.location else ""
        frame.print(f"  {f.mechanism}{place}, probability {f.probability:.2f}: {f.explanation}")
        for e in f.parameters:
            frame.print(f"    {e.name} = {e.value:.5g} {e.unit} ({e.low:.5g} to {e.high:.5g})")
        if f.indistinguishable_from:
            frame.print(f"    these data cannot tell it from {', '.join(f.indistinguishable_from)}")
        frame.print(f"    what to do now: {f.action}")
    if result.unexplained is not None:
        where = ", ".join(f"{name} {value:.4g}" for name, value in result.unexplained.numbers.items())
        frame.print(f"  unexplained: {where} in {result.unexplained.channel}")
    for e in result.parameters:
        frame.print(f"  {e.name}: described {e.nominal:.5g}, found {e.value:.5g} {e.unit}")
    for g in result.gain:
        note = "" if g.significant else " (not distinguishable from zero)"
        frame.print(f"  {g.channel}: {g.rms_before:.4g} -> {g.rms_after:.4g} {g.unit} on held-out rows{note}")
    for remark in result.remarks:
        frame.print(f"  note: {remark}")
    frame.print(result.next_measurement)
