"""`gearcase fit`: the sound of a place from the normal recordings in the library."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import ACTOR, Frame, frame_of
from app.simulated.transfer_path import FittedPlace, fit_place, keep, measured_recordings

SHOWN = 8


def register(app: typer.Typer) -> None:
    app.command("fit")(fit)


def fit(
    context: typer.Context,
    axis: Annotated[str, typer.Option(metavar=METAVAR, help=MEANT)],
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Fit housing modes, rubbing, ambient noise and loudness to the measured normal recordings of an axis.

    No recording of a fault is looked at. `generate` uses the newest fit; what it cannot match is said with numbers.
    """
    frame = frame_of(context)
    described = axis_of(frame, axis)
    with frame.library() as library:
        with library.reading() as session:
            recordings = measured_recordings(library, session, described)
        with frame.words.status("fitting") as status:
            place = fit_place(described, recordings, status.update)
        with library.transaction(ACTOR) as session:
            version = keep(session, place).version
    if json:
        frame.print_json({"version": version, **place.to_document()})
        return
    _print(frame, place, version)


def _print(frame: Frame, place: FittedPlace, version: int) -> None:
    table = Table("gearbox or recording", "modes [Hz]", "rubbing [N m]", "ambient [N m]", "spectrum misfit [dB]")
    for name, sound in place.sounds.items():
        modes = " ".join(f"{mode.frequency_hz:.0f}" for mode in sound.microphone.modes)
        heard = sound.microphone
        table.add_row(name, modes, f"{heard.rubbing_n_m:.2f}", f"{heard.ambient_n_m:.2f}", f"{sound.misfit_db:.2f}")
    frame.results.print(table)
    test = place.test
    differ = "differ clearly" if test.p_value < 0.05 else "do not differ clearly"
    frame.print(
        f"version {version}: {test.simulated} simulated normal recordings {differ} from {test.measured} "
        f"measured ones (energy distance {test.distance:.2f}, p = {test.p_value:.3f}); the nearest neighbour sorts "
        f"{test.told_apart:.0%} rightly, 50% is chance"
    )
    for each in test.unmatched[:SHOWN]:
        frame.print(
            f"  not matched: {each.feature}: measured {each.measured:.3g}, simulated {each.simulated:.3g}, "
            f"{each.difference:+.1f} standard deviations"
        )
