"""`gearcase fit`, `compare` and `size`: measured sound of an axis against its simulation."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from app.commands import frame
from app.commands.frame import ACTOR, AXIS, CORES, Channel, Json, Payload, Period, Processes, Speed
from app.recordings.intake import mesh_orders, read_sound, shaft_orders
from app.simulated import comparison
from app.simulated.comparison import CAUSES, Comparison, FamilyGap, Gain
from app.simulated.generation import fitted_microphones
from app.simulated.severity_by_simulation import RUNS, Taken, design_for
from app.simulated.transfer_path import FittedPlace, fit_place, keep, measured_recordings
from casebase.reasoning.severity import COVERAGE, PARAMETERS, Severity
from signals.condition import OperatingCondition
from signals.features import extract, feature_words
from sim.errors import ParameterError
from sim.investigation.report.formatting import angle

SHOWN = 8
SURE = 0.05
LIBRARY, SIMULATION = "measured cases of the library", "simulation of this recording"


def fit(
    axis: Annotated[str, AXIS],
    json: Json = False,
) -> None:
    """Fit housing modes, rubbing, ambient noise and loudness to the measured normal recordings of an axis.

    No recording of a fault is looked at. `generate` uses the newest fit; what it cannot match is said with numbers.
    """
    described = frame.axis_of(axis)
    with frame.library() as library:
        with library.reading() as session:
            recordings = measured_recordings(library, session, described)
        with frame.WORDS.status("fitting") as status:
            place = fit_place(described, recordings, status.update)
        with library.transaction(ACTOR) as session:
            version = keep(session, place).version
    if json:
        frame.print_json({"version": version, **place.to_document()})
    else:
        _show_fit(place, version)


def _show_fit(place: FittedPlace, version: int) -> None:
    rows = [
        (
            name,
            " ".join(f"{mode.frequency_hz:.0f}" for mode in heard.modes),
            f"{heard.rubbing_n_m:.2f}",
            f"{heard.ambient_n_m:.2f}",
            f"{sound.misfit_db:.2f}",
        )
        for name, sound in place.sounds.items()
        for heard in [sound.microphone]
    ]
    columns = ("gearbox or recording", "modes [Hz]", "rubbing [N m]", "ambient [N m]", "spectrum misfit [dB]")
    test = place.test
    frame.show(
        frame.table(columns, rows),
        f"version {version}: {test.simulated} simulated normal recordings {_differ(test.p_value)} from {test.measured} "
        f"measured ones (energy distance {test.distance:.2f}, p = {test.p_value:.3f}); the nearest neighbour sorts "
        f"{test.told_apart:.0%} rightly, 50% is chance",
        *(
            f"  not matched: {each.feature}: measured {each.measured:.3g}, simulated {each.simulated:.3g}, "
            f"{each.difference:+.1f} standard deviations"
            for each in test.unmatched[:SHOWN]
        ),
    )


def _differ(p_value: float) -> str:
    return "differ clearly" if p_value < SURE else "do not differ clearly"


def compare(
    axis: Annotated[str, AXIS],
    label: Annotated[str, typer.Option(help="label that is compared")] = "normal",
    simulated: Annotated[int, typer.Option(min=4, max=1000, metavar="N", help="simulated recordings")] = 16,
    cause: Annotated[list[str] | None, typer.Option(help=f"try these alone; of {', '.join(CAUSES)}")] = None,
    seed: Annotated[int, typer.Option(min=0, help="the same seed gives the same recordings")] = 0,
    processes: Processes = CORES,
    json: Json = False,
) -> None:
    """Hold the library's measured recordings of an axis against simulated ones of the same label: which features lie
    apart, which part of the sound model is the cause, and what replacing it gains on gearboxes left out."""
    described = frame.axis_of(axis)
    with frame.library() as library, library.reading() as session:
        recordings = measured_recordings(library, session, described, label)
        normal = measured_recordings(library, session, described, "normal")
    with frame.WORDS.status("comparing") as status:
        found = comparison.compare(
            described,
            label,
            recordings,
            normal,
            count=simulated,
            seed=seed,
            processes=processes,
            causes=cause or (),
            advance=status.update,
        )
    frame.answer(json, asdict(found), *_lines(found))


def _lines(found: Comparison) -> list[str]:
    lines = [
        f"{found.simulated} simulated recordings labelled {found.label} {_differ(found.p_value)} from {found.measured} "
        f"measured ones of {found.gearboxes} gearboxes: energy distance {found.distance:.2f} where 0 is alike, "
        f"p = {found.p_value:.3f}",
        *(f"  {_line(family)}" for family in found.families),
        "parts of the sound model, replaced one at a time; gain: share of the distance that goes, on gearboxes left "
        "out",
    ]
    for each in found.extensions:
        word = "helps" if each.gain.helps else "does not clearly help"
        taken = ", ".join(each.taken)
        lines.append(f"  {each.cause} ({CAUSES[each.cause]}): {word}, {_words(each.gain)}; taken: {taken}")
    lines += [] if found.together is None else [f"all that helps together: {_words(found.together)}"]
    return [*lines, *(f"not tried: {reason}" for reason in found.not_tried)]


def _words(gain: Gain) -> str:
    one, other = gain.halves
    return f"{one:+.0%} and {other:+.0%}, mean {gain.mean:+.0%} with a standard error of {gain.error:.0%}"


def _line(family: FamilyGap) -> str:
    gap = family.farthest[0]
    cause = "" if family.p_value >= SURE else "; cause: none of these"
    if family.gain is not None:
        cause = f"; cause: {family.cause}, {family.gain:.0%} of the distance goes away"
    return (
        f"{family.family}: distance {family.distance:.2f}, p = {family.p_value:.3f}; farthest: "
        f"{feature_words(gap.feature)}, measured {gap.measured:.3g}, simulated {gap.simulated:.3g}, "
        f"{gap.difference:+.1f} spreads{cause}"
    )


def size(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="sound file: WAV, FLAC, phone formats")],
    axis: Annotated[str, AXIS],
    label: Annotated[str, typer.Option(help=f"what was diagnosed: {' or '.join(PARAMETERS)}")],
    speed: Speed = None,
    payload: Payload = None,
    period: Period = None,
    channel: Channel = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="simulate the recording, even if the library could say the size")
    ] = False,
    processes: Processes = CORES,
    json: Json = False,
) -> None:
    """Say how large the fault in a recording is, with an interval.

    Where the library has measured cases of the axis whose size is known, the size is that of a diagnosis. Otherwise, or
    with --simulate, the fault is simulated with the recording's axis, speed, payload and motion, in many sizes,
    specimens and microphones: about half a minute on two cores. That size is the simulation's, and its interval holds
    as far as the gear sounds like its simulation.
    """
    if label not in PARAMETERS:
        raise ParameterError(f"label: the size of {label!r} is not known; {', '.join(PARAMETERS)} have one")
    described = frame.axis_of(axis)
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
        _show_size(known_size, {"label": label, "by": LIBRARY}, json)
        return
    taken = Taken.of(described, extraction.motion, recording.duration_s, speed, payload)
    with frame.progress() as progress:
        bar = progress.add_task("simulating", total=RUNS)
        design = design_for(
            described, label, taken, microphones, processes=processes, advance=lambda: progress.advance(bar)
        )
    known = replace(condition, speed_rad_s=taken.speed_rad_s, payload_kg_m2=taken.payload_kg_m2)
    found = design.size_of(recording, known)
    _show_size(found, {"label": label, "by": SIMULATION, "sound_version": version}, json)


def _show_size(found: Severity, about: dict[str, object], json: bool) -> None:
    of_cases = f"{COVERAGE:.0%} of such cases"
    line = f"{found.parameter}: not heard, so at most {found.high:.2g} rad in {of_cases}"
    if not found.at_most:
        value = f"{found.value:.2g} rad ({angle(found.value, 0.3 * found.value)})"
        line = f"{found.parameter}: {value}, in {of_cases} between {found.low:.2g} and {found.high:.2g} rad"
    frame.answer(json, {**found.to_document(), **about}, line)
    if not json:
        held = "" if about["by"] == LIBRARY else "; the interval holds as far as the gear sounds like its simulation"
        frame.say(f"by {about['by']}{held}")
