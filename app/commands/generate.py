"""`gearcase generate`: cases by simulation into the local library."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import BaseModel, ConfigDict

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import Frame, frame_of
from app.simulated.generation import Campaign, Outcome, fitted_microphones, generate
from casebase.library import CaseLibrary
from signals.reading.text import text_of
from sim.experiment.design_of_experiments import DURATION_S, LABELS, labels


def register(app: typer.Typer) -> None:
    app.command("generate")(generate_cases)


def generate_cases(
    context: typer.Context,
    axis: Annotated[str, typer.Option(metavar=METAVAR, help=MEANT)],
    per_label: Annotated[int | None, typer.Option(min=1, max=10_000, metavar="N", help="cases of each label")] = None,
    plan: Annotated[
        Path | None, typer.Option(metavar="PLAN.json", help="instead: what `cases review --plan` found missing")
    ] = None,
    label: Annotated[
        list[str] | None, typer.Option(help=f"these instead of {', '.join(LABELS)}; of {', '.join(labels())}")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="the same seed gives the same cases")] = 0,
    duration: Annotated[float, typer.Option(help="of each recording [s]")] = DURATION_S,
    generic: Annotated[bool, typer.Option(help="do not use the sound fitted to this axis")] = False,
    processes: Annotated[int, typer.Option(min=1, help="at once")] = os.cpu_count() or 1,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Generate cases for an axis: a space-filling plan over fault size, place and flank, payload, speed, microphone
    and noise. Cases that are there already are not made again, so an interrupted run is repeated as it was."""
    frame = frame_of(context)
    if (per_label is None) == (plan is None):
        raise typer.BadParameter("give either --per-label or --plan")
    described = axis_of(frame, axis)
    entries = [{"counts": dict.fromkeys(label or LABELS, per_label)}] if plan is None else read_plan(plan)
    with frame.library() as library:
        microphones, version = ((), None) if generic else fitted_microphones(library, described)
        campaigns = [
            Campaign(
                described,
                seed=seed,
                duration_s=duration,
                microphones=microphones,
                sound_version=version,
                **entry,
            )
            for entry in entries
        ]
        outcomes = [with_progress(frame, library, each, processes) for each in campaigns]
    new, known = sum(each.new for each in outcomes), sum(each.known for each in outcomes)
    counts = sum((Counter(each.counts) for each in campaigns), Counter())
    if json:
        frame.print_json({"new": new, "known": known, "counts": counts, "seed": seed, "sound_version": version})
    else:
        sound = "usual housings" if version is None else f"the sound fitted to this axis (version {version})"
        frame.print(f"{new} cases generated with {sound}, {known} were there already")


def read_plan(path: Path) -> list[dict[str, Any]]:
    """The campaigns of a plan file. Raises ValidationError where it is none."""
    return [each.model_dump() for each in PlanFile.model_validate_json(text_of(path.read_bytes())).campaigns]


class Entry(BaseModel):
    """One hole: cases by label, and from where to where payload and speed should lie."""

    model_config = ConfigDict(extra="forbid")
    counts: dict[str, int]
    payload_kg_m2: tuple[float, float] | None = None
    speed_rad_s: tuple[float, float] | None = None


class PlanFile(BaseModel):
    """What `cases review --plan` writes."""

    campaigns: list[Entry]


def with_progress(frame: Frame, library: CaseLibrary, campaign: Campaign, processes: int) -> Outcome:
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

        return generate(library, campaign, processes=processes, batch=f"seed {campaign.seed}", advance=advance)
