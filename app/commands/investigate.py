"""`gearcase investigate`: hold measured data of an axis against its description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import Frame, frame_of
from app.recordings.sound import read_sound
from signals.columns.table_kinds import table_kinds
from signals.errors import SignalError
from signals.reading.text import text_of
from signals.recording import Recording
from signals.telemetry import Telemetry, read_telemetry
from sim.description.axis_document import write_axis
from sim.investigation.data.pairing import check_pairs
from sim.investigation.investigate import Progress, investigate
from sim.investigation.pooling.joint_investigation import investigate_together
from sim.investigation.pooling.pooled_estimates import Taken
from sim.investigation.report.box import unexplained_words
from sim.investigation.report.checks import ROWS, checked
from sim.investigation.report.formatting import angle, likely, named
from sim.investigation.report.html import html_report
from sim.investigation.report.joint_html import html_report_together
from sim.investigation.report.wording import headline
from sim.investigation.results import Estimate, Investigation

Read = TypeVar("Read")
Done = TypeVar("Done")


def register(app: typer.Typer) -> None:
    app.command("investigate")(run)


def run(
    context: typer.Context,
    axis: Annotated[
        str | None,
        typer.Option(metavar=METAVAR, help=f"{MEANT}; sound alone uses its motion.period_s"),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(metavar="ROBOT.toml", help="instead of an axis: a robot with its URDF, of all its logged joints"),
    ] = None,
    telemetry: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="T.csv",
            help=f"measured channels: {table_kinds()}; repeat it for several of the same axis",
        ),
    ] = None,
    channels: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP.toml",
            help="says which column is which channel, if names and units do not; for all telemetry files",
        ),
    ] = None,
    sound: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="S.wav",
            help="sound of the same motion, one for each telemetry in the same order; or several without telemetry",
        ),
    ] = None,
    as_new: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="N.wav",
            help="sound of the same motion from when the axis was new, for sound without telemetry to be compared with",
        ),
    ] = None,
    sound_offset: Annotated[
        float, typer.Option(metavar="S", help="how long after its telemetry every sound starts [s]")
    ] = 0.0,
    report: Annotated[
        Path | None, typer.Option(metavar="OUT.html", help="one file with plots that works offline")
    ] = None,
    extended: Annotated[
        Path | None,
        typer.Option(metavar="OUT.toml", help="the description with all that was found, for the next investigation"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Find what the simulation of an axis gets wrong and why, and how much an extended model improves it."""
    frame = frame_of(context)
    if (axis is None) == (robot is None):
        raise typer.BadParameter("give --axis AXIS for one axis, or --robot ROBOT.toml for a whole robot")
    if axis is None:
        assert robot is not None
        if extended is not None:
            raise typer.BadParameter("--extended is of one axis; a robot's stands in its --json document")
        if sound or as_new:
            raise typer.BadParameter("sound is investigated with an axis; give --axis AXIS of the joint that is heard")
        _of_robot(frame, robot, telemetry or [], channels, report, json=json)
        return
    described = axis_of(frame, axis)
    check_pairs(len(telemetry or ()), len(sound or ()), len(as_new or ()), channel_map=channels is not None)
    heard, before = _sounds(sound or ()), _sounds(as_new or ())
    measured = _measured(telemetry or (), channels)
    if len(measured) > 1:
        taken = _taken(telemetry or (), measured, sound or (), heard)
        together = _watched(frame, lambda watch: investigate_together(described, taken, watch, sound_offset))
        result, document, page = together.combined, together.document, partial(html_report_together, together)
        whose = [f"{part.taken.name}: " for part in together.parts for _ in part.gain]
    else:
        first = measured[0] if measured else None
        result = _watched(frame, lambda watch: investigate(described, first, heard, watch, sound_offset, before))
        files = [path.name for path in (Path(axis), *(telemetry or ()), *(sound or ()), *(as_new or ()))]
        document, page, whose = result.document, partial(html_report, result, files), ["" for _ in result.gain]
    if report is not None:
        report.write_text(page(), encoding="utf-8")
        frame.say(f"report: {report}")
    if extended is not None:
        extended.write_text(write_axis(result.extended), encoding="utf-8")
        frame.say(f"extended description: {extended}")
    if json:
        frame.print_json(document())
    else:
        _show(frame, result, whose)


def _sounds(files: Sequence[Path]) -> list[Recording]:
    return [replace(_read(one, read_sound), name=one.name) for one in files]


def _measured(telemetry: Sequence[Path], channels: Path | None) -> list[Telemetry]:
    map_ = None if channels is None else _read(channels, lambda path: text_of(path.read_bytes()))
    return [_read(one, partial(read_telemetry, channels=map_)) for one in telemetry]


def _of_robot(
    frame: Frame,
    robot: Path,
    telemetry: Sequence[Path],
    channels: Path | None,
    report: Path | None,
    *,
    json: bool,
) -> None:
    """Investigate all joints of a robot."""
    from sim.robot.investigation import investigate_robot
    from sim.robot.log import read_log
    from sim.robot.report import lines, robot_report
    from sim.robot.robot import read_robot

    described = read_robot(robot)
    map_ = None if channels is None else _read(channels, lambda path: text_of(path.read_bytes()))
    logs = [_read(path, lambda one: read_log(described, one, map_)) for path in telemetry]
    result = _watched(frame, lambda watch: investigate_robot(described, logs, watch))
    if report is not None:
        report.write_text(robot_report(result), encoding="utf-8")
        frame.say(f"report: {report}")
    if json:
        frame.print_json(result.document())
        return
    for line in lines(result):
        frame.print(line)


def _read(path: Path, read: Callable[[Path], Read]) -> Read:
    """Read a file; an error begins with its name."""
    try:
        return read(path)
    except SignalError as error:
        raise type(error)(f"{path}: {error}") from error


def _taken(
    telemetry: Sequence[Path], measured: Sequence[Telemetry], sound: Sequence[Path], heard: Sequence[Recording]
) -> list[Taken]:
    """Recordings with what they are called: file names, or whole paths where those are alike."""
    alike = len({path.name for path in telemetry}) < len(telemetry)
    names = [str(path) if alike else path.name for path in telemetry]
    taken = [Taken(name, one) for name, one in zip(names, measured, strict=True)]
    for place, (path, one) in enumerate(zip(sound, heard, strict=True)):
        taken[place] = replace(taken[place], sound=one, sound_name=path.name)
    return taken


def _watched(frame: Frame, work: Callable[[Progress], Done]) -> Done:
    """Run with a line on stderr for every stage."""
    frame.say("thirty seconds of data take ten seconds to a minute on two cores, longer if the model misses much")
    last = ""

    def watch(stage: str, share: float) -> None:
        nonlocal last
        if stage != last:
            frame.say(f"{share:4.0%} {stage}")
            last = stage

    return work(watch)


def _show(frame: Frame, result: Investigation, whose: Sequence[str]) -> None:
    frame.print(headline(result))
    for f in result.findings:
        sure = likely(f.probability, calibrated=f.calibrated)
        frame.print(f"  {named(f.mechanism, f.location)}, {sure}: {f.explanation}")
        for e in f.parameters:
            frame.print(f"    {e.name} = {_with_unit(e)} ({e.low:.5g} to {e.high:.5g})")
        if f.indistinguishable_from:
            frame.print(f"    in these data it looks the same as {' or '.join(map(named, f.indistinguishable_from))}")
        frame.print(f"    what to do now: {f.action}")
    if result.unexplained is not None:
        frame.print(f"  without a name: {unexplained_words(result.unexplained)}")
    for e in result.parameters:
        described = "not described" if e.nominal is None else f"described {e.nominal:.5g}"
        frame.print(f"  {e.name}: {described}, found {_with_unit(e)} ({e.low:.5g} to {e.high:.5g})")
    for g, recording in zip(result.gain, whose, strict=True):
        note = "" if g.significant else " (may be chance)"
        frame.print(
            f"  {recording}{g.channel}: error {g.rms_before:.4g} -> {g.rms_after:.4g} {g.unit} (rms) on rows not used "
            f"for the fit{note}"
        )
    if (rows := dict(checked(result)).get(ROWS)) is not None:
        frame.print(f"  {ROWS}: {rows}")
    for remark in result.remarks:
        frame.print(f"  note: {remark}")
    frame.print(result.next_measurement)


def _with_unit(e: Estimate) -> str:
    shown = f" ({angle(e.value, 0.5 * (e.high - e.low))})" if e.unit == "rad" else ""
    return f"{e.value:.5g}" + (f" {e.unit}{shown}" if e.unit != "1" else "")
