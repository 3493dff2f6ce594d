"""Robots as models of MuJoCo: rigid for what a motion asks, and with motors behind elastic gears for what happens."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from tests.robot_bank.multibody import Array, Body
from tests.robot_bank.second.builds import Build

STEP_S = 5e-4


def model(
    build: Build, bodies: Sequence[Body], gravity: Array, rotors: Array | None = None, elastic: bool = False
) -> mujoco.MjModel:
    """Return the model of a robot; gravity (3,) [m/s2] is in the base frame, rotors (n,) [kg m2 or kg] at the joints.

    Of an elastic robot each joint is two: the motor's angle over the ratio, which alone turns the rotor, and after it
    the twist of the gear; the link goes by their sum.
    """
    lines = [
        "<mujoco>",
        '<compiler angle="radian" balanceinertia="false"/>',
        f'<option timestep="{STEP_S}" integrator="implicitfast" gravity="{_numbers(gravity)}">',
        '<flag contact="disable" constraint="disable" limit="disable"/></option><worldbody>',
    ]
    before = np.zeros(3)
    for j, body in enumerate(bodies):
        point = build.points[j]
        kind = "slide" if build.sliding[j] else "hinge"
        axis = f'type="{kind}" axis="{_numbers(build.directions[j])}"'
        lines.append(f'<body pos="{_numbers(point - before)}">')
        i = body.inertia
        entries = _numbers(np.array([i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]))
        center = _numbers(body.center - point)
        lines.append(f'<inertial pos="{center}" mass="{float(body.mass)!r}" fullinertia="{entries}"/>')
        armature = 0.0 if rotors is None else float(rotors[j])
        lines.append(f'<joint {axis} armature="{armature!r}"/>')
        if elastic:
            lines.append(f"<joint {axis}/>")
        before = point
    frame, place = build.flange
    x, y, z, w = Rotation.from_matrix(frame).as_quat()
    lines.append(f'<site name="flange" pos="{_numbers(place - before)}" quat="{_numbers(np.array([w, x, y, z]))}"/>')
    lines += ["</body>"] * len(bodies) + ["</worldbody></mujoco>"]
    return mujoco.MjModel.from_xml_string("\n".join(lines))


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def asked(rigid: mujoco.MjModel, angles: Array, speeds: Array, accelerations: Array) -> Array:
    """Return the torques (m, n) [N m or N] that a motion (m, n) asks of the joints of a rigid robot."""
    data = mujoco.MjData(rigid)
    out = np.empty_like(angles)
    for k in range(len(angles)):
        data.qpos[:], data.qvel[:], data.qacc[:] = angles[k], speeds[k], accelerations[k]
        mujoco.mj_inverse(rigid, data)
        out[k] = data.qfrc_inverse
    return out


def inertias(rigid: mujoco.MjModel, angles: Array) -> tuple[Array, Array]:
    """Return the inertias (n,) [kg m2 or kg] felt at the joints with all others held, and with all others free.

    The mean and the least over poses (m, n).
    """
    data = mujoco.MjData(rigid)
    full = np.zeros((rigid.nv, rigid.nv))
    held, free = [], []
    for pose in angles:
        data.qpos[:] = pose
        mujoco.mj_forward(rigid, data)
        mujoco.mj_fullM(rigid, data, full)
        held.append(np.diag(full).copy())
        free.append(1 / np.diag(np.linalg.inv(full)))
    return np.mean(held, axis=0), np.min(free, axis=0)
