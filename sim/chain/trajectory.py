"""From the numbers of a chain to a `Trajectory` with the names of the train's components.

Signs: a chain counts the torque on the driven shaft, Modelica the torque into the component; a mesh's `tau` and
`mode` are those of Modelica, so flank 1 (driver pushes forward) has tau < 0 and mode -1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from sim.chain.components import Gravity, ServoDrive, TorqueRipple, TorqueWave
from sim.chain.model import Array, Chain, ChainResult
from sim.chain.reduction import Section
from sim.rotational.component import CONTACT_NAMES, SLIDING_NAMES
from sim.rotational.components import Torque as TorqueSource
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import Channels, Event, Trajectory

CONTACT, STICK = 0, 1  # kinds in the engine's log


def trajectory_of(
    train: DriveTrain, sections: list[Section], chain: Chain, result: ChainResult, reference: Array | None
) -> Trajectory:
    sources: dict[str, Callable[[], Array]] = {}
    units: dict[str, str] = {}
    for name, unit, source in _sources(train, sections, chain, result):
        sources[name], units[name] = source, unit
    for name in sections[0].torques:
        if isinstance(train[name], ServoDrive | TorqueSource):
            sources[f"{name}.tau"], units[f"{name}.tau"] = partial(np.asarray, result.motor_torque_n_m), "N.m"
            if reference is not None:
                sources[f"{name}.reference"], units[f"{name}.reference"] = partial(np.asarray, reference), "rad"
    events = tuple(_events(sections, result))
    return Trajectory(result.time_s, Channels(sources), units, events, "chain", result.residual)


def _sources(
    train: DriveTrain, sections: list[Section], chain: Chain, result: ChainResult
) -> Iterator[tuple[str, str, Callable[[], Array]]]:
    angle, speed, acceleration = result.angle_rad, result.speed_rad_s, result.acceleration_rad_s2
    for k, section in enumerate(sections):
        for name in section.inertias:
            yield f"{name}.phi", "rad", partial(_column, angle, k)
            yield f"{name}.w", "rad/s", partial(_column, speed, k)
            yield f"{name}.a", "rad/s2", partial(_column, acceleration, k)
        for name in section.torques:
            part = train[name]
            if isinstance(part, TorqueRipple | Gravity):
                yield f"{name}.tau", "N.m", partial(_position_torque, part, angle[:, k])
            if isinstance(part, TorqueWave):
                yield f"{name}.tau", "N.m", partial(_torque_over_time, part, result.time_s)
        if section.gear:
            yield f"{section.gear}.w_a", "rad/s", partial(_column, speed, k)
        if section.mesh:
            ratio = chain.links[k].ratio
            yield f"{section.mesh}.tau", "N.m", partial(np.negative, result.force_n_m[:, k])
            yield f"{section.mesh}.phi_rel", "rad", partial(_relative, angle, k, ratio)
            yield f"{section.mesh}.w_rel", "rad/s", partial(_relative, speed, k, ratio)


def _column(values: Array, k: int) -> Array:
    return values[:, k]


def _relative(values: Array, k: int, ratio: float) -> Array:
    return np.asarray(values[:, k + 1] - values[:, k] / ratio)


def _position_torque(part: TorqueRipple | Gravity, angle: Array) -> Array:
    if isinstance(part, Gravity):
        return np.asarray(-part.torque * np.sin(angle + part.phase))
    return np.asarray(sum(line.amplitude * np.sin(line.order * angle + line.phase) for line in part.lines))


def _torque_over_time(part: TorqueWave, time_s: Array) -> Array:
    return np.asarray(part.torque * np.sin(2.0 * np.pi * part.frequency * time_s + part.phase))


def _events(sections: list[Section], result: ChainResult) -> list[Event]:
    """Contact and sliding as Modelica numbers them; what a component passes through in no time is left out."""
    meshes = [section.mesh or "" for section in sections]
    sliding = [next(iter(section.frictions), None) or section.gear or section.inertias[0] for section in sections]
    log = result.log[result.log[:, 1] <= STICK]
    contact = log[:, 1] == CONTACT
    modes = np.where(contact[:, None], -np.sign(log[:, 3:]), log[:, 3:]).astype(np.int64)  # pieces of a contact are one
    wanted = modes[:, 0] != modes[:, 1]
    kept: dict[str, list[Event]] = {}
    for (time, kind, index), (before, after) in zip(log[wanted, :3].tolist(), modes[wanted].tolist(), strict=True):
        component, names = (sliding, SLIDING_NAMES) if kind == STICK else (meshes, CONTACT_NAMES)
        events = kept.setdefault(component[int(index)], [])
        if events and events[-1].time_s == time:
            before = events.pop().from_mode
        if before != after:
            events.append(Event(time, component[int(index)], before, after, names[before], names[after]))
    return sorted((event for events in kept.values() for event in events), key=lambda event: event.time_s)
