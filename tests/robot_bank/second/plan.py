"""Which cases the second bank consists of: of 150 a hundred hide something, fifty nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.robot_bank.plan import Drawn, drawn
from tests.robot_bank.second.cases import Scenario, generate, write

SHARES = {
    "null": 50,
    "payload": 15,
    "coulomb_friction": 9,
    "viscous_friction": 9,
    "stribeck_friction": 10,
    "friction_asymmetry": 10,
    "friction_drift": 9,
    "gravity_imbalance": 10,
    "torque_ripple": 11,
    "torque_offset": 9,
    "time_delay": 5,
    "backlash": 3,
}
"""Cases of a kind among 150."""


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


def plan(count: int, seed: int, kinds: tuple[str, ...] = ()) -> list[Entry]:
    """Return the first `count` cases of a bank, of these kinds."""
    return [Entry(*one) for one in drawn(SHARES, count, seed, kinds)]
