"""`gearcase compare`: what the simulated sound of an axis gets wrong."""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import Annotated

import typer

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import Frame, frame_of
from app.simulated.comparison import CAUSES, Comparison, FamilyGap, Gain, compare
from app.simulated.transfer_path import measured_recordings
from signals.features import feature_words

SURE = 0.05


def register(app: typer.Typer) -> None:
    app.command("compare")(compare_sound)


def compare_sound(
    context: typer.Context,
    axis: Annotated[str, typer.Option(metavar=METAVAR, help=MEANT)],
    label: Annotated[str, typer.Option(help="label that is compared")] = "normal",
    simulated: Annotated[int, typer.Option(min=4, max=1000, metavar="N", help="simulated recordings")] = 16,
    cause: Annotated[list[str] | None, typer.Option(help=f"try these alone; of {', '.join(CAUSES)}")] = None,
    seed: Annotated[int, typer.Option(min=0, help="the same seed gives the same recordings")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="at once")] = os.cpu_count() or 1,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Hold the library's measured recordings of an axis against simulated ones of the same label: which features lie
    apart, which part of the sound model is the cause, and what replacing it gains on gearboxes left out."""
    frame = frame_of(context)
    described = axis_of(frame, axis)
    with frame.library() as library, library.reading() as session:
        recordings = measured_recordings(library, session, described, label)
        normal = measured_recordings(library, session, described, "normal")
    with frame.words.status("comparing") as status:
        found = compare(
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
    if json:
        frame.print_json(asdict(found))
    else:
        _print(frame, found)


def _print(frame: Frame, found: Comparison) -> None:
    differ = "differ clearly" if found.p_value < SURE else "do not differ clearly"
    frame.print(
        f"{found.simulated} simulated recordings labelled {found.label} {differ} from {found.measured} measured "
        f"ones of {found.gearboxes} gearboxes: energy distance {found.distance:.2f} where 0 is alike, "
        f"p = {found.p_value:.3f}"
    )
    for family in found.families:
        frame.print(f"  {_line(family)}")
    frame.print(
        "parts of the sound model, replaced one at a time; gain: share of the distance that goes, on gearboxes left out"
    )
    for each in found.extensions:
        word = "helps" if each.gain.helps else "does not clearly help"
        taken = ", ".join(each.taken)
        frame.print(f"  {each.cause} ({CAUSES[each.cause]}): {word}, {_words(each.gain)}; taken: {taken}")
    if found.together is not None:
        frame.print(f"all that helps together: {_words(found.together)}")
    for reason in found.not_tried:
        frame.print(f"not tried: {reason}")


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
