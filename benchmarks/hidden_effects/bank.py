"""The plan of scenarios of the full bank.

Seeds below 100,000 are for calibrating the product, those of the banks lie above a million: disjoint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.hidden_effects.generator import Recipe, Scenario, draw_recipe, generate
from benchmarks.hidden_effects.generator.effects import PLANT_EFFECTS, SENSOR_EFFECTS, SOUND_EFFECTS, UNNAMED_EFFECTS
from benchmarks.hidden_effects.generator.recipe import COMPARED, CONFOUNDED, HEARD, PAIRS, RECORDED_TWICE

BANK_SEED = 1_000_000
SEEDS_EACH = 10


@dataclass(frozen=True)
class Entry:
    """One scenario of a bank: what to hide, and the first of the seeds to try; some joints cannot show an effect."""

    seed: int
    group: str
    effects: tuple[str, ...]
    level: str

    def scenario(self, seconds: float = 30.0) -> Scenario:
        """Generate it, from the first of its seeds that can show the effect."""
        last: ValueError | None = None
        for seed in range(self.seed, self.seed + SEEDS_EACH):
            try:
                return generate(seed, self.recipe(seed), seconds=seconds)
            except ValueError as error:
                last = error
        raise ValueError(f"none of {SEEDS_EACH} joints can show {self}") from last

    def recipe(self, seed: int) -> Recipe:
        return draw_recipe(seed, self.group, self.effects, self.level)


def _plan() -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield group, effects and level of every scenario of the full bank."""
    often = ["strong"] + ["full"] * 4 + ["half"] * 2 + ["third"] * 3 + ["quarter"] * 2
    for function in PLANT_EFFECTS + SOUND_EFFECTS:
        yield from (("mechanics", (function.__name__,), level) for level in often)
    for function in SENSOR_EFFECTS:
        levels = ("full", "full", "third", "third", "quarter")
        yield from (("sensor", (function.__name__,), level) for level in levels)
    for function in UNNAMED_EFFECTS:
        levels = ("strong", "strong", "full", "full", "full", "half")
        yield from (("unnamed", (function.__name__,), level) for level in levels)
    for pair in PAIRS:
        yield from (("two", pair, level) for level in ("strong", "full", "third"))
    for name in CONFOUNDED:
        yield from (("confounded", (name,), level) for level in ("strong", "full", "full"))
    for name in HEARD:
        yield from (("sound alone", (name,), level) for level in ("strong", "full", "half", "third"))
    for group, count in (("null", 90), ("wrong parameters", 20), ("sound alone null", 10)):
        yield from ((group, (), "full") for _ in range(count))


def _plan_compared() -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield the same of every scenario that has a recording from when the axis was in good order."""
    for name in COMPARED:
        for level in ("strong", "full", "half", "third"):
            yield from (("sound compared", (name,), level) for _ in range(3))
    yield from (("sound compared null", (), "full") for _ in range(12))


def _plan_several() -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield the same of every scenario that has two recordings of telemetry."""
    for name in RECORDED_TWICE:
        for level in ("third", "quarter"):
            yield from (("several", (name,), level) for _ in range(2))
    yield from (("several null", (), "full") for _ in range(12))


def full_bank(first_seed: int = BANK_SEED) -> tuple[Entry, ...]:
    """Return the full bank, in an order in which every beginning holds a fair share.

    Compared sounds come behind all others, and several recordings behind those.
    """
    rng = np.random.default_rng(5)
    plan: list[tuple[str, tuple[str, ...], str]] = []
    order: list[int] = []
    for part in (list(_plan()), list(_plan_compared()), list(_plan_several())):
        order += [len(plan) + int(place) for place in rng.permutation(len(part))]
        plan += part
    return tuple(Entry(first_seed + SEEDS_EACH * place, *plan[place]) for place in order)
