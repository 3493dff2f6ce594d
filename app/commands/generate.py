"""`gearcase generate`: cases by simulation into the local library; `gearcase starter`: a first library of them.

All of the starter library is simulated, and says so.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from pydantic import BaseModel, ConfigDict

from app.commands import frame
from app.commands.frame import AXIS, CORES, Json, Processes
from app.recordings.intake import RecordingMetadata, take_in
from app.simulated import generation
from app.simulated.generation import Campaign, Outcome, fitted_microphones, simulate_case
from casebase.axes import add_axis
from casebase.library import CaseLibrary
from casebase.origins import DEMO
from casebase.store.artifacts import active_artifact, add_artifact
from signals.reading.plain_file import plain_bytes
from signals.reading.text import text_of
from sim.experiment.design_of_experiments import DURATION_S, LABELS, labels, plan
from sim.experiment.paper_axis import PAPER_AXIS

PER_LABEL = 30
DEMO_SEED = 1  # no case of the starter library comes from it
DEMO_NAME = "demo-simulated-notch.wav"


def generate(
    axis: Annotated[str, AXIS],
    per_label: Annotated[int | None, typer.Option(min=1, max=10_000, metavar="N", help="cases of each label")] = None,
    plan_file: Annotated[
        Path | None,
        typer.Option("--plan", metavar="PLAN.json", help="instead: what `cases review --plan` found missing"),
    ] = None,
    label: Annotated[
        list[str] | None, typer.Option(help=f"these instead of {', '.join(LABELS)}; of {', '.join(labels())}")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="the same seed gives the same cases")] = 0,
    duration: Annotated[float, typer.Option(help="of each recording [s]")] = DURATION_S,
    motion: Annotated[
        Literal["described", "any"], typer.Option(help="around that of the description, where it says one, or any")
    ] = "described",
    generic: Annotated[bool, typer.Option(help="do not use the sound fitted to this axis")] = False,
    processes: Processes = CORES,
    json: Json = False,
) -> None:
    """Generate cases for an axis: a space-filling plan over fault size, place and flank, payload, speed, microphone
    and noise. Cases that are there already are not made again, so an interrupted run is repeated as it was."""
    if (per_label is None) == (plan_file is None):
        raise typer.BadParameter("give either --per-label or --plan")
    described = frame.axis_of(axis)
    entries = [{"counts": dict.fromkeys(label or LABELS, per_label)}] if plan_file is None else read_plan(plan_file)
    with frame.library() as library:
        microphones, version = ((), None) if generic else fitted_microphones(library, described)
        common: dict[str, Any] = {
            "seed": seed,
            "motion": motion,
            "duration_s": duration,
            "microphones": microphones,
            "sound_version": version,
        }
        campaigns = [Campaign(described, **common, **entry) for entry in entries]
        outcomes = [with_progress(library, each, processes) for each in campaigns]
    new, known = sum(each.new for each in outcomes), sum(each.known for each in outcomes)
    counts = sum((Counter(each.counts) for each in campaigns), Counter())
    sound = "usual housings" if version is None else f"the sound fitted to this axis (version {version})"
    document = {"new": new, "known": known, "counts": counts, "seed": seed, "sound_version": version}
    frame.answer(json, document, f"{new} cases generated with {sound}, {known} were there already")


def read_plan(path: Path) -> list[dict[str, Any]]:
    """The campaigns of a plan file. Raises ValidationError where it is none."""
    return [each.model_dump() for each in PlanFile.model_validate_json(text_of(plain_bytes(path))).campaigns]


class Entry(BaseModel):
    """One hole: cases by label, and from where to where payload and speed should lie."""

    model_config = ConfigDict(extra="forbid")
    counts: dict[str, int]
    payload_kg_m2: tuple[float, float] | None = None
    speed_rad_s: tuple[float, float] | None = None


class PlanFile(BaseModel):
    """What `cases review --plan` writes."""

    campaigns: list[Entry]


def with_progress(library: CaseLibrary, campaign: Campaign, processes: int) -> Outcome:
    """Generate with a progress bar, and where there is no terminal for one with a line at every tenth."""
    total, done = sum(campaign.counts.values()), 0
    with frame.progress() as progress:
        bar = progress.add_task("simulating", total=total)

        def advance(count: int) -> None:
            nonlocal done
            before, done = done, done + count
            progress.advance(bar, count)
            if progress.disable and 10 * before // total < 10 * done // total:
                frame.say(f"simulated {done} of {total} cases")

        return generation.generate(
            library, campaign, processes=processes, batch=f"seed {campaign.seed}", advance=advance
        )


def starter(
    per_label: Annotated[int, typer.Option(min=1, help="cases of each label")] = PER_LABEL,
    processes: Processes = CORES,
) -> None:
    """Fill an empty library with simulated cases of the paper's axis, and write a simulated recording to diagnose.

    Does nothing where the library has measured cases or as many as these; goes on where it was interrupted.
    """
    demo = frame.settings().data_dir / DEMO_NAME
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
            campaign = Campaign(PAPER_AXIS, dict.fromkeys(LABELS, per_label), motion="any")
            outcome = with_progress(library, campaign, processes)
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
