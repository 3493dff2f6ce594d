"""Libraries that the recordings from the field are held against, each made once: measured, starter, and both."""

import csv
import json
import shutil
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from app.commands.generate import PER_LABEL
from app.simulated.generation import Campaign, generate
from benchmarks.harness.live import gearcase
from casebase.axes import add_axis
from casebase.library import CaseLibrary
from sim.experiment.design_of_experiments import LABELS
from sim.experiment.paper_axis import PAPER_AXIS
from tests.shared_data import shared

HELD_OUT = "g04"
"""The gearbox that no library has; its recordings are what is disturbed."""


@dataclass(frozen=True)
class Library:
    """A data folder, asked through the command line."""

    name: str
    data_dir: Path

    def diagnosed(self, *files: Path, words: tuple[str, ...] = ()) -> list[dict[str, Any]]:
        """Return one entry per file."""
        done = gearcase("diagnose", *files, *words, "--json", data_dir=self.data_dir)
        entries: list[dict[str, Any]] = json.loads(done.stdout)
        assert len(entries) == len(files), done.stderr
        return entries

    def asked(self, file: Path, *words: str) -> dict[str, Any]:
        """Return the diagnosis of a file that can be read."""
        (entry,) = self.diagnosed(file, words=words)
        assert "error" not in entry, entry
        return entry

    def evaluation(self) -> dict[str, Any]:
        """Return its own cross-validation."""
        found: dict[str, Any] = json.loads(gearcase("evaluate", "--json", data_dir=self.data_dir).stdout)
        return found

    def copied(self, to: Path) -> "Library":
        """Return a copy of it that may be changed."""
        return Library(self.name, Path(shutil.copytree(self.data_dir, to / "copy")))


@lru_cache
def known(library: Library, file: Path) -> dict[str, Any]:
    """Return the diagnosis of a file that many tests hold others against; it is asked once."""
    return library.asked(file)


def recordings(*, held_out: bool) -> list[dict[str, str]]:
    """Return the rows of the manifest: of the gearbox that no library has, or of all others."""
    with shared("data", "axis_recordings", "manifest.csv").open(encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if (row["gearbox"] == HELD_OUT) == held_out]


def add_measured(data_dir: Path) -> None:
    """Add the 24 recordings of the gearboxes g00 to g03, as a technician would."""
    folder = shared("data", "axis_recordings")
    for row in recordings(held_out=False):
        words = ("--label", row["label"], "--gearbox", row["gearbox"], "--axis", folder / "axis.toml")
        taken = ("--speed", row["speed_rad_s"], "--payload", row["payload_kg_m2"])
        done = gearcase("cases", "add", folder / row["file"], *words, *taken, data_dir=data_dir)
        assert done.code == 0, done.stdout


def add_starter(data_dir: Path) -> None:
    """Add what `gearcase starter` adds, without its demonstration."""
    library = CaseLibrary.open(data_dir)
    with library.transaction("starter") as session:
        add_axis(session, PAPER_AXIS.name, PAPER_AXIS.to_mapping())
    campaign = Campaign(PAPER_AXIS, dict.fromkeys(LABELS, PER_LABEL), motion="any")
    generate(library, campaign, processes=2, batch=f"seed {campaign.seed}", advance=lambda _: None)
    library.close()
