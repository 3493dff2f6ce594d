"""Which tuned numbers of the investigation decide anything, in real drives and in the bank of hidden effects.

python -m tests.tuned_numbers [WORDS]           real drives, those whose name has all of the words
python -m tests.tuned_numbers --seed N --every K    each K-th recording of a bank

What is counted is added to out/tuned_numbers/uses.jsonl, one line a recording; `--table` prints the sum.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from app.sound import read_sound
from casebase.signals.errors import TelemetryError
from casebase.signals.telemetry import read_telemetry
from docs.numbers import ROOT, numbers, table
from sim.description.axis_document import read_axis
from sim.discrepancy.data.validation import InvestigationError
from sim.discrepancy.investigation import investigate
from sim.discrepancy.results import Investigation
from sim.errors import SimulationError
from tests.hidden_effects.bank import BANK_SEED, full_bank
from tests.hidden_effects.generator import Scenario, write
from tests.real_drives.drives import Drive, drives
from tests.tuned_numbers.deciding import Ledger, deciding

KEPT = ROOT / "out" / "tuned_numbers" / "uses.jsonl"


def tuned() -> Iterator[tuple[str, str]]:
    """Module and name of each tuned number of the investigation that no compiled code has."""
    _, origins = table()
    for entry in numbers():
        compiled = "numba" in (ROOT / entry.module).read_text(encoding="utf-8")
        is_tuned = origins[entry.module, entry.names].kind == "tuned"
        if is_tuned and entry.module.startswith("sim/discrepancy/") and not compiled:
            for name in entry.names.split(", "):
                yield entry.module.removesuffix(".py").replace("/", "."), name


def install(ledger: Ledger) -> None:
    """Let every tuned number, wherever it was imported, note what it decides."""
    made: dict[tuple[str, str], tuple[Any, Any]] = {}
    for module, name in tuned():
        value = getattr(importlib.import_module(module), name, None)
        changed = deciding(f"{module}.{name}", value, ledger)
        if changed is not value:
            made[module, name] = value, changed
    for module, name in made:
        value, changed = made[module, name]
        for other in list(sys.modules.values()):
            ours = isinstance(other, ModuleType) and other.__name__.startswith("sim.")
            if ours and getattr(other, name, None) is value:
                setattr(other, name, changed)


def _real(words: list[str]) -> Iterator[tuple[str, Callable[[], Investigation]]]:
    for drive in drives():
        if all(word in drive.name for word in words):
            yield drive.name, partial(_of_drive, drive)


def _of_drive(drive: Drive) -> Investigation:
    return investigate(drive.description(), drive.telemetry())


def _simulated(seed: int, every: int) -> Iterator[tuple[str, Callable[[], Investigation]]]:
    for entry in full_bank(seed)[::every]:
        scenario = entry.scenario()
        if scenario.second_telemetry is None:
            yield f"seed {entry.seed}", partial(_of_scenario, scenario)


def _of_scenario(scenario: Scenario) -> Investigation:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(scenario, folder)
        there = {file.name: file for file in folder.iterdir()}
        telemetry = read_telemetry(there["telemetry.csv"]) if "telemetry.csv" in there else None
        sound, as_new = ([read_sound(there[file])] if file in there else [] for file in ("sound.wav", "as_new.wav"))
        return investigate(read_axis(there["axis.toml"]), telemetry, sound, as_new=as_new)


def _print_table() -> None:
    recordings = [json.loads(line) for line in KEPT.read_text().splitlines()]
    compared: Counter[str] = Counter()
    decided: Counter[str] = Counter()
    for uses in (recording["uses"] for recording in recordings):
        compared.update({name: 1 for name, (times, _, _) in uses.items() if times})
        decided.update({name: 1 for name, (_, times, _) in uses.items() if times})
    print(f"| number | compared in | decides in | of {len(recordings)} recordings |\n| --- | --- | --- | --- |")
    names = {name for recording in recordings for name in recording["uses"]}
    for name in sorted(names, key=lambda name: (decided[name], compared[name], name)):
        print(f"| {name} | {compared[name]} | {decided[name]} | |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--every", type=int, help="instead of real drives each K-th recording of the bank")
    parser.add_argument("--seed", type=int, default=BANK_SEED)
    parser.add_argument("--table", action="store_true", help="print what was counted so far")
    chosen = parser.parse_args()
    if chosen.table:
        _print_table()
        return
    ledger = Ledger()
    install(ledger)
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    for name, asked in _simulated(chosen.seed, chosen.every) if chosen.every else _real(chosen.words):
        ledger.uses.clear()
        try:
            said = [f"{f.mechanism} {f.probability:.2f}" for f in asked().findings]
        except (InvestigationError, TelemetryError, SimulationError) as refused:
            said = [str(refused)]
        uses = {number: (use.compared, use.decided, use.scaled) for number, use in ledger.uses.items()}
        with KEPT.open("a") as kept:
            kept.write(json.dumps({"recording": name, "uses": uses}) + "\n")
        print(name, "; ".join(said) or "nothing", flush=True)


if __name__ == "__main__":
    main()
