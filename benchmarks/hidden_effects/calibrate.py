"""Fit how probable a name is, on seeds kept for calibration: `python -m benchmarks.hidden_effects.calibrate`.

Prints the line for sim/investigation/assessment/calibration.py; a probability is that of the name, not of its place.
Telemetry only; unlike the banks this looks inside the product, at the evidence of each finding. Results are kept line
by line, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.hidden_effects.bank import SEEDS_EACH, Entry
from benchmarks.hidden_effects.generator import write
from benchmarks.hidden_effects.generator.effects import PLANT_EFFECTS, SENSOR_EFFECTS, SOUND_EFFECTS, UNNAMED_EFFECTS
from benchmarks.hidden_effects.generator.recipe import PAIRS
from benchmarks.hidden_effects.product import ROOT
from benchmarks.hidden_effects.scoring import names_rightly
from signals.telemetry import read_telemetry
from sim.description.axis_document import read_axis
from sim.investigation.assessment.calibration import Weights
from sim.investigation.assessment.posterior import Evidence, probability
from sim.investigation.investigate import investigate
from sim.investigation.results import Finding

FIRST_SEED = 1_000
PRIOR = np.array([2.0, 1.0, 2.0, math.log(1.5)])  # bias, slope, left, logarithm of the overdispersion
SPREAD = np.array([1.0, 0.5, 0.3, 0.4])  # few scenarios say what a name loses by what it leaves
Claim = tuple[Evidence, bool]


def plan() -> Iterator[Entry]:
    """Every effect at full and a third, what has no name, pairs, and nothing."""
    what: list[tuple[str, tuple[str, ...], str]] = [
        ("mechanics", (f.__name__,), level) for f in PLANT_EFFECTS + SOUND_EFFECTS for level in ("full", "third")
    ]
    what += [("sensor", (f.__name__,), "full") for f in SENSOR_EFFECTS]
    what += [("unnamed", (f.__name__,), "full") for f in UNNAMED_EFFECTS]
    what += [("two", pair, "full") for pair in PAIRS[:5]]
    what += [("null", (), "full")] * 18 + [("wrong parameters", (), "full")] * 5
    for place, one in enumerate(what):
        yield Entry(FIRST_SEED + SEEDS_EACH * place, *one)


def claims_of(entry: Entry) -> list[dict[str, Any]]:
    """Investigate one scenario; evidence of each name and whether it is right."""
    scenario = entry.scenario()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(scenario, folder)
        if scenario.telemetry is None:
            return []
        said = investigate(read_axis(folder / "axis.toml"), read_telemetry(folder / "telemetry.csv")).findings
    answer = scenario.answer()
    return [{**asdict(f.evidence), "right": names_rightly(answer, _as_json(f))} for f in said if f.evidence]


def _as_json(f: Finding) -> dict[str, Any]:
    return {"mechanism": f.mechanism, "indistinguishable_from": list(f.indistinguishable_from)}


def fitted(claims: Sequence[Claim]) -> Weights:
    """Weights of largest posterior under the priors above, and the cap by Laplace's rule of succession."""

    def loss(x: np.ndarray) -> float:
        weights = _weights(x)
        said = np.array([probability(evidence, weights) for evidence, _ in claims])
        right = np.array([right for _, right in claims])
        return float(-np.log(np.where(right, said, 1.0 - said)).sum() + 0.5 * np.sum(((x - PRIOR) / SPREAD) ** 2))

    best = _weights(minimize(loss, PRIOR, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-4}).x)
    ordered = sorted(claims, key=lambda claim: -probability(claim[0], best))
    founded = ordered[: max(1, len(ordered) // 2)]
    return replace(best, cap=round((sum(right for _, right in founded) + 1) / (len(founded) + 2), 3))


def _weights(x: np.ndarray) -> Weights:
    bias, slope, left = (round(float(v), 2) for v in x[:3])
    return Weights(bias, max(slope, 0.0), max(left, 0.0), round(math.exp(float(x[3])), 2), 0.999)


def main() -> None:
    """Run what is not yet done, then fit."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden_effects.calibrate", description=__doc__)
    parser.add_argument("--runs", type=int, help="only the first N")
    parser.add_argument("--kept", type=Path, default=ROOT / "out" / "hidden_effects" / "calibration.jsonl")
    options = parser.parse_args()
    options.kept.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in options.kept.read_text().splitlines()] if options.kept.exists() else []
    seeds = {result["seed"] for result in done}
    for entry in list(plan())[: options.runs]:
        if entry.seed not in seeds:
            done.append({"seed": entry.seed, "claims": claims_of(entry)})
            with options.kept.open("a") as file:
                file.write(json.dumps(done[-1]) + "\n")
    found = [c for result in done for c in result["claims"]]
    claims = [(Evidence(c["share"], tuple(c["rivals"]), c["left"]), bool(c["right"])) for c in found]
    print(f"# {len(claims)} names in {len(done)} investigations, {sum(right for _, right in claims)} of them right")
    print(f"WEIGHTS = {fitted(claims)}")


if __name__ == "__main__":
    main()
