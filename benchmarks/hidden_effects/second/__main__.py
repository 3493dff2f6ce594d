"""Write the scenarios of a seed: `python -m benchmarks.hidden_effects.second OUT --seed 1`.

Each has a folder of its own with axis.toml, telemetry.csv and sound.wav; answers.json holds what they hide.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden_effects.second.plan import PLAN
from benchmarks.hidden_effects.second.scenario import generate, write


def _line(answer: Mapping[str, Any]) -> str:
    """Return one scenario as a line."""
    hidden = "+".join(f"{name} ({place})" if place else name for name, place in answer["answer"]) or "nothing"
    strength = f"{answer['strength']:.3g} in {answer['strength_channel']}" if answer["answer"] else ""
    return f"{answer['id']} {hidden:40s} {answer['level']:8s} {answer['motion']:10s} {answer['noise']:6s} {strength}"


def main() -> None:
    """Write all scenarios of the plan, in an order that the seed draws."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden_effects.second", description=__doc__)
    parser.add_argument("out", type=Path, help="folder that is written")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    answers: list[dict[str, Any]] = []
    for place, number in enumerate(np.random.default_rng((options.seed, 77)).permutation(len(PLAN)), start=1):
        scenario = generate(options.seed, int(number))
        answers.append({"id": f"s{place:02d}", **scenario.answer})
        write(scenario, options.out / answers[-1]["id"])
        (options.out / "answers.json").write_text(json.dumps(answers, indent=1))
        print(_line(answers[-1]), flush=True)


if __name__ == "__main__":
    main()
