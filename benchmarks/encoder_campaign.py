"""`python -m benchmarks.encoder_campaign`: false alarms of two encoders, and what is found."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from benchmarks.encoder_logs import STEP, Array, axis, log, strokes
from signals.telemetry import Telemetry
from sim.investigation.investigate import investigate

SEEDS = 50
COARSE = 2.0 * np.pi / 2500
WANDERS = 2e-6  # of a step of the random walk, per row [rad]


def motions() -> dict[str, Array]:
    """Angles of the output by what is special about them."""
    speeds = strokes([0.5, 1.0, 2.0])
    parts = np.array_split(speeds, 3)
    return {
        "three speeds": speeds,
        "one speed": strokes([1.0, 1.0]),
        "part of a turn": strokes([0.5, 1.0, 0.3], 1.0),
        "short strokes": strokes([0.2, 0.4] * 4, 0.3),
        "with rests": np.concatenate([np.concatenate([part, np.full(400, part[-1])]) for part in parts]),
    }


def wandering(record: Telemetry, seed: int, step: float) -> Telemetry:
    """The same with a random walk on the load's encoder."""
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(record.rows)) * WANDERS
    load = np.round((record["load_position_rad"] + walk) / step) * step
    return replace(record, channels={**record.channels, "load_position_rad": load})


def main() -> None:
    for name, driven in motions().items():
        for step in (STEP, COARSE):
            plain = [log(driven, seed=seed, step=step) for seed in range(SEEDS)]
            walks = [wandering(log(driven, seed=seed), 999 + seed, step) for seed in range(SEEDS)]
            false = [sum(investigate(axis(), t).verdict != "nothing_missing" for t in some) for some in (plain, walks)]
            print(f"{name}, step {step:.2g} rad: {false[0]} false alarms of {SEEDS}, {false[1]} where it wanders")
    found: Counter[str] = Counter()
    held: Counter[str] = Counter()
    true = {"backlash": 3e-4, "eccentricity": 4e-4}
    for seed in range(SEEDS):
        record = log(motions()["three speeds"], 3e-4, 4e-4, seed=seed, noise=2e-4, step=COARSE)
        for finding in investigate(axis(), record).findings:
            found[finding.mechanism] += 1
            size = finding.parameters[0]
            held[finding.mechanism] += size.low <= true[finding.mechanism] <= size.high
    print(f"of {SEEDS} with a gap of 0.3 mrad and runout of 0.4 mrad: found {dict(found)}, within {dict(held)}")


if __name__ == "__main__":
    main()
