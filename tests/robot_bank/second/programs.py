"""Programs as people teach them, in steps of the servos: what the joints are to do, not what they do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy import interpolate, ndimage
from scipy.spatial.transform import Rotation

from tests.robot_bank.multibody import Array
from tests.robot_bank.second.builds import Build
from tests.robot_bank.second.dynamics import STEP_S

LEAD_S = 1.5
"""Servos hold the first pose before the log begins; the program goes on as long after its end."""
RISE_S = 0.35
"""In which a joint comes to its largest speed."""


@dataclass(frozen=True, eq=False)
class Program:
    """Angles and speeds wanted (m, n), a step apart, from LEAD_S before the log to LEAD_S after it."""

    kind: str
    angles: Array
    speeds: Array


@dataclass(frozen=True, eq=False)
class _Maker:
    """What programs are made of: a robot, its rigid model for places of its flange, how much of its speed is used."""

    rng: np.random.Generator
    build: Build
    rigid: mujoco.MjModel
    hurry: float

    def pose(self) -> Array:
        """Draw a pose."""
        return self.build.home + self.build.range * self.rng.uniform(-1, 1, self.build.joints)

    def steps_for(self, course: Callable[[Array], Array], hurry: float) -> int:
        """Return how many steps a course, angles (m, n) by the share of its time, takes within what joints can do."""
        at = course(np.linspace(0, 1, 400))
        fast = np.max(np.abs(np.gradient(at, 1 / 399, axis=0)) / (hurry * self.build.speed))
        rise = np.gradient(np.gradient(at, 1 / 399, axis=0), 1 / 399, axis=0)
        hard = np.max(np.abs(rise) / (self.build.speed / RISE_S))
        return max(int(max(fast, np.sqrt(hard), 0.3) / STEP_S), 2)

    def played(self, course: Callable[[Array], Array], hurry: float) -> Array:
        """Return the angles (m, n) of a course as fast as may be."""
        steps = self.steps_for(course, hurry)
        return course(np.arange(1, steps + 1) / steps)


def _trapezoid(u: Array, ramp: float = 0.25) -> Array:
    """Return the share of the way at shares of the time, at constant speed between ramps."""
    top = 1 / (1 - ramp)
    up, down = top * u**2 / (2 * ramp), 1 - top * (1 - u) ** 2 / (2 * ramp)
    return np.where(u < ramp, up, np.where(u > 1 - ramp, down, top * (u - ramp / 2)))


def _cycloid(u: Array) -> Array:
    """Return the share of the way at shares of the time, its acceleration a sine."""
    return u - np.sin(2 * np.pi * u) / (2 * np.pi)


def _move(start: Array, end: Array, profile: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda u: start + (end - start) * profile(u)[:, None]


def _stay(pose: Array, seconds: float) -> Array:
    return np.repeat(pose[None], round(seconds / STEP_S), axis=0)


def _pick_and_place(maker: _Maker, steps: int) -> Array:
    """Return a cycle between taught places, down to each and up again, with waits, over and over."""
    places = [maker.pose() for _ in range(maker.rng.integers(2, 5))]
    above = [place + 0.15 * maker.build.range * maker.rng.uniform(-1, 1, len(place)) for place in places]
    waits = maker.rng.uniform(0.2, 1.2, len(places))
    parts, now, done, k = [], above[0], 0, 0
    while done < steps:
        k = (k + 1) % len(places)
        for end, share in ((above[k], 1.0), (places[k], 0.5)):
            parts.append(maker.played(_move(now, end, _trapezoid), share * maker.hurry))
            now = end
        parts.append(_stay(now, float(waits[k])))
        parts.append(maker.played(_move(now, above[k], _trapezoid), 0.5 * maker.hurry))
        now = above[k]
        done = sum(len(part) for part in parts)
    return np.concatenate(parts)[:steps]


def _s_curves(maker: _Maker, steps: int) -> Array:
    """Return moves between random poses whose acceleration is a sine, now and then a wait."""
    parts, now, done = [], maker.pose(), 0
    while done < steps:
        end = maker.pose()
        parts.append(maker.played(_move(now, end, _cycloid), maker.hurry * maker.rng.uniform(0.3, 1.0)))
        parts.append(_stay(end, float(maker.rng.choice([0.0, 0.2, 0.5]))))
        now, done = end, sum(len(part) for part in parts)
    return np.concatenate(parts)[:steps]


def _flange(maker: _Maker, data: mujoco.MjData, pose: Array) -> tuple[Array, Array]:
    data.qpos[:] = pose
    mujoco.mj_kinematics(maker.rigid, data)
    mujoco.mj_comPos(maker.rigid, data)
    return data.site_xpos[0].copy(), data.site_xmat[0].reshape(3, 3).copy()


def _line(maker: _Maker, start: Array, goal: Array) -> Array | None:
    """Return poses (81, n) along which the flange goes straight to where it is in another pose; None where it cannot.

    Six joints and more turn it evenly as well; of fewer, the last turns from where it is to where it is to be.
    """
    data = mujoco.MjData(maker.rigid)
    first, turned = _flange(maker, data, start)
    last, wanted = _flange(maker, data, goal)
    whole = Rotation.from_matrix(wanted @ turned.T).as_rotvec()
    places, turns = np.zeros((3, maker.build.joints)), np.zeros((3, maker.build.joints))
    pose, poses = start.copy(), [start]
    for share in np.linspace(0, 1, 81)[1:]:
        for _ in range(8):
            place, rotation = _flange(maker, data, pose)
            mujoco.mj_jacSite(maker.rigid, data, places, turns, 0)
            miss, jacobian = first + share * (last - first) - place, places
            if maker.build.joints >= 6:
                to = Rotation.from_rotvec(share * whole).as_matrix() @ turned
                miss = np.concatenate([miss, Rotation.from_matrix(to @ rotation.T).as_rotvec()])
                jacobian = np.vstack([places, turns])
            else:
                pose[-1] = start[-1] + share * (goal[-1] - start[-1])
                jacobian = places * (np.arange(maker.build.joints) < maker.build.joints - 1)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-7 * np.eye(len(miss)), miss)
            pose = pose + step
            if np.max(np.abs(step)) < 1e-7:
                break
        leap = np.max(np.abs(pose - poses[-1]) / maker.build.range)
        if np.linalg.norm(miss) > 1e-3 or leap > 0.12 or np.any(np.abs(pose) > maker.build.limit):
            return None
        poses.append(pose)
    return np.array(poses)


def _lines(maker: _Maker, steps: int) -> Array:
    """Return straight lines of the flange, by inverse kinematics; a move of the joints where there is no line."""
    parts, now, done = [], maker.pose(), 0
    hurry = maker.hurry * maker.rng.uniform(0.5, 1.0)
    while done < steps:
        found = None
        for _ in range(6):
            found = _line(maker, now, now + 0.6 * (maker.pose() - now))
            if found is not None:
                break
        if found is None:
            end = maker.pose()
            parts.append(maker.played(_move(now, end, _trapezoid), hurry))
        else:
            way, end = interpolate.make_interp_spline(np.linspace(0, 1, len(found)), found, k=3), found[-1]
            parts.append(maker.played(lambda u, way=way: way(_trapezoid(u)), hurry))
        parts.append(_stay(end, float(maker.rng.choice([0.0, 0.1, 0.6]))))
        now, done = end, sum(len(part) for part in parts)
    return np.concatenate(parts)[:steps]


def _from_rest(home: Array, angles: Array) -> Array:
    """Return waves that swell out of a pose and fade into it."""
    time = np.arange(len(angles)) * STEP_S
    swell = np.clip(np.minimum(time, time[::-1]) / 1.5, 0, 1)[:, None]
    return home + (angles - home) * (3 * swell**2 - 2 * swell**3)


def _chirps(maker: _Maker, steps: int) -> Array:
    """Return sines whose frequency rises and whose amplitude keeps the speed, all joints at once."""
    time = np.arange(steps) * STEP_S
    low, high = maker.rng.uniform(0.04, 0.1), maker.rng.uniform(0.6, 1.5)
    growth = np.log(high / low) / time[-1]
    out = np.empty((steps, maker.build.joints))
    for j in range(maker.build.joints):
        low_j = low * maker.rng.uniform(0.8, 1.25)
        frequency = low_j * np.exp(growth * time)
        phase = 2 * np.pi * low_j * (np.exp(growth * time) - 1) / growth + maker.rng.uniform(0, 2 * np.pi)
        most = maker.hurry * maker.build.speed[j]
        by_rise = maker.build.speed[j] / RISE_S / (2 * np.pi * frequency) ** 2
        reach = np.minimum(np.minimum(maker.build.range[j], 0.7 * most / (2 * np.pi * frequency)), 0.7 * by_rise)
        out[:, j] = maker.build.home[j] + ndimage.gaussian_filter1d(reach, 500) * np.sin(phase)
    return _from_rest(maker.build.home, out)


def _harmonics(maker: _Maker, steps: int) -> Array:
    """Return sums of seven harmonics."""
    time = np.arange(steps) * STEP_S
    base = maker.rng.uniform(0.05, 0.1)
    order = np.arange(1, 8)
    out = np.empty((steps, maker.build.joints))
    for j in range(maker.build.joints):
        size, phase = maker.rng.exponential(1.0, 7) / order, maker.rng.uniform(0, 2 * np.pi, 7)
        wave = np.sin(2 * np.pi * base * np.outer(time, order) + phase) @ size
        wave = wave - 0.5 * (wave.max() + wave.min())
        fast = np.max(np.abs(np.gradient(wave, STEP_S)))
        rise = np.max(np.abs(np.gradient(np.gradient(wave, STEP_S), STEP_S)))
        most = min(
            maker.build.range[j] / np.max(np.abs(wave)),
            maker.hurry * maker.build.speed[j] / fast,
            maker.build.speed[j] / RISE_S / rise,
        )
        out[:, j] = maker.build.home[j] + most * wave
    return _from_rest(maker.build.home, out)


def _slow_runs(maker: _Maker, steps: int) -> Array:
    """Return each joint to and fro in its turn at one speed after another, all others held, to measure friction."""
    build = maker.build
    pose, parts = maker.pose(), []
    slot = steps // build.joints
    for j in maker.rng.permutation(build.joints):
        done, level = 0, 0
        shares = maker.hurry * np.array([0.5, 0.25, 0.12, 0.05, 0.02])
        while done < slot:
            speed = shares[level % len(shares)] * build.speed[j]
            way = min(build.range[j], speed * slot * STEP_S / 5)
            there = pose.copy()
            there[j] += way * (1.0 if pose[j] < build.home[j] else -1.0)
            count = max(round(way / speed / STEP_S), 600)
            ramp = min(0.3, 0.1 / (count * STEP_S))
            for a, b in ((pose, there), (there, pose)):
                part = _move(a, b, lambda u, ramp=ramp: _trapezoid(u, ramp))(np.arange(1, count + 1) / count)
                parts.append(part)
                done += count
            level += 1
        # what does not fit is left out on the way back, so the pose is where it began
        extra = done - slot
        if extra > 0:
            last = np.concatenate(parts)[:-extra]
            back = maker.played(_move(last[-1], pose, _cycloid), 0.3)
            parts = [last, back]
    whole = np.concatenate(parts)
    return np.concatenate([whole, np.repeat(whole[-1:], max(0, steps - len(whole)), axis=0)])[:steps]


KINDS: dict[str, Callable[[_Maker, int], Array]] = {
    "pick and place": _pick_and_place,
    "lines": _lines,
    "s-curves": _s_curves,
    "chirps": _chirps,
    "harmonics": _harmonics,
    "slow runs": _slow_runs,
}


def draw_program(
    rng: np.random.Generator,
    build: Build,
    rigid: mujoco.MjModel,
    seconds: float,
    kind: str | None = None,
    rings_hz: float | None = None,
) -> Program:
    """Draw a program of a kind, of any, or of two after each other; rings_hz: lowest frequency of an elastic robot."""
    names = [*KINDS, "mixture"]
    kind = str(rng.choice(names, p=[0.18, 0.15, 0.15, 0.1, 0.17, 0.08, 0.17])) if kind is None else kind
    maker = _Maker(rng, build, rigid, float(rng.uniform(0.35, 0.85)))
    lead = round(LEAD_S / STEP_S)
    steps = round(seconds / STEP_S) + lead
    if kind == "mixture":
        first, second = rng.choice(list(KINDS), 2, replace=False)
        one = KINDS[first](maker, steps // 2)
        # the second begins anywhere: a move leads there
        other = KINDS[second](maker, steps // 2)
        way = maker.played(_move(one[-1], other[0], _cycloid), 0.5)
        angles = np.concatenate([one, way, other])[:steps]
    else:
        angles = KINDS[kind](maker, steps)
    angles = np.concatenate([np.repeat(angles[:1], lead, axis=0), angles])
    # jerk is limited by a mean over some steps, twice; planners of robots that ring take about a period of it
    mean_s = float(rng.choice([0.008, 0.02, 0.05]))
    if rings_hz is not None:
        mean_s = float(rng.uniform(0.5, 1.2)) / rings_hz
    width = round(mean_s / STEP_S)
    for _ in range(2):
        angles = ndimage.uniform_filter1d(angles, width, axis=0, mode="nearest")
    return Program(kind, angles, np.gradient(angles, STEP_S, axis=0))
