"""Arms of a chain of links, their URDF, and their torques by Newton and Euler, written apart from what is tested."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.robot.robot import Joint, Payload, Robot, Vector, rigid_joint
from sim.robot.urdf import read_urdf

Array = NDArray[np.float64]
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Link:
    """`origin` of its joint in the frame before [m], `axis` of the joint, mass [kg], centre [m], inertia [kg m2]."""

    origin: Vector
    axis: Vector
    mass: float
    center: Vector
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    slides: bool = False


def names_of(links: Sequence[Link]) -> list[str]:
    return [f"joint{k + 1}" for k in range(len(links))]


def urdf(links: Sequence[Link], names: Sequence[str] = (), reach: float = 6.0, extra: str = "") -> str:
    """Links link0 (the base, without mass) to linkN."""
    parts = ['<robot name="arm"><link name="link0"/>']
    for k, (link, name) in enumerate(zip(links, names or names_of(links), strict=True), start=1):
        i, kind = link.inertia, "prismatic" if link.slides else "revolute"
        moments = {"ixx": i[0, 0], "iyy": i[1, 1], "izz": i[2, 2], "ixy": i[0, 1], "ixz": i[0, 2], "iyz": i[1, 2]}
        tensor = " ".join(f'{key}="{float(value)!r}"' for key, value in moments.items())
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="link{k - 1}"/><child link="link{k}"/>'
            f'<origin xyz="{_text(link.origin)}"/><axis xyz="{_text(link.axis)}"/>'
            f'<limit lower="{-reach}" upper="{reach}" velocity="3" effort="100"/></joint>'
            f'<link name="link{k}"><inertial><origin xyz="{_text(link.center)}"/><mass value="{float(link.mass)!r}"/>'
            f"<inertia {tensor}/></inertial></link>"
        )
    return "".join([*parts, extra, "</robot>"])


def _text(vector: Sequence[float]) -> str:
    return " ".join(repr(float(x)) for x in vector)


def robot(links: Sequence[Link], gravity: Vector = GRAVITY, payload: Payload = Payload()) -> Robot:
    joints: tuple[Joint, ...] = tuple(rigid_joint(name) for name in names_of(links))
    return Robot("arm", read_urdf(urdf(links).encode()), joints, gravity, payload)


def two_links() -> list[Link]:
    """Swinging about y; of unequal masses and lengths."""
    thin = [np.diag([0.001, 0.02 * m, 0.02 * m]) for m in (3.0, 2.0)]
    return [
        Link((0.0, 0.0, 0.5), (0.0, 1.0, 0.0), 3.0, (0.2, 0.0, 0.0), thin[0]),
        Link((0.4, 0.0, 0.0), (0.0, 1.0, 0.0), 2.0, (0.15, 0.0, 0.0), thin[1]),
    ]


def random_arm(rng: np.random.Generator, joints: int, slides: Sequence[int] = ()) -> list[Link]:
    """The first joint turns about the vertical, the others about any axis; heavier near the base."""
    out = []
    for k in range(joints):
        axis = np.array([0.0, 0.0, 1.0]) if k == 0 else rng.normal(size=3)
        half = rng.normal(size=(3, 3)) * 0.05
        mass = float(rng.uniform(3.0, 6.0)) / (1.0 + 0.5 * k)
        out.append(
            Link(
                _vector(np.r_[0.0, 0.0, 0.3] if k == 0 else 0.3 * _unit(rng.normal(size=3))),
                _vector(_unit(axis)), mass, _vector(0.15 * _unit(rng.normal(size=3))),
                mass * _spread(half @ half.T + 0.001 * np.eye(3)), k in slides,
            )
        )  # fmt: skip
    return out


def _spread(second_moments: Array) -> Array:
    """Inertia of a body of which the mass has these second moments: one that can be."""
    return np.asarray(np.trace(second_moments) * np.eye(3) - second_moments)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def _vector(v: Array) -> Vector:
    x, y, z = (float(value) for value in v)
    return x, y, z


def with_mass(links: Sequence[Link], mass: float, center: Array) -> list[Link]:
    """The arm with a point mass at its last link [kg], [m]."""
    last = links[-1]
    total = last.mass + mass
    middle = (last.mass * np.array(last.center) + mass * center) / total
    inertia = last.inertia.copy()
    for m, at in ((last.mass, np.array(last.center)), (mass, center)):
        arm = at - middle
        inertia = inertia + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return [*links[:-1], replace(last, mass=total, center=_vector(middle), inertia=inertia)]


def swings(
    rng: np.random.Generator, joints: int, seconds: float, rate: float, size: float = 0.6
) -> tuple[Array, Array, Array, Array]:
    """Times, positions, speeds, accelerations of a sum of harmonics, shape (rows,) and (rows, joints)."""
    time = np.arange(int(seconds * rate) + 1) / rate
    ways = [np.zeros((time.size, joints)) for _ in range(3)]
    for harmonic in range(1, 6):
        w = 2.0 * np.pi * harmonic / 10.0
        for trig, turned, sign in ((np.sin, np.cos, 1.0), (np.cos, np.sin, -1.0)):
            a = rng.normal(size=joints) * size / harmonic
            ways[0] += a * trig(w * time)[:, None]
            ways[1] += sign * a * w * turned(w * time)[:, None]
            ways[2] -= a * w**2 * trig(w * time)[:, None]
    return time, *ways


def torque(links: Sequence[Link], q: Array, qd: Array, qdd: Array, gravity: Sequence[float] = GRAVITY) -> Array:
    """Newton and Euler from the base to the tool and back (Luh, Walker, Paul 1980), shape (rows, joints) [N m]."""
    rows = len(q)
    w, dw, a = np.zeros((rows, 3)), np.zeros((rows, 3)), np.tile(-np.array(gravity), (rows, 1))
    turns, places, forces, moments = [], [], [], []
    for k, link in enumerate(links):
        axis = np.array(link.axis)
        place = np.tile(link.origin, (rows, 1)) + (q[:, k, None] * axis if link.slides else 0.0)
        turn = Rotation.from_rotvec(np.outer(np.zeros(rows) if link.slides else q[:, k], axis)).as_matrix()
        a = a + np.cross(dw, place) + np.cross(w, np.cross(w, place))
        w, dw, a = (_back(turn, v) for v in (w, dw, a))
        along, gained = qd[:, k, None] * axis, qdd[:, k, None] * axis
        if link.slides:
            a = a + 2.0 * np.cross(w, along) + gained
        else:
            dw = dw + np.cross(w, along) + gained
            w = w + along
        c = np.tile(link.center, (rows, 1))
        force = link.mass * (a + np.cross(dw, c) + np.cross(w, np.cross(w, c)))
        moments.append(dw @ link.inertia + np.cross(w, w @ link.inertia) + np.cross(c, force))
        forces.append(force)
        turns.append(turn)
        places.append(place)
    out = np.zeros_like(q)
    for k in reversed(range(len(links))):
        link = links[k]
        out[:, k] = (forces[k] if link.slides else moments[k]) @ np.array(link.axis)
        if k:
            force, moment = (np.einsum("nij,nj->ni", turns[k], v) for v in (forces[k], moments[k]))
            forces[k - 1] = forces[k - 1] + force
            moments[k - 1] = moments[k - 1] + moment + np.cross(places[k], force)
    return out


def _back(turn: Array, v: Array) -> Array:
    return np.asarray(np.einsum("nji,nj->ni", turn, v))


def write_robot(folder: Path, links: Sequence[Link], names: Sequence[str] = (), head: str = "", tail: str = "") -> Path:
    """arm.urdf and robot.toml, whose path is returned."""
    names = names or names_of(links)
    (folder / "arm.urdf").write_text(urdf(links, names))
    joints = "".join(f'[[joints]]\nname = "{name}"\n' for name in names)
    path = folder / "robot.toml"
    path.write_text(f'schema = "gearcase-robot/1"\nurdf = "arm.urdf"\n{head}\n{joints}{tail}')
    return path


def write_log(path: Path, time: Array, q: Array, felt: Array) -> Path:
    """Time, positions, torques, without names."""
    np.savetxt(path, np.column_stack([time, q, felt]), delimiter=",", fmt="%.9g")
    return path


def channel_map(joints: int) -> str:
    first = ", ".join(str(k + 2) for k in range(joints))
    second = ", ".join(str(k + 2 + joints) for k in range(joints))
    return (
        'schema = "gearcase-channels/1"\nheader = false\n[time_s]\ncolumn = 1\n'
        f"[motor_position_rad]\ncolumn = [{first}]\n[motor_torque_nm]\ncolumn = [{second}]\n"
    )
