"""Laws of the parts of a drive train, each in one place, as plain Python: friction, spring, contact, dents, losses.

The chain's kernel, its check and the observer of an investigation compile them, each with its own options; the exact
engine takes their affine pieces. They do not call each other, so that each can be compiled alone. numba's cache sees
changes of the file of a function alone; what calls these laws therefore bears the digest of this file in its name
(`keyed`), and so does its entry in the cache.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

TWO_PI = 2.0 * math.pi
# laws of contact, and their pieces
LINEAR, ELASTO, ELASTO2 = 1.0, 2.0, 3.0
BOTH, LIMITED, APART = 1, 2, 3
# columns of a shaft, of a link (`sim.chain.integrate`)
(J, COULOMB_F, COULOMB_B, VISCOUS_F, VISCOUS_B, STRIBECK, STRIBECK_W, STRIBECK_EXP, DRIFT, GRAVITY, PHASE,
 OFFSET, FRICTIONAL) = range(13)  # fmt: skip
INV, C, D, HALF, LAW, ETA1, ETA2, BF1, BF2, TURN, LOSSY, CUBIC, HYST, HYST_X = range(14)
# rows of lines, ripples: shaft (of ripples -1: time), order, amplitude, phase, shaft acted on
# rows of dents: shaft, angle, 1 / half width with the sign of the flank, depth, form
ROW = 5


def keyed(function: Any, *others: object) -> Any:
    """The function, named after this file and `others`, numbers that it takes from other files."""
    digest = hashlib.sha256(Path(__file__).read_bytes() + repr(others).encode()).hexdigest()[:12]
    function.__qualname__ += f"-{digest}"
    return function


def friction(
    coulomb_forward: float,
    coulomb_backward: float,
    viscous_forward: float,
    viscous_backward: float,
    stribeck: float,
    stribeck_speed: float,
    exponent: float,
    drift_per_s: float,
    speed: float,
    slip: float,
    t: float,
) -> float:
    """Torque [N m] against a shaft that moves at `speed` [rad/s]: Coulomb, Stribeck, viscous, drift.

    `slip`: share of its dry friction that a contact holds, 1 or -1 once it slides. Of friction that differs by
    direction that of the way is taken, in between both by their shares, so that it never drives: its sign is the slip's
    (Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083).
    """
    ahead = 0.5 * (1.0 + slip)
    level = ahead * coulomb_forward + (1.0 - ahead) * coulomb_backward
    viscous = ahead * viscous_forward + (1.0 - ahead) * viscous_backward
    if stribeck != 0.0:
        v = abs(speed) / stribeck_speed
        power = v * v if exponent == 2.0 else v**exponent
        level += stribeck * math.exp(-power)
    return (level * slip + viscous * speed) * (1.0 + drift_per_s * t)


def spring(x: float, stiffness: float, cubic: float) -> float:
    """Torque [N m] of a spring that hardens, twisted by `x` [rad]: c x (1 + cubic x^2)."""
    return stiffness * x * (1.0 + cubic * x * x)


def contact(law: float, spring_torque: float, damper_torque: float, piece: int) -> float:
    """Torque [N m] of a flank into which a spring presses with `spring_torque` > 0, its damper with `damper_torque`.

    `LINEAR` (Modelica 2.2): both act, even if that pulls. `ELASTO2`: never pulls. `ELASTO`: never pulls, and the damper
    never exceeds the spring, so that the torque is continuous. `piece`: 0 that which holds; else one of them, continued
    beyond its limits: `BOTH` act, the damper is `LIMITED` to the spring, or the flanks are `APART`.
    """
    if piece == 0:
        piece = BOTH
        if law != LINEAR and spring_torque + damper_torque <= 0.0:
            piece = APART
        elif law == ELASTO and damper_torque > spring_torque:
            piece = LIMITED
    if piece == BOTH:
        return spring_torque + damper_torque
    return 2.0 * spring_torque if piece == LIMITED else 0.0


def driver_torque(
    load: float, way: float, drives: bool, eta1: float, eta2: float, bearing1: float, bearing2: float
) -> float:
    """Torque [N m] into the driver of a gear that turns in direction `way` and asks for `load` without losses.

    Modelica's LossyGear, solved for the torque at flange_a: the driver `drives` (eta1, bearing1), or the driven gear.
    """
    if drives:
        return (load + way * bearing1) / eta1
    return eta2 * (load + way * bearing2)


def turning_torque(eta1: float, eta2: float, bearing1: float, bearing2: float) -> float:
    """Torque [N m] into the driver above which, turning forward, it drives: there both branches meet (tau_bf_a)."""
    if eta1 == 1.0 and eta2 == 1.0:
        return 0.5 * bearing1
    return (bearing1 - bearing2) / (eta1 - 1.0 / eta2)


def dents(
    rows: Any, first: int, last: int, side: float, k: int, angles: Any, shaft_0: int
) -> tuple[float, float, float]:
    """Missing material [rad at the driven gear] on one flank of link k, and its slopes over driver and driven gear.

    Of each dent depth (1 - |u|^form)^4, u = (angle - place) / half width: three times differentiable at its edges, as a
    Runge-Kutta step of order 4 needs it. `rows`: flat, of which those from `first` to before `last` are the link's;
    `angles` has that of shaft 0 at `shaft_0`.
    """
    depth = before = after = 0.0
    j = first
    while j < last:
        if rows[j + 2] * side > 0.0:
            shaft = int(rows[j])
            r = angles[shaft_0 + shaft] - rows[j + 1]
            u = (r - TWO_PI * math.floor(r / TWO_PI + 0.5)) * rows[j + 2]
            if abs(u) < 1.0:
                form = rows[j + 4]
                steep = abs(u) if form == 2.0 else abs(u) ** (form - 1.0)
                room = 1.0 - steep * abs(u)
                cube = rows[j + 3] * room * room * room
                depth += cube * room
                slope = math.copysign(4.0 * form * cube * steep, u) * rows[j + 2]
                if shaft == k:
                    before -= slope
                else:
                    after -= slope
        j += ROW
    return depth, before, after
