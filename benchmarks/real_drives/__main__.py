"""`python -m benchmarks.real_drives [WORDS] [--parts]`: what is said of real drives beside what is true of
them."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

from benchmarks.real_drives.drives import Drive, cut, drives
from signals.errors import TelemetryError
from sim.errors import SimulationError
from sim.investigation.data.validation import InvestigationError
from sim.investigation.investigate import investigate
from sim.investigation.results import Investigation

LOUD = 0.9
OFF = 0.3  # of a published size


@dataclass
class Tally:
    runs: int = 0
    refused: int = 0
    loud: int = 0
    right: int = 0
    wanted: int = 0
    found: int = 0
    sizes: int = 0
    close: int = 0


def of_truth(drive: Drive, result: Investigation, tally: Tally) -> list[str]:
    """What is wrong with a result, in words; counted."""
    wrong = []
    truth = drive.truth
    loud = [f for f in result.findings if f.probability >= LOUD]
    for f in loud:
        tally.loud += 1
        sizes = {e.name: e for e in f.parameters}
        gap = sizes["gap_rad"].value if "gap_rad" in sizes else 0.0
        good = f.mechanism in truth.wanted | truth.allowed
        if truth.ripple_orders and f.mechanism == "torque_ripple":
            good = truth.ripple_orders[0] <= sizes["order"].value <= truth.ripple_orders[1]
        good = good and not (truth.loosest_gap_rad and gap > truth.loosest_gap_rad)
        tally.right += good
        wrong += [] if good else [f"WRONG {f.mechanism}"]
    said = {m for f in result.findings if f.probability >= 0.5 for m in (f.mechanism, *f.indistinguishable_from)}
    if drive.part == "whole":
        tally.wanted += len(truth.wanted)
        tally.found += len(truth.wanted & said)
        wrong += [f"MISSED {name}" for name in sorted(truth.wanted - said)]
    for mechanism, name, value in truth.sizes:
        found = [e.value for f in result.findings if f.mechanism == mechanism for e in f.parameters if e.name == name]
        if found:
            tally.sizes += 1
            close = abs(max(found) - value) < OFF * abs(value)
            tally.close += close
            wrong += [] if close else [f"OFF {mechanism} {max(found):.3g} for {value:.3g}"]
    return wrong


def line(drive: Drive, tally: Tally) -> str:
    tally.runs += 1
    began = time.monotonic()
    try:
        result = investigate(drive.description(), drive.telemetry())
    except (InvestigationError, TelemetryError, SimulationError) as refused:
        tally.refused += 1
        return f"{drive.name} [{drive.part}]: REFUSED {refused}"
    wrong = of_truth(drive, result, tally)
    said = "; ".join(
        f"{f.mechanism}@{f.location} {f.probability:.2f}"
        f" ({', '.join(f'{e.name} {e.value:.3g} [{e.low:.3g} {e.high:.3g}]' for e in f.parameters)})"
        + (f" or {'/'.join(f.indistinguishable_from)}" if f.indistinguishable_from else "")
        for f in result.findings
    )
    gain = ", ".join(
        f"{g.channel} {g.rms_before:.3g} -> {g.rms_after:.3g} of {g.rms_measured:.3g}" for g in result.gain
    )
    left = "" if result.unexplained is None else f" left: {result.unexplained.kind} {dict(result.unexplained.numbers)}"
    parts = [
        f"{drive.name} [{drive.part}] {time.monotonic() - began:.0f} s: {result.verdict}: {said or 'nothing'}{left}",
        gain,
    ]
    return " | ".join([*parts, ", ".join(wrong)] if wrong else parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*", help="only drives whose name has all of these")
    parser.add_argument("--parts", action="store_true", help="also halves of each record, and every second row")
    parser.add_argument("--not", dest="out", nargs="*", default=[], help="no drive whose name has one of these")
    chosen = parser.parse_args()
    tally = Tally()
    for drive in drives():
        if not all(word in drive.name for word in chosen.words) or any(word in drive.name for word in chosen.out):
            continue
        for one in cut(drive) if chosen.parts else [drive]:
            print(line(one, tally), flush=True)
    print(
        f"{tally.runs} runs, {tally.refused} refused; names with {LOUD}: {tally.right} of {tally.loud} right; wanted "
        f"{tally.found} of {tally.wanted}; sizes within {OFF:.0%}: {tally.close} of {tally.sizes}"
    )


if __name__ == "__main__":
    main()
