"""Is the next motion worth it? Its log against one more log of the old motion, as long, on robots of the bank.

.venv/bin/python -m tests.robot_bank.next_motion --count 10 --seed 1
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy import interpolate

from tests.robot_bank import product
from tests.robot_bank.drive import motor_torque
from tests.robot_bank.log import sample, write_log
from tests.robot_bank.motion import LEAD_S, RATE_HZ, Motion, smooth
from tests.robot_bank.multibody import torques
from tests.robot_bank.scenario import Scenario, generate, write

SECONDS = 15.0


def played(scenario: Scenario, path: Path) -> Motion:
    """Return the motion of a trajectory file, from rest before it to rest after it."""
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    time = np.arange(-LEAD_S, table[-1, 0] + LEAD_S, 1 / RATE_HZ)
    course = interpolate.CubicHermiteSpline(table[:, 0], table[:, 1:7], table[:, 7:13])
    ordered = course(np.clip(time, 0.0, table[-1, 0]))
    angles = np.empty_like(ordered)
    angles[:, list(scenario.recorder.order)] = ordered
    return Motion("next", time, angles, *smooth(time, angles))


def log_of(scenario: Scenario, motion: Motion, seed: int) -> str:
    """Return a log of the robot as it is along a motion, with noise of its own."""
    robot = scenario.robot
    course = motion.angles, motion.speeds, motion.accelerations
    carried = torques(robot.arm.chain, robot.bodies(), *course, robot.gravity)
    runs = [motor_torque(robot.drives[j], motion.time, motion.angles[:, j], carried[:, j]) for j in range(6)]
    torque, angle, speed = (np.column_stack([run[k] for run in runs]) for k in range(3))
    rng = np.random.default_rng([seed, 7])
    none = np.zeros(6)
    recorder, gears = scenario.recorder, scenario.signals.gears
    signals = sample(rng, recorder, motion.time, torque, angle, speed, none, none, gears)
    return write_log(recorder, signals, scenario.written.names)


def widths(document: dict[str, Any]) -> dict[str, float]:
    """Return the widths of intervals by what they are of: friction, payload, and numbers of the description."""
    found = {
        f"{f['location']} {f['mechanism']} {e['name']}": e["high"] - e["low"]
        for f in document["findings"]
        if "friction" in f["mechanism"] or f["mechanism"] == "payload"
        for e in f["parameters"]
    }
    return found | {e["name"]: e["high"] - e["low"] for e in document["parameters"]}


def ratios(seed: int, kind: str, folder: Path) -> tuple[dict[str, float], dict[str, int], float]:
    """Return widths after the next motion over those after the old one again, how many each has, the promised gain."""
    scenario = generate(seed, kind, seconds=SECONDS)
    write(scenario, folder)
    options = ["--robot", "robot.toml", "--channels", "channels.toml", "--json"]
    first = product.run(folder, [*options, "--telemetry", "log.csv", "--trajectory", "next.csv"])
    motions = {"next": played(scenario, folder / "next.csv"), "again": scenario.motion}
    logs = {name: log_of(scenario, motion, seed) for name, motion in motions.items()}
    found = {}
    for name, log in logs.items():
        (folder / f"{name}_log.csv").write_text(log)
        document = product.run(folder, [*options, "--telemetry", "log.csv", "--telemetry", f"{name}_log.csv"])
        found[name] = widths(document)
    both = found["next"].keys() & found["again"].keys()
    counts = {name: len(one) for name, one in found.items()}
    return {key: found["next"][key] / found["again"][key] for key in both}, counts, first["next_motion"]["gain_nat"]


def _mean(values: list[float]) -> str:
    return f"{math.exp(sum(map(math.log, values)) / len(values)):.2f} of {len(values)}" if values else "none"


def main() -> None:
    """Print the ratios of each robot, and their geometric means by kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    every: dict[str, list[float]] = {}
    for seed in range(chosen.seed, chosen.seed + chosen.count):
        kind = ("null", "payload")[seed % 2]
        with tempfile.TemporaryDirectory() as folder:
            try:
                found, counts, gain = ratios(seed, kind, Path(folder))
            except product.FailedError as error:
                print(f"{seed} {kind}: {error}", flush=True)
                continue
        by_kind: dict[str, list[float]] = {}
        for key, ratio in found.items():
            name = "payload" if key.startswith("payload") else "friction" if "friction" in key else "rotors and others"
            by_kind.setdefault(name, []).append(ratio)
        for name, values in by_kind.items():
            every.setdefault(name, []).extend(values)
        shown = ", ".join(f"{name} {_mean(values)}" for name, values in sorted(by_kind.items()))
        print(f"{seed} {kind}: promised {gain:.1f} nat; {shown}; numbers found {counts}", flush=True)
    print("widths of intervals, next over again, geometric mean:")
    for name, values in sorted(every.items()):
        print(f"  {name}: {_mean(values)}")


if __name__ == "__main__":
    main()
