"""`gearcase size FILE`: the size of backlash or tooth damage, as in a diagnosis or simulated as it was recorded."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import Frame, frame_of
from app.recordings.intake import mesh_orders, shaft_orders
from app.recordings.sound import read_sound
from app.simulated.generation import fitted_microphones
from app.simulated.severity_by_simulation import RUNS, Taken, design_for
from casebase.reasoning.severity import COVERAGE, PARAMETERS, Severity
from signals.condition import OperatingCondition
from signals.features import extract
from sim.errors import ParameterError
from sim.investigation.report.formatting import angle

LIBRARY, SIMULATION = "measured cases of the library", "simulation of this recording"


def register(app: typer.Typer) -> None:
    app.command("size")(size)


def size(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="sound file: WAV, FLAC, phone formats")],
    axis: Annotated[str, typer.Option(metavar=METAVAR, help=MEANT)],
    label: Annotated[str, typer.Option(help=f"what was diagnosed: {' or '.join(PARAMETERS)}")],
    speed: Annotated[float | None, typer.Option(help="largest speed of the output [rad/s]")] = None,
    payload: Annotated[float | None, typer.Option(help="inertia carried by the output [kg m2]")] = None,
    period: Annotated[float | None, typer.Option(help="one full cycle of the motion [s]")] = None,
    channel: Annotated[int | None, typer.Option(help="channel to use, from 0")] = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="simulate the recording, even if the library could say the size")
    ] = False,
    processes: Annotated[int, typer.Option(min=1, help="at once")] = os.cpu_count() or 1,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Say how large the fault in a recording is, with an interval.

    Where the library has measured cases of the axis whose size is known, the size is that of a diagnosis. Otherwise, or
    with --simulate, the fault is simulated with the recording's axis, speed, payload and motion, in many sizes,
    specimens and microphones: about half a minute on two cores. That size is the simulation's, and its interval holds
    as far as the gear sounds like its simulation.
    """
    frame = frame_of(context)
    if label not in PARAMETERS:
        raise ParameterError(f"label: the size of {label!r} is not known; {', '.join(PARAMETERS)} have one")
    described = axis_of(frame, axis)
    condition = OperatingCondition(
        speed_rad_s=speed,
        payload_kg_m2=payload,
        motion_period_s=period,
        shaft_orders=shaft_orders(described),
        mesh_orders=mesh_orders(described),
    )
    recording = read_sound(file, channel=channel)
    extraction = extract(recording, condition)
    with frame.library() as library:
        with library.reading() as session:
            known_size = None if simulate else library.reuse.severity(session, extraction, described.name, label)
        microphones, version = fitted_microphones(library, described)
    if known_size is not None:
        _show(frame, known_size, {"label": label, "by": LIBRARY}, json)
        return
    taken = Taken.of(described, extraction.motion, recording.duration_s, speed, payload)
    with frame.progress() as progress:
        bar = progress.add_task("simulating", total=RUNS)
        design = design_for(
            described, label, taken, microphones, processes=processes, advance=lambda: progress.advance(bar)
        )
    known = replace(condition, speed_rad_s=taken.speed_rad_s, payload_kg_m2=taken.payload_kg_m2)
    found = design.size_of(recording, known)
    _show(frame, found, {"label": label, "by": SIMULATION, "sound_version": version}, json)


def _show(frame: Frame, found: Severity, about: dict[str, object], json: bool) -> None:
    if json:
        frame.print_json({**found.to_document(), **about})
        return
    if found.at_most:
        frame.print(f"{found.parameter}: not heard, so at most {found.high:.2g} rad in {COVERAGE:.0%} of such cases")
    else:
        frame.print(
            f"{found.parameter}: {found.value:.2g} rad ({angle(found.value, 0.3 * found.value)}), in {COVERAGE:.0%} of "
            f"such cases between {found.low:.2g} and {found.high:.2g} rad"
        )
    held = "" if about["by"] == LIBRARY else "; the interval holds as far as the gear sounds like its simulation"
    frame.say(f"by {about['by']}{held}")
