"""One physical specimen of an axis: what differs between two gearboxes of the same data sheet.

A data sheet gives inertias, stiffness and as-new limits. A specimen has friction, damping and clearances of its own
and, in every mesh, transmission errors over the angles of both wheels: tooth engagement and its harmonics, run-out
of either wheel, and sidebands where run-out modulates the engagement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from sim.assembly import drive_train_of
from sim.chain.components import MeshLine, Wheel
from sim.description.axis import Axis, Load, Motor, Stage
from sim.description.transmission import link_damping
from sim.errors import AxisError
from sim.mechanisms.locations import with_error
from sim.rotational.drive_train import DriveTrain

End = TypeVar("End", Motor, Load)

HARMONIC_LEVELS = (1.0, 0.3, 0.12)  # of tooth engagement; a parabola-like error falls as 1/k^2
RUN_OUT = (0.5, 2.0)  # amplitude of run-out over that of engagement
SIDEBAND = (0.05, 0.3)
AS_NEW = (0.5, 1.0)  # clearance of a good specimen over what the data sheet allows
TEETH_UNKNOWN = (12, 60)  # driver and least driven teeth where only a ratio is given


@dataclass(frozen=True)
class Specimen:
    """Factors on the data sheet's values, and the seed of phases and of all that is drawn per mesh.

    `error` scales transmission errors, `friction` and `damping` theirs.
    """

    seed: int
    error: float = 1.0
    friction: float = 1.0
    damping: float = 1.0

    def built(self, axis: Axis, payload_kg_m2: float) -> Axis:
        """The axis with the values that this specimen has in place of its data sheet's.

        Raises AxisError where the axis has no gear or a stage without stiffness.
        """
        if not axis.stages:
            raise AxisError("stages: sound is made by gears, and this axis has none")
        random = np.random.default_rng([self.seed, 1])
        stages = []
        for index, (stage, c) in enumerate(zip(axis.stages, axis.stiffness(), strict=True)):
            if c is None:
                raise AxisError(f"stages[{index}].stiffness_n_m_per_rad: missing; a rigid mesh makes no sound")
            stages.append(
                replace(
                    stage,
                    stiffness_n_m_per_rad=c,
                    damping_n_m_s_per_rad=link_damping(axis, index) * self.damping,
                    backlash_rad=stage.backlash_rad * random.uniform(*AS_NEW),
                )
            )
        return replace(
            axis,
            motor=_rubbing(axis.motor, self.friction),
            load=replace(_rubbing(axis.load, self.friction), inertia_kg_m2=payload_kg_m2),
            stages=tuple(stages),
        )

    def train(self, built: Axis) -> DriveTrain:
        """The drive train of a `built` axis with its mechanisms and this specimen's transmission errors.

        Raises what the mechanisms raise.
        """
        random = np.random.default_rng(self.seed)
        train = drive_train_of(built)
        for stage in built.stages:
            for line in _errors(stage, self.error, random):
                train = with_error(train, stage.name, line.order, line.amplitude, line.phase, wheel=line.wheel)
        return train


def _rubbing(end: End, factor: float) -> End:
    return replace(
        end,
        coulomb_friction_n_m=end.coulomb_friction_n_m * factor,
        viscous_friction_n_m_s_per_rad=end.viscous_friction_n_m_s_per_rad * factor,
    )


def _teeth(stage: Stage) -> tuple[int, int]:
    if stage.driver_teeth is not None and stage.driven_teeth is not None:
        return stage.driver_teeth, stage.driven_teeth
    driver, least = TEETH_UNKNOWN
    return driver, max(least, round(driver * stage.ratio))


def _errors(stage: Stage, scale: float, random: np.random.Generator) -> tuple[MeshLine, ...]:
    """Transmission errors of a mesh, in rad at the driven gear."""
    amplitude = stage.transmission_error_rad * scale
    driver, driven = _teeth(stage)

    def line(wheel: Wheel, order: float, level: float) -> MeshLine:
        return MeshLine(order, amplitude * level, float(random.uniform(0, 2 * math.pi)), wheel)

    lines = [
        line("driven", k * driven, level * (1.0 if k == 1 else random.uniform(0.5, 1.5)))
        for k, level in enumerate(HARMONIC_LEVELS, 1)
    ]
    sides: tuple[tuple[Wheel, int], ...] = (("driver", driver), ("driven", driven))
    for wheel, teeth in sides:
        lines.append(line(wheel, 1, random.uniform(*RUN_OUT)))
        lines.extend(line(wheel, teeth + side, random.uniform(*SIDEBAND)) for side in (-1, 1))
    return tuple(lines)
