"""From the numbers of engine 2 to a `Trajectory` with the names of the train's components.

Signs: a chain counts the torque on the driven shaft, Modelica the torque into the component; a mesh's `tau` and
`mode` are those of Modelica, so flank 1 (driver pushes forward) has tau < 0 and mode -1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from sim.chain.components import Gravity, ServoDrive, TorqueRipple, TorqueWave
from sim.chain.model import Array, Chain, ChainResult
from sim.chain.topology import Place
from sim.rotational.component import CONTACT_NAMES, SLIDING_NAMES
from sim.rotational.components import Torque as TorqueSource
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import Channels, Event, Trajectory

CONTACT, STICK = 0, 1  # kinds in the engine's log


def trajectory_of(
    train: DriveTrain, places: list[Place], chain: Chain, result: ChainResult, reference: Array | None
) -> Trajectory:
    sources: dict[str, Callable[[], Array]] = {}
    units: dict[str, str] = {}
    for name, unit, source in _sources(train, places, chain, result):
        sources[name], units[name] = source, unit
    for name in places[0].torques:
        if isinstance(train[name], ServoDrive | TorqueSource):
            sources[f"{name}.tau"], units[f"{name}.tau"] = partial(np.asarray, result.motor_torque_n_m), "N.m"
            if reference is not None:
                sources[f"{name}.reference"], units[f"{name}.reference"] = partial(np.asarray, reference), "rad"
    events = tuple(_events(places, result))
    return Trajectory(result.time_s, Channels(sources), units, events, "chain", result.residual)


def _sources(
    train: DriveTrain, places: list[Place], chain: Chain, result: ChainResult
) -> Iterator[tuple[str, str, Callable[[], Array]]]:
    angle, speed, acceleration = result.angle_rad, result.speed_rad_s, result.acceleration_rad_s2
    for k, place in enumerate(places):
        for name in place.inertias:
            yield f"{name}.phi", "rad", partial(_column, angle, k)
            yield f"{name}.w", "rad/s", partial(_column, speed, k)
            yield f"{name}.a", "rad/s2", partial(_column, acceleration, k)
        for name in place.torques:
            part = train[name]
            if isinstance(part, TorqueRipple | Gravity):
                yield f"{name}.tau", "N.m", partial(_position_torque, part, angle[:, k])
            if isinstance(part, TorqueWave):
                yield f"{name}.tau", "N.m", partial(_torque_over_time, part, result.time_s)
        if place.gear:
            yield f"{place.gear}.w_a", "rad/s", partial(_column, speed, k)
        if place.mesh:
            ratio = chain.links[k].ratio
            yield f"{place.mesh}.tau", "N.m", partial(np.negative, result.force_n_m[:, k])
            yield f"{place.mesh}.phi_rel", "rad", partial(_relative, angle, k, ratio)
            yield f"{place.mesh}.w_rel", "rad/s", partial(_relative, speed, k, ratio)


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


def _events(places: list[Place], result: ChainResult) -> Iterator[Event]:
    """Contact and sliding as Modelica numbers them; what a component passes through in no time is left out."""
    kept: list[tuple[float, str, int, int, Mapping[int, str]] | None] = []
    latest: dict[str, int] = {}
    for time, component, before, after, names in _all_events(places, result):
        position = latest.get(component)
        last = None if position is None else kept[position]
        if position is not None and last is not None and last[0] == time:
            kept[position] = None
            before = last[2]
        if before != after:
            latest[component] = len(kept)
            kept.append((time, component, before, after, names))
    for one in kept:
        if one is not None:
            time, component, before, after, names = one
            yield Event(time, component, before, after, names[before], names[after])


def _all_events(places: list[Place], result: ChainResult) -> Iterator[tuple[float, str, int, int, Mapping[int, str]]]:
    """Time, component, old and new mode, names of modes; of the modes within a contact only beginning and end count."""
    meshes = [place.mesh or "" for place in places]
    sliding = [place.frictions[0] if place.frictions else place.gear or place.inertias[0] for place in places]
    log = result.log
    contact, stick = log[:, 1] == CONTACT, log[:, 1] == STICK
    modes = np.where(contact[:, None], -np.sign(log[:, 3:5]), log[:, 3:5]).astype(np.int64)
    wanted = stick | (contact & (modes[:, 0] != modes[:, 1]))
    rows = zip(
        log[wanted, 0].tolist(), stick[wanted].tolist(), log[wanted, 2].tolist(), modes[wanted].tolist(), strict=True
    )
    for time, slides, index, (before, after) in rows:
        if slides:
            yield time, sliding[int(index)], before, after, SLIDING_NAMES
        else:
            yield time, meshes[int(index)], before, after, CONTACT_NAMES
