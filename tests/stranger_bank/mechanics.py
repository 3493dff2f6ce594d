"""The drive train: three inertias, two elastic stages with play, friction, servo and motor.

Angles are output angles [rad], torques output torques [N m]. The equations are integrated with the
semi-implicit Euler rule at 16 kHz (own code; `check.py` compares it with a four times finer step).

The halves differ: the work half has linear contact with viscous damping, Coulomb/Stribeck friction,
and a continuous cascaded P/PI servo; the final half has progressive contact with penetration
damping (Hunt and Crossley), bristle friction (LuGre), and a sampled PID with a quantised encoder.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from .axes import TABLE, TABLE_OUT, Unit
from .kinds import Floats
from .motions import DT, Motion

RUN_IN_S = 1.0


@dataclass(eq=False)
class Build:
    """A gearbox with its faults worked in, ready to be run."""

    unit: Unit
    gap_out: float
    gap_in: float
    coulomb: float
    stribeck: float
    te_in: Floats
    te_mid: Floats
    te_out: Floats
    stiff: Floats
    dent_right: Floats
    dent_left: Floats
    stick_speed: float = 0.08
    rub_gain: float = 1.0
    rub_mesh: float = 0.3
    radial: tuple[float, float] = (0.0, 0.0)
    impacts: tuple[float, float, float, float] | None = None
    rattle: tuple[float, float] | None = None
    sizes: dict[str, float] = field(default_factory=dict)
    notch_angle: float | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """What the sound is made of, at 16 kHz, run-in included: torques [N m], angles [rad]."""

    out_nm: Floats
    in_nm: Floats
    motor_nm: Floats
    motor_rad: Floats
    output_rad: Floats
    side: Floats


@njit(cache=True, error_model="numpy")
def _look(table: np.ndarray, turns: float) -> float:
    n = table.size
    x = turns - np.floor(turns)
    f = x * n
    i = int(f)
    f -= i
    i %= n
    j = i + 1
    if j == n:
        j = 0
    return table[i] + f * (table[j] - table[i])


@njit(cache=True, error_model="numpy")
def _integrate(
    par: np.ndarray,
    ref: np.ndarray,
    te_in: np.ndarray,
    te_mid: np.ndarray,
    te_out: np.ndarray,
    stiff: np.ndarray,
    dent_r: np.ndarray,
    dent_l: np.ndarray,
    ripple: np.ndarray,
    cog: np.ndarray,
    dt: float,
    out: np.ndarray,
) -> None:
    j0, j1, j2 = par[0], par[1], par[2]
    k_in, k_out, c_in, c_out = par[3], par[4], par[5], par[6]
    gap_in, gap_out = 0.5 * par[7], 0.5 * par[8]
    fc, st, vst, visc, fc_out, mu = par[9], par[10], par[11], par[12], par[13], par[14]
    grav, grav_ph = par[15], par[16]
    kpp, kpv, ki, lag, limit = par[17], par[18], par[19], par[20], par[21]
    ff_v, ff_a = par[22], par[23]
    ratio, n_in, n_mid = par[24], par[25], par[26]
    vs = par[27]
    modern = par[28] > 0.5
    quantum, hold = par[29], int(par[30])
    w0 = par[31]
    beta = par[32]
    zs = par[33]
    inv = 1.0 / (2.0 * np.pi)
    q0 = ref[0, 0]
    q1 = q0
    q2 = q0
    v0 = ref[1, 0]
    v1 = v0
    v2 = v0
    integ = grav * np.cos(q0 + grav_ph)
    u = integ
    tau = u
    z = 0.0
    ti_old = _look(te_in, n_in * q0 * inv)
    to_old = _look(te_mid, n_mid * q1 * inv) + _look(te_out, q2 * inv)
    f_out = 0.0
    side = 1.0
    s1 = 0.6 * np.sqrt(fc / zs * j0)
    q_seen_old = q0
    v_seen = v0
    for n in range(ref.shape[1]):
        # servo
        if not modern:
            vr = ff_v * ref[1, n] + kpp * (ref[0, n] - q0)
            ev = vr - v0
            u = kpv * ev + integ + ff_a * ref[2, n]
            if u > limit:
                u = limit
            elif u < -limit:
                u = -limit
            else:
                integ += ki * ev * dt
        elif n % hold == 0:
            seen = np.floor(q0 / quantum) * quantum
            if n > 0:
                v_seen += 0.5 * ((seen - q_seen_old) / (hold * dt) - v_seen)
            q_seen_old = seen
            e = ref[0, n] - seen
            u = kpv * (kpp * e + ref[1, n] - v_seen) + integ + ff_a * ref[2, n]
            if u > limit:
                u = limit
            elif u < -limit:
                u = -limit
            else:
                integ += ki * kpp * e * hold * dt
        tau += (u - tau) * (dt / lag)
        turn = ratio * q0 * inv
        t_m = tau * (1.0 + _look(ripple, turn)) + _look(cog, turn)
        # motor side friction, grows with the torque carried
        level = fc + mu * abs(f_out)
        g = level * (1.0 + st * np.exp(-((v0 / vst) ** 2)))
        if modern:
            s0 = level / zs
            z_new = (z + dt * v0) / (1.0 + dt * abs(v0) * s0 / g)
            fr = s0 * z_new + s1 * np.exp(-((v0 / vst) ** 2)) * (z_new - z) / dt + visc * v0
            z = z_new
        else:
            fr = g * np.tanh(v0 / vs) + visc * v0
        # input stage
        ti = _look(te_in, n_in * q0 * inv)
        d = q0 - q1 + ti
        rate = v0 - v1 + (ti - ti_old) / dt
        ti_old = ti
        f_in = 0.0
        if d > gap_in:
            f_in = k_in * (d - gap_in) + c_in * rate
            if f_in < 0.0:
                f_in = 0.0
        elif d < -gap_in:
            f_in = k_in * (d + gap_in) + c_in * rate
            if f_in > 0.0:
                f_in = 0.0
        # output stage
        at = q2 * inv
        to = _look(te_mid, n_mid * q1 * inv) + _look(te_out, at)
        d = q1 - q2 + to
        rate = v1 - v2 + (to - to_old) / dt
        to_old = to
        k = k_out * _look(stiff, at)
        f_out = 0.0
        pr = d - gap_out - _look(dent_r, at)
        pl = -d - gap_out - _look(dent_l, at)
        if pr > 0.0:
            f_out = k * pr + c_out * rate
            if modern:
                f_out = k * pr * (0.35 + 0.65 * np.sqrt(pr / w0)) * (1.0 + beta * rate)
            if f_out < 0.0:
                f_out = 0.0
            else:
                side = 1.0
        elif pl > 0.0:
            f_out = -k * pl + c_out * rate
            if modern:
                f_out = -k * pl * (0.35 + 0.65 * np.sqrt(pl / w0)) * (1.0 - beta * rate)
            if f_out > 0.0:
                f_out = 0.0
            else:
                side = -1.0
        v0 += dt * (t_m - fr - f_in) / j0
        v1 += dt * (f_in - f_out - 0.02 * visc * v1) / j1
        v2 += dt * (f_out - fc_out * np.tanh(v2 / vs) - grav * np.cos(q2 + grav_ph)) / j2
        q0 += dt * v0
        q1 += dt * v1
        q2 += dt * v2
        out[0, n] = f_out
        out[1, n] = f_in
        out[2, n] = t_m
        out[3, n] = ratio * q0
        out[4, n] = q2
        out[5, n] = side


def run(
    build: Build,
    motion: Motion,
    *,
    duration_s: float,
    payload: float,
    start: int,
    gravity_phase: float,
    modern: bool,
    finer: int = 1,
) -> Run:
    """Integrate the motion for run-in plus `duration_s`.

    start: sample of the period that the run begins with. finer: divides the step (for checks).
    """
    u = build.unit
    n = round((duration_s + RUN_IN_S) / DT)
    idx = (np.arange(n) + start) % motion.position.size
    ref = np.stack([motion.position[idx], motion.speed[idx], motion.accel[idx]])
    dt = DT
    if finer > 1:
        t = np.arange(n * finer) / finer
        ref = np.stack([np.interp(t, np.arange(n), r) for r in ref])
        dt = DT / finer
    d = u.design
    total = sum(u.j) + 0.5 * sum(d.payload)
    w = 2 * np.pi * u.servo_hz
    v_max = d.speed[1]
    par = np.array(
        [
            u.j[0], u.j[1], u.j[2] + payload, u.k_in, u.k_out, u.damp[0], u.damp[1],
            build.gap_in, build.gap_out, build.coulomb, build.stribeck,
            build.stick_speed * v_max, u.viscous, u.out_coulomb_nm, u.load_friction,
            u.gravity_nm, gravity_phase, w / 4, w * total * (0.7 if modern else 1.0),
            w * total * w / 6, u.lag_s, 4.0 * u.nominal_nm + u.gravity_nm,
            u.feed_forward, u.feed_forward * total, d.ratio, d.in_turns, d.mid_turns,
            0.004 * v_max, float(modern), 2 * np.pi / 2**17 / d.ratio,
            4.0 * finer, u.windup_rad, 0.5 / v_max * 6.0, 0.15 * u.windup_rad,
        ]
    )  # fmt: skip
    out = np.empty((6, n * finer))
    _integrate(
        par, ref, build.te_in, build.te_mid, build.te_out, build.stiff, build.dent_right,
        build.dent_left, u.ripple, u.cog, dt, out,
    )  # fmt: skip
    out = out[:, ::finer]
    return Run(*(out[i] for i in range(6)))


def healthy(unit: Unit) -> Build:
    """The gearbox as new."""
    none = np.zeros(TABLE)
    return Build(
        unit=unit,
        gap_out=unit.play_new_rad,
        gap_in=0.25 * unit.play_new_rad,
        coulomb=unit.coulomb_nm,
        stribeck=unit.stribeck,
        te_in=unit.te_in,
        te_mid=unit.te_mid,
        te_out=unit.te_out,
        stiff=unit.stiff,
        dent_right=none,
        dent_left=none,
    )


def worsen(
    build: Build,
    fault: str,
    *,
    rng: np.random.Generator,
    size: float | None,
    span: tuple[float, float],
    modern: bool,
) -> None:
    """Work one fault into `build`.

    size: play's added gap or notch's depth [rad at the output], 0..1 for the others; None draws it.
    span: lowest and highest commanded output angle [rad]; the damaged tooth lies within.
    """
    u = build.unit
    d = u.design
    x = np.arange(TABLE) * (2 * np.pi / TABLE)
    if fault == "play":
        lo, hi = (f * u.windup_rad for f in d.play)
        gap = float(np.exp(rng.uniform(np.log(lo), np.log(hi)))) if size is None else size
        if d.play_in:
            build.gap_in = build.gap_in + gap
        else:
            build.gap_out = build.gap_out + gap
        build.sizes["play"] = gap
        return
    if fault == "notch":
        lo, hi = (f * u.windup_rad for f in d.notch)
        depth = float(np.exp(rng.uniform(np.log(lo), np.log(hi)))) if size is None else size
        at = span[0] + (span[1] - span[0]) * rng.uniform(0.2, 0.8)
        teeth = 40 if d.z_out > 120 else d.z_out
        width = 2 * np.pi / teeth * rng.uniform(*d.notch_width)
        xo = np.arange(TABLE_OUT) * (2 * np.pi / TABLE_OUT)
        off = (xo - at + np.pi) % (2 * np.pi) - np.pi
        if modern:  # broken flank: steep edge on one side, slope on the other, less stiff
            rise, fall = 0.2 * width, 0.5 * width
            shape = np.clip((off + 0.5 * width) / rise, 0, 1) * np.clip((0.5 * width - off) / fall, 0, 1)
            build.stiff = build.stiff * (1 - 0.3 * shape)
        else:

            def hump(centre: float, wide: float) -> Floats:
                y = off - centre
                return np.where(np.abs(y) < wide / 2, 0.5 + 0.5 * np.cos(2 * np.pi * y / wide), 0)

            # a pit with the burr that it has thrown up on both sides
            burr = rng.uniform(0.0, 0.1)
            shape = hump(0.0, width)
            for centre in (-0.6 * width, 0.6 * width):
                shape = shape - burr * hump(centre, 0.5 * width)
        other = rng.uniform(0.5, 1.0)
        sides = (1.0, other) if rng.random() < 0.5 else (other, 1.0)
        build.dent_right = depth * sides[0] * shape
        build.dent_left = depth * sides[1] * shape
        build.sizes["notch"] = depth
        build.notch_angle = float(at)
        return
    level = float(rng.uniform(0.15, 1.0)) if size is None else size
    build.sizes[fault] = level
    if fault == "bearing":
        inner = rng.random() < 0.5
        contact = rng.uniform(0.15, 0.28)
        order = 0.5 * d.balls * (1 + contact if inner else 1 - contact)
        # order per motor turn, amplitude over nominal torque, load zone depth, slip
        build.impacts = (order, 0.7 * level, 0.9 if inner else 0.15, rng.uniform(0.006, 0.02))
    elif fault == "wear":
        for name, z in (("te_in", d.z_in), ("te_mid", d.z_mid)):
            table = getattr(build, name)
            mesh = float(np.std(table))
            more = np.zeros(TABLE)
            for h in range(1, 7):
                a = mesh * rng.uniform(0.5, 1.5) * h**-0.7
                side = 1 + 0.6 * np.sin(x + rng.uniform(0, 6.28))
                more += 0.4 * a * side * np.sin(h * z * x + rng.uniform(0, 6.28))
            setattr(build, name, table + (0.6 + 3.0 * level) * more)
        build.gap_out *= 1 + level
        build.stiff = 1 + (build.stiff - 1) * (1 + 2 * level)
    elif fault == "dry":
        build.coulomb *= 1 + 1.0 * level
        build.stribeck += 1.2 * level
        build.stick_speed = 0.05
        build.rub_gain = 1.2 + 2.3 * level
        build.rub_mesh = 0.9
    elif fault == "misaligned":
        a = float(np.std(build.te_in)) * (0.8 + 6 * level)
        p1, p2 = rng.uniform(0, 6.28, 2)
        wobble = 1 + 0.7 * level * np.sin(x + p1)
        build.te_in = build.te_in * wobble + a * (0.6 * np.sin(x + p1) + np.sin(2 * x + p2))
        build.te_mid = build.te_mid * (1 + 0.5 * level)
        build.radial = (0.1 * level, 0.2 * level)
    elif fault == "loose":
        # how far above the lifting threshold the part is shaken, and what its blows weigh
        build.rattle = (float(0.5 + 1.0 * (1 - level)), 0.5 + level)
    else:
        raise ValueError(f"no fault {fault!r}")
