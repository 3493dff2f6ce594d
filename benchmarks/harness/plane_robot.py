"""A robot of two links in a plane, whose torques stand in every textbook, and a log of it."""

import csv
import io

import numpy as np

URDF = """<robot name="arm"><link name="base"/>{links}
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/>
<limit lower="-6.3" upper="6.3" velocity="9" effort="99"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 -1 0"/>
<origin xyz="0.5 0 0"/><limit lower="-6.3" upper="6.3" velocity="9" effort="99"/></joint></robot>"""
LINK = (
    '<link name="{}"><inertial><origin xyz="0.25 0 0"/><mass value="{}"/>'
    '<inertia ixx="0.01" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
MASSES, INERTIAS, LENGTH, CENTER, GRAVITY = (8.0, 4.0), (0.2, 0.1), 0.5, 0.25, 9.81
DRY, VISCOUS, ROTOR = (6.0, 2.0), (3.0, 0.8), (0.5, 0.1)
ROBOT = 'name = "plane arm"\n[[joints]]\nname = "shoulder"\n[[joints]]\nname = "elbow"\n'
MAP = """
[time_s]
column = "t"
unit = "s"
[motor_position_rad]
column = ["q1", "q2"]
unit = "rad"
[motor_torque_nm]
column = ["tau1", "tau2"]
unit = "N.m"
"""


def urdf() -> bytes:
    links = (LINK.format(n, m, i, i) for n, m, i in zip(("upper", "lower"), MASSES, INERTIAS, strict=True))
    return URDF.format(links="".join(links)).encode()


def log(seconds: float = 8.0, rate_hz: float = 100.0) -> bytes:
    """Return a log of both joints: Lagrange's equations of two links in a plane, rotors, friction, white noise."""
    t = np.arange(int(seconds * rate_hz)) / rate_hz
    q, v, a = np.zeros((3, 2, t.size))
    for joint, waves in enumerate((((0.8, 0.31), (0.3, 0.83)), ((0.7, 0.43), (0.35, 1.07)))):
        for size, hertz in waves:
            w = 2 * np.pi * hertz
            q[joint] += size * np.sin(w * t)
            v[joint] += size * w * np.cos(w * t)
            a[joint] -= size * w**2 * np.sin(w * t)
    (m1, m2), (i1, i2), c2, s2 = MASSES, INERTIAS, np.cos(q[1]), np.sin(q[1])
    own = i2 + m2 * CENTER**2
    coupled = own + m2 * LENGTH * CENTER * c2
    first = i1 + m1 * CENTER**2 + own + m2 * (LENGTH**2 + 2 * LENGTH * CENTER * c2)
    turn = m2 * LENGTH * CENTER * s2
    weight = GRAVITY * m2 * CENTER * np.cos(q[0] + q[1])
    torque = np.stack(
        [
            first * a[0] + coupled * a[1] - turn * (2 * v[0] * v[1] + v[1] ** 2)
            + GRAVITY * (m1 * CENTER + m2 * LENGTH) * np.cos(q[0]) + weight,
            coupled * a[0] + own * a[1] + turn * v[0] ** 2 + weight,
        ]
    )  # fmt: skip
    torque += np.array(ROTOR)[:, None] * a + np.array(DRY)[:, None] * np.tanh(v / 0.01) + np.array(VISCOUS)[:, None] * v
    torque += 0.1 * np.random.default_rng(1).standard_normal(torque.shape)
    out = io.StringIO()
    csv.writer(out).writerow(("t", "q1", "q2", "tau1", "tau2"))
    csv.writer(out).writerows(np.column_stack([t + 100.0, *q, *torque]).tolist())
    return out.getvalue().encode()


Parts = dict[str, tuple[str, bytes]]


def parts(**other: tuple[str, bytes]) -> Parts:
    """Return all that belongs to a robot; others in their place, and without what has no bytes."""
    whole = {
        "robot": ("robot.toml", ROBOT.encode()),
        "urdf": ("arm.urdf", urdf()),
        "telemetry": ("log.csv", log(2.0)),
        "channels": ("map.toml", MAP.encode()),
        **other,
    }
    return {name: one for name, one in whole.items() if one[1]}
