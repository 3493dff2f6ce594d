"""What an effect is: how it changes the joint, its size, and what the data sheet omits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.hidden_effects.generator.joint import Joint
from benchmarks.hidden_effects.generator.motion import Motion
from benchmarks.hidden_effects.generator.plant import Plant

AS_NEW = 14.0
"""Full size of an effect that an as-new joint has a little of, in as-new sizes: a quarter is 3.5 times as new."""

Size = Callable[[float], dict[str, float]]


def _same_joint(joint: Joint) -> Joint:
    return joint


def _same_plant(plant: Plant, amplitude: float) -> Plant:
    return plant


def no_size(amplitude: float) -> dict[str, float]:
    return {}


@dataclass(frozen=True)
class Effect:
    """One hidden effect of a drawn place and shape; only its amplitude is still free.

    `scored_location` is None where no data could tell the place.  `guess`, `floor` (of the full size), `cap`:
    amplitudes.  `without` is the plant that lacks the effect altogether.  `forget` takes the term out of the
    data sheet.  `spared` names data-sheet terms that may not absorb the effect when its strength is measured.
    `where` is the channel it enters by.
    """

    mechanism: str
    location: str | None
    guess: float
    floor: float = 0.0
    cap: float = np.inf
    scored_location: str | None = None
    where: str = "plant"
    act: Callable[[Plant, float], Plant] = _same_plant
    without: Callable[[Plant], Plant] = lambda plant: plant
    size: Size = no_size
    forget: Callable[[Joint], Joint] = _same_joint
    prepare: Callable[[Joint], Joint] = _same_joint
    spared: tuple[str, ...] = ()
    drift_start: float = 0.0
    strength_share: float = 1.0
    detail: tuple[float, ...] = ()


@dataclass(frozen=True)
class Draw:
    """What an effect may depend on."""

    rng: np.random.Generator
    joint: Joint
    motion: Motion
    load_encoder: bool
    telemetry: bool = True
    sound: bool = True

    def place(self) -> str:
        """Draw one of the stages."""
        return str(self.rng.choice([stage.name for stage in self.joint.stages]))

    def recording(self) -> str:
        """Draw one of torque and sound, whichever is recorded."""
        return str(self.rng.choice([*["torque"] * self.telemetry, *["sound"] * self.sound]))
