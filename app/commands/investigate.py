"""`gearcase investigate`: hold measured data of an axis against its description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from app.commands import frame
from app.commands.frame import AXIS, Json
from app.investigations import investigated, reported
from app.recordings.intake import read_sound
from signals.columns.table_kinds import table_kinds
from signals.errors import SignalError
from signals.reading.plain_file import plain_bytes
from signals.reading.text import text_of
from signals.recording import Recording
from signals.telemetry import Telemetry, read_telemetry
from sim.description.axis_document import write_axis
from sim.investigation.data.pairing import check_pairs
from sim.investigation.investigate import Progress
from sim.investigation.pooling.joint_investigation import Together
from sim.investigation.report.box import unexplained_words
from sim.investigation.report.checks import ROWS, checked
from sim.investigation.report.formatting import angle, likely, named
from sim.investigation.report.wording import headline
from sim.investigation.results import Estimate, Investigation
from sim.robot.results import RobotInvestigation

Read = TypeVar("Read")
Done = TypeVar("Done")


def investigate(
    axis: Annotated[
        str | None,
        typer.Option(metavar="AXIS", help=f"{AXIS.help}; sound alone uses its motion.period_s"),
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
    json: Json = False,
) -> None:
    """Find what the simulation of an axis gets wrong and why, and how much an extended model improves it."""
    if (axis is None) == (robot is None):
        raise typer.BadParameter("give --axis AXIS for one axis, or --robot ROBOT.toml for a whole robot")
    if axis is None:
        assert robot is not None
        if extended is not None:
            raise typer.BadParameter("--extended is of one axis; a robot's stands in its --json document")
        if sound or as_new:
            raise typer.BadParameter("sound is investigated with an axis; give --axis AXIS of the joint that is heard")
        _of_robot(robot, telemetry or [], channels, report, json=json)
        return
    described = frame.axis_of(axis)
    check_pairs(len(telemetry or ()), len(sound or ()), len(as_new or ()), channel_map=channels is not None)
    heard, before = _sounds(sound or ()), _sounds(as_new or ())
    measured = _measured(telemetry or (), channels)
    found = _watched(lambda watch: investigated(described, measured, heard, before, sound_offset, watch))
    result, whose = (found, ["" for _ in found.gain]) if isinstance(found, Investigation) else _together(found)
    files = [path.name for path in (Path(axis), *(telemetry or ()), *(sound or ()), *(as_new or ()))]
    _report(found, files, report)
    if extended is not None:
        extended.write_text(write_axis(result.extended), encoding="utf-8")
        frame.say(f"extended description: {extended}")
    frame.answer(json, found.document(), *_lines(result, whose))


def _sounds(files: Sequence[Path]) -> list[Recording]:
    return [replace(_read(one, read_sound), name=one.name) for one in files]


def _measured(telemetry: Sequence[Path], channels: Path | None) -> list[tuple[str, Telemetry]]:
    """Telemetry with what it is called: file names, or whole paths where those are alike."""
    read = partial(read_telemetry, channels=_text_of(channels))
    alike = len({path.name for path in telemetry}) < len(telemetry)
    return [(str(path) if alike else path.name, _read(path, read)) for path in telemetry]


def _text_of(channels: Path | None) -> str | None:
    return None if channels is None else _read(channels, lambda path: text_of(plain_bytes(path)))


def _together(found: Together) -> tuple[Investigation, list[str]]:
    return found.combined, [f"{part.recording.name}: " for part in found.parts for _ in part.gain]


def _report(found: Investigation | Together | RobotInvestigation, files: Sequence[str], to: Path | None) -> None:
    if to is not None:
        to.write_text(reported(found, files)[1], encoding="utf-8")
        frame.say(f"report: {to}")


def _of_robot(
    robot: Path,
    telemetry: Sequence[Path],
    channels: Path | None,
    report: Path | None,
    *,
    json: bool,
) -> None:
    """Investigate all joints of a robot."""
    from sim.robot.investigation import investigate_robot
    from sim.robot.motion import read_log
    from sim.robot.report import lines
    from sim.robot.robot import read_robot

    described, map_ = read_robot(robot), _text_of(channels)
    logs = [_read(path, lambda one: read_log(described, one, map_)) for path in telemetry]
    result = _watched(lambda watch: investigate_robot(described, logs, watch))
    _report(result, (), report)
    frame.answer(json, result.document(), *lines(result))


def _read(path: Path, read: Callable[[Path], Read]) -> Read:
    """Read a file; an error begins with its name."""
    try:
        return read(path)
    except SignalError as error:
        raise type(error)(f"{path}: {error}") from error


def _watched(work: Callable[[Progress], Done]) -> Done:
    """Run with a line on stderr for every stage."""
    frame.say("thirty seconds of data take ten seconds to a minute on two cores, longer if the model misses much")
    last = ""

    def watch(stage: str, share: float) -> None:
        nonlocal last
        if stage != last:
            frame.say(f"{share:4.0%} {stage}")
            last = stage

    return work(watch)


def _lines(result: Investigation, whose: Sequence[str]) -> list[str]:
    lines = [headline(result)]
    for f in result.findings:
        alike = " or ".join(map(named, f.indistinguishable_from))
        lines += [
            f"  {named(f.mechanism, f.location)}, {likely(f.probability, calibrated=f.calibrated)}: {f.explanation}",
            *(f"    {e.name} = {_with_unit(e)} ({e.low:.5g} to {e.high:.5g})" for e in f.parameters),
            *([f"    in these data it looks the same as {alike}"] if alike else []),
            f"    what to do now: {f.action}",
        ]
    if result.unexplained is not None:
        lines.append(f"  of unknown cause: {unexplained_words(result.unexplained)}")
    for e in result.parameters:
        described = "not described" if e.nominal is None else f"described {e.nominal:.5g}"
        lines.append(f"  {e.name}: {described}, found {_with_unit(e)} ({e.low:.5g} to {e.high:.5g})")
    lines += [
        f"  {recording}{g.channel}: error {g.rms_before:.4g} -> {g.rms_after:.4g} {g.unit} (rms) on rows not used "
        f"for the fit{'' if g.significant else ' (may be chance)'}"
        for g, recording in zip(result.gain, whose, strict=True)
    ]
    rows = dict(checked(result)).get(ROWS)
    lines += [] if rows is None else [f"  {ROWS}: {rows}"]
    return [*lines, *(f"  note: {remark}" for remark in result.remarks), result.next_measurement]


def _with_unit(e: Estimate) -> str:
    shown = f" ({angle(e.value, 0.5 * (e.high - e.low))})" if e.unit == "rad" else ""
    return f"{e.value:.5g}" + (f" {e.unit}{shown}" if e.unit != "1" else "")
