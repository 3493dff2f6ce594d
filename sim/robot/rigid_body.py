"""Rigid-body dynamics of a robot: torques of all joints, linear in the inertial parameters of its links.

Positions, Jacobians and accelerations are MuJoCo's (`mj_inverse` gives the same torques, in one piece); taken apart by
link they are the regressor of Atkeson, An and Hollerbach (1986): ten numbers per link, of its mass, first moments and
inertia about its own frame.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import AxisError
from sim.robot.robot import Robot

Array = NDArray[np.float64]

WEIGHTLESS = 1e-9  # kg and kg m2, of links that move and have none: frames between two joints at one place
PARAMETERS = 10  # m; m c (x, y, z); inertia about the frame's origin (xx, yy, zz, xy, xz, yz)


@dataclass(frozen=True)
class RigidBody:
    """Links that move, and the joints that move them.

    `parameters`: of each moving link, with a described payload, shape (links, 10); `tool`: index of the link that the
    logged joint farthest from the base moves (of several, the last in the log); `rest`: position of each degree of
    freedom while the logged joints stand at 0 [rad], [m].
    """

    parameters: Array
    links: tuple[str, ...]
    tool: int
    model: Any
    columns: tuple[int, ...]
    rest: Array

    @staticmethod
    def of(robot: Robot) -> RigidBody:
        """Compile the description.

        Raises
        ------
        AxisError
            for a URDF that MuJoCo cannot make a robot of; the text is its own.
        """
        import mujoco

        try:
            spec = mujoco.MjSpec.from_string(robot.urdf.text)
            spec.compiler.balanceinertia = True  # makers round; a body whose moments break the triangle is a thin one
            spec.compiler.boundmass = spec.compiler.boundinertia = WEIGHTLESS
            last = max((spec.joint(joint.name) for joint in reversed(robot.joints)), key=_depth)
            if robot.payload.mass_kg:
                last.parent.add_body(
                    mass=robot.payload.mass_kg, ipos=robot.payload.center_m, inertia=np.zeros(3), explicitinertial=True
                )  # fixed to its link, and counted into it as every link is that no joint moves
            model = spec.compile()
        except ValueError as error:
            raise AxisError(f"urdf: {' '.join(str(error).split())}") from None
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # stops at the ends of joints are not asked
        model.opt.gravity[:] = robot.gravity_m_s2
        joint_ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint.name) for joint in robot.joints]
        columns = tuple(int(model.jnt_dofadr[k]) for k in joint_ids)
        tool = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, last.parent.name) - 1
        names = tuple(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, k) for k in range(1, model.nbody))
        parameters = np.array([_parameters(model, k) for k in range(1, model.nbody)])
        rest = np.array([robot.held.get(name, 0.0) for name in _joint_names(model)])
        return RigidBody(parameters, names, tool, model, columns, rest)

    def unknown(self, known: Collection[str]) -> dict[str, tuple[str, ...]]:
        """Joints that are neither logged nor `known`, and on which torques of logged joints depend: of which each.

        Two joints of one arm depend on each other's motion by the masses that both of them move.
        """
        above: list[set[int]] = [set()]  # each link, and all between it and the base
        for link in range(1, self.model.nbody):
            above.append({link} | above[int(self.model.body_parentid[link])])
        heavy = [link for link, own in enumerate(self.parameters, start=1) if own[0] > 0.0]
        moved = {
            name: {link for link in heavy if int(body) in above[link]}
            for name, body in zip(_joint_names(self.model), self.model.jnt_bodyid, strict=True)
        }
        names = list(moved)
        logged = [names[int(self.model.dof_jntid[column])] for column in self.columns]
        depend = {name: tuple(one for one in logged if moved[one] & moved[name]) for name in names}
        return {name: which for name, which in depend.items() if which and name not in {*logged, *known}}

    def _data(self) -> Any:
        import mujoco

        data = mujoco.MjData(self.model)
        data.qpos[:] = self.rest
        return data

    def regressor(self, position: Array, speed: Array, acceleration: Array) -> Array:
        """Torques [N m] per unit of each link's parameters, shape (rows, joints, links, 10).

        `position` [rad], `speed` [rad/s], `acceleration` [rad/s2] of the logged joints, shape (rows, joints).
        """
        import mujoco

        model, data = self.model, self._data()
        rows, links, dofs = len(position), len(self.links), model.nv
        along, about = np.zeros((rows, links, 3, dofs)), np.zeros((rows, links, 3, dofs))
        turned = np.zeros((rows, links, 3, 3))
        velocity, change = np.zeros((rows, links, 6)), np.zeros((rows, links, 6))
        columns, frame = list(self.columns), mujoco.mjtObj.mjOBJ_XBODY
        for row in range(rows):
            data.qpos[columns], data.qvel[columns] = position[row], speed[row]
            data.qacc[columns] = acceleration[row]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rnePostConstraint(model, data)
            turned[row] = data.xmat[1:].reshape(links, 3, 3)
            for link in range(links):
                mujoco.mj_jac(model, data, along[row, link], about[row, link], data.xpos[link + 1], link + 1)
                mujoco.mj_objectVelocity(model, data, frame, link + 1, velocity[row, link], 1)
                mujoco.mj_objectAcceleration(model, data, frame, link + 1, change[row, link], 1)
        force, moment = _wrench(velocity[..., :3], change[..., :3], change[..., 3:])
        back = np.swapaxes(turned, -1, -2)
        torques = np.swapaxes(back @ along, -1, -2) @ force + np.swapaxes(back @ about, -1, -2) @ moment
        return np.asarray(np.moveaxis(torques, 2, 1)[:, columns])

    def at_rest(self, position: Array, gravity: Array) -> Array:
        """The regressor of the robot at rest under another gravity, shape (3,) [m/s2] in the frame of the base."""
        described, rest = self.model.opt.gravity.copy(), np.zeros_like(position)
        self.model.opt.gravity[:] = gravity
        out = self.regressor(position, rest, rest)
        self.model.opt.gravity[:] = described
        return out

    def torque(self, position: Array, speed: Array, acceleration: Array) -> Array:
        """Torques of the rigid robot as described, by MuJoCo in one piece, shape (rows, joints) [N m]."""
        import mujoco

        data, columns = self._data(), list(self.columns)
        out = np.empty(position.shape)
        for row in range(len(position)):
            data.qpos[columns], data.qvel[columns], data.qacc[columns] = position[row], speed[row], acceleration[row]
            mujoco.mj_inverse(self.model, data)
            out[row] = data.qfrc_inverse[columns]
        return out


def _joint_names(model: Any) -> list[str]:
    """Of each degree of freedom: turning and sliding joints have one each."""
    import mujoco

    return [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(model.njnt)]


def _depth(joint: Any) -> int:
    """Links from the base to what a joint moves."""
    body, depth = joint.parent, 0
    while body.parent is not None:
        body, depth = body.parent, depth + 1
    return depth


def _parameters(model: Any, body: int) -> Array:
    """Of a body in its own frame, shape (10,)."""
    import mujoco

    mass, center, turn = float(model.body_mass[body]), model.body_ipos[body], np.zeros(9)
    if mass <= WEIGHTLESS:
        return np.zeros(PARAMETERS)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    inertia += mass * (center @ center * np.eye(3) - np.outer(center, center))
    moments = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return np.array([mass, *(mass * center), *moments])


def _cross(v: Array) -> Array:
    """Matrix of the cross product with v, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)


def _times_inertia(w: Array) -> Array:
    """I w as a matrix times (xx, yy, zz, xy, xz, yz), shape (..., 3, 6)."""
    x, y, z = np.moveaxis(w, -1, 0)
    o = np.zeros_like(x)
    rows = ([x, o, o, y, z, o], [o, y, o, x, o, z], [o, o, z, o, x, y])
    return np.stack([np.stack(row, -1) for row in rows], -2)


def _wrench(turn: Array, turn_rate: Array, acceleration: Array) -> tuple[Array, Array]:
    """Newton and Euler about the frame's origin, per parameter: force and moment, shape (..., 3, 10).

    `turn` [rad/s], `turn_rate` [rad/s2] and `acceleration` of the origin against free fall [m/s2], in the link's frame.
    """
    force, moment = (np.zeros((*turn.shape, PARAMETERS)) for _ in range(2))
    force[..., 0] = acceleration
    force[..., 1:4] = _cross(turn_rate) + _cross(turn) @ _cross(turn)
    moment[..., 1:4] = -_cross(acceleration)
    moment[..., 4:] = _times_inertia(turn_rate) + _cross(turn) @ _times_inertia(turn)
    return force, moment
