"""One physical specimen of an axis: what differs between two gearboxes of the same data sheet.

A data sheet gives inertias, stiffness and as-new limits. A specimen has friction, damping and clearances of its own
and, in every mesh, transmission errors over the angles of both wheels: tooth engagement and its harmonics, run-out
of either wheel, and sidebands where run-out modulates the engagement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim.axis import Axis, MechanismEntry, Stage
from sim.chain_model import Chain, Dent, Line, Link, Shaft
from sim.errors import AxisError, ParameterError, near_match

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

    def chain(self, axis: Axis, payload_kg_m2: float) -> Chain:
        """The specimen as shafts in series, with the axis's own mechanisms.

        Raises AxisError where the axis has no gear or a stage without stiffness.
        """
        if not axis.stages:
            raise AxisError("stages: sound is made by gears, and this axis has none")
        random = np.random.default_rng(self.seed)
        stiffness, damping = axis.stiffness(), axis.damping()
        links = []
        for index, stage in enumerate(axis.stages):
            c, d = stiffness[index], damping[index]
            if c is None:
                raise AxisError(f"stages[{index}].stiffness_n_m_per_rad: missing; a rigid mesh makes no sound")
            links.append(
                Link(
                    ratio=stage.ratio,
                    stiffness_n_m_per_rad=c,
                    damping_n_m_s_per_rad=(d if d is not None else _default_damping(axis, index, c)) * self.damping,
                    gap_rad=stage.backlash_rad * random.uniform(*AS_NEW),
                    efficiency=(stage.mesh_efficiency, stage.mesh_efficiency),
                    errors=_errors(stage, index, self.error, random),
                )
            )
        chain = Chain(_shafts(axis, payload_kg_m2, self.friction), tuple(links))
        for entry in axis.mechanisms:
            chain = with_fault(chain, axis, entry)
        return chain


def with_fault(chain: Chain, axis: Axis, entry: MechanismEntry) -> Chain:
    """The chain with a mechanism of the contract that sits in a mesh: backlash or tooth damage.

    Raises ParameterError where the mechanism or its place is none of these.
    """
    names = [stage.name for stage in axis.stages]
    where = entry.location or names[-1]
    if where not in names:
        raise ParameterError(f"location: {where!r} has no mesh{near_match(where, names)}")
    index = names.index(where)
    if entry.name not in _FAULTS:
        raise ParameterError(f"mechanism: {entry.name!r} cannot be generated{near_match(entry.name, _FAULTS)}")
    links = list(chain.links)
    links[index] = _FAULTS[entry.name](links[index], index, axis.stages[index], entry.parameters)
    return replace(chain, links=tuple(links))


def _backlash(link: Link, _index: int, _stage: Stage, parameters: Mapping[str, float]) -> Link:
    return replace(link, gap_rad=parameters["gap_rad"])


def _tooth_damage(link: Link, index: int, stage: Stage, parameters: Mapping[str, float]) -> Link:
    _, driven = _teeth(stage)
    dent = Dent(
        shaft=index + 1,
        angle_rad=parameters["angle_rad"],
        half_width_rad=2 * math.pi / driven,
        depth_rad=parameters["depth_rad"],
        flank=int(parameters.get("flank", 1)),
    )
    return replace(link, dents=(*link.dents, dent))


_FAULTS = {"backlash": _backlash, "tooth_damage": _tooth_damage}


def _shafts(axis: Axis, payload_kg_m2: float, friction: float) -> tuple[Shaft, ...]:
    motor, load = axis.motor, axis.load
    first = Shaft(
        motor.inertia_kg_m2, motor.coulomb_friction_n_m * friction, motor.viscous_friction_n_m_s_per_rad * friction
    )
    between = [Shaft(stage.inertia_kg_m2) for stage in axis.stages[:-1]]
    last = Shaft(
        axis.stages[-1].inertia_kg_m2 + payload_kg_m2,
        load.coulomb_friction_n_m * friction,
        load.viscous_friction_n_m_s_per_rad * friction,
    )
    return (first, *between, last)


def _teeth(stage: Stage) -> tuple[int, int]:
    if stage.driver_teeth is not None and stage.driven_teeth is not None:
        return stage.driver_teeth, stage.driven_teeth
    driver, least = TEETH_UNKNOWN
    return driver, max(least, round(driver * stage.ratio))


def _errors(stage: Stage, index: int, scale: float, random: np.random.Generator) -> tuple[Line, ...]:
    """Transmission errors of a mesh between shafts `index` and `index + 1`, in rad at the driven gear."""
    amplitude = stage.transmission_error_rad * scale
    driver, driven = _teeth(stage)

    def line(shaft: int, order: float, level: float) -> Line:
        return Line(shaft, order, amplitude * level, float(random.uniform(0, 2 * math.pi)))

    lines = [
        line(index + 1, k * driven, level * (1.0 if k == 1 else random.uniform(0.5, 1.5)))
        for k, level in enumerate(HARMONIC_LEVELS, 1)
    ]
    for shaft, teeth in ((index, driver), (index + 1, driven)):
        lines.append(line(shaft, 1, random.uniform(*RUN_OUT)))
        lines.extend(line(shaft, teeth + side, random.uniform(*SIDEBAND)) for side in (-1, 1))
    return tuple(lines)


def _default_damping(axis: Axis, index: int, stiffness: float) -> float:
    """3 % of critical damping against the load, as steel gear trains have [N m s/rad]."""
    inertia = axis.load.inertia_kg_m2 / axis.ratio_from(axis.stages[index].name) ** 2
    return 2 * 0.03 * math.sqrt(stiffness * inertia)
