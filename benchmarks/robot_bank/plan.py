"""Which cases a bank consists of: of 150 a hundred hide something, fifty nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robot_bank.effects import LEVELS
from benchmarks.robot_bank.scenario import Scenario, generate, write

SHARES = {
    "null": 50,
    "payload": 13,
    "payload_wrong": 4,
    "coulomb_friction": 8,
    "viscous_friction": 8,
    "friction_raised": 8,
    "stribeck_friction": 9,
    "friction_asymmetry": 8,
    "friction_drift": 6,
    "gravity_imbalance": 9,
    "torque_ripple": 11,
    "torque_offset": 8,
    "time_delay": 5,
    "backlash": 3,
}
"""Cases of a kind among 150."""


@dataclass(frozen=True)
class Drawn:
    """What a case of a bank is drawn as; the seed says all of it."""

    seed: int
    kind: str
    level: str

    @property
    def key(self) -> str:
        """What tells it from all others."""
        return f"{self.seed} {self.kind} {self.level}"


class Entry(Drawn):
    """A case of this bank."""

    def scenario(self) -> Scenario:
        """Generate it. Raises ValueError where no robot of this seed can show the effect at this level."""
        return generate(self.seed, self.kind, self.level)

    def write(self, folder: Path) -> dict[str, Any]:
        """Write its files and return the answer."""
        scenario = self.scenario()
        write(scenario, folder)
        return scenario.answer()


def drawn(shares: Mapping[str, int], count: int, seed: int, kinds: tuple[str, ...] = ()) -> list[tuple[int, str, str]]:
    """Return seed, kind and level of the first `count` cases; every beginning holds a fair share of each kind."""
    once = [kind for kind, share in shares.items() for _ in range(share) if not kinds or kind in kinds]
    rng = np.random.default_rng([seed, 150])
    entries: list[tuple[int, str, str]] = []
    while len(entries) < count:
        for k in rng.permutation(len(once)):
            level = str(rng.choice(list(LEVELS), p=[0.25, 0.5, 0.25]))
            entries.append((seed * 1_000_000 + len(entries), once[k], level))
    return entries[:count]


def plan(count: int, seed: int, kinds: tuple[str, ...] = ()) -> list[Entry]:
    """Return the first `count` cases of a bank, of these kinds."""
    return [Entry(*one) for one in drawn(SHARES, count, seed, kinds)]
