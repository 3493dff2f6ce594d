"""`gearcase starter`: a first library, and a recording to diagnose with it. All of it is simulated, and says so."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from app.commands.frame import frame_of
from app.commands.generate import with_progress
from app.recordings.intake import DEMO, take_in
from app.recordings.metadata import RecordingMetadata
from app.simulated.generation import Campaign, simulate_case
from casebase.axes import add_axis
from casebase.library import CaseLibrary
from casebase.store.artifacts import active_artifact, add_artifact
from sim.experiment.design_of_experiments import LABELS, plan
from sim.experiment.paper_axis import PAPER_AXIS

PER_LABEL = 30
DEMO_SEED = 1  # no case of the starter library comes from it
DEMO_NAME = "demo-simulated-notch.wav"


def register(app: typer.Typer) -> None:
    app.command("starter")(starter)


def starter(
    context: typer.Context,
    per_label: Annotated[int, typer.Option(min=1, help="cases of each label")] = PER_LABEL,
    processes: Annotated[int, typer.Option(min=1, help="at once")] = os.cpu_count() or 1,
) -> None:
    """Fill an empty library with simulated cases of the paper's axis, and write a simulated recording to diagnose.

    Does nothing where the library has measured cases or as many as these; goes on where it was interrupted.
    """
    frame = frame_of(context)
    demo = frame.settings.data_dir / DEMO_NAME
    with frame.library() as library:
        with library.reading() as session:
            counts = library.retrieve.counts(session)
            shown = active_artifact(session, DEMO)
        if any(origin == "measured" for _, origin in counts):
            return
        if sum(counts.values()) < per_label * len(LABELS):
            frame.say(f"simulating a starter library for {PAPER_AXIS.name}: {per_label} each of {', '.join(LABELS)}")
            with library.transaction("starter") as session:
                add_axis(session, PAPER_AXIS.name, PAPER_AXIS.to_mapping())
            campaign = Campaign(PAPER_AXIS, dict.fromkeys(LABELS, per_label))
            outcome = with_progress(frame, library, campaign, processes)
            frame.say(f"{outcome.new + outcome.known} simulated cases")
        if shown is None:
            frame.say("simulating a recording to diagnose")
            write_demo(demo)
            frame.say("diagnosing that recording")
            diagnose_demo(library, demo)
            frame.say(f"a simulated recording to diagnose: {demo}")


def diagnose_demo(library: CaseLibrary, path: Path) -> None:
    """Diagnose the demonstration and remember which diagnosis that is: the front page shows it to anybody."""
    known = RecordingMetadata(
        axis=PAPER_AXIS.name, gearbox="demonstration", speed_rad_s=PAPER_AXIS.motion.load_speed_rad_s, channel=0
    )
    intake = take_in(library, path, path.name, "audio/wav", known, PAPER_AXIS)
    with library.transaction("starter") as session:
        row = intake.store(library, session)
        diagnosis = library.reuse.diagnose(session, row, intake.extraction)
        add_artifact(session, DEMO, {"diagnosis_id": diagnosis.id, "recording_id": row.id})


def write_demo(path: Path) -> None:
    """Write a recording of a notched output gear."""
    planned = plan(PAPER_AXIS, {"notch": 6}, DEMO_SEED, duration_s=20.0)
    plainest = max(planned, key=lambda each: each.size or 0.0)
    path.write_bytes(simulate_case(plainest).audio)
