"""Engine 2: simulate shafts in series with everything that is not affine (equations: `sim.torsional.model`)."""

from __future__ import annotations

import math

import numpy as np

from sim.torsional.laws import COULOMB_F, DRIFT, friction
from sim.torsional.model import Array, Chain, ChainError, ChainResult, Drive, PrescribedMotion, Servo
from sim.torsional.rows import shaft_row

LOG_ROWS = 20_000
START_SAMPLES = 101
MAX_SAMPLES = 200_000_000


def run_chain(
    chain: Chain,
    drive: Drive,
    sample_rate_hz: float,
    samples: int,
    *,
    substeps: int | None = None,
    start: Array | None = None,
    light: bool = False,
    watch: Array | None = None,
) -> ChainResult:
    """Integrate `samples` output rows at `sample_rate_hz`; inputs given as samples have the same rate.

    `start`: angles then speeds, shape (2 shafts,); default `steady_start` of a prescribed motion or servo, else rest.
    `substeps` per sample: default `stable_substeps`. `light` keeps load angle and motor torque only.
    `watch`: five numbers, of which the last tells another thread the fraction that is done.
    Raises ChainError for a wrong chain, drive or size before any work.
    """
    from sim.torsional import kernel as chain_kernel
    from sim.torsional.packing import checked, pack, pack_drive

    p, q = pack(chain)
    n = len(chain.shafts)
    _check_run(sample_rate_hz, samples)
    substeps = stable_substeps(chain, sample_rate_hz) if substeps is None else substeps
    if not 1 <= substeps <= 10_000:
        raise ChainError(f"substeps: needs 1 to 10000, got {substeps}")
    kind, coefficients, motion, servo, reference = pack_drive(drive, sample_rate_hz, samples)
    q[1] = kind
    p[chain_kernel.DRIVE : chain_kernel.DRIVE + 8] = coefficients
    state = np.zeros(11)
    first = _default_start(chain, drive, sample_rate_hz) if start is None else checked("start", start, (2 * n,))
    state[:n], state[4 : 4 + n] = first[:n], first[n:]
    width = drive.friction_width_rad_s if isinstance(drive, PrescribedMotion) else 1.0
    tolerance = 1e-12 * max([1.0, *(link.stiffness_n_m_per_rad for link in chain.links)])
    grid = np.zeros(5) if watch is None else watch
    grid[:4] = sample_rate_hz, substeps, width, tolerance
    angle = np.empty((samples, 1 if light else n))
    speed = np.empty((samples, 0 if light else n))
    acceleration = np.empty((samples, 0 if light else n))
    force = np.empty((samples, 0 if light else len(chain.links)))
    torque = np.empty(samples)
    log = np.empty((0 if light else LOG_ROWS, 5))
    while True:
        count, unresolved = chain_kernel.run(
            p.copy(), q.copy(), motion, servo, reference, grid, state,
            log, angle, speed, acceleration, force, torque,
        )  # fmt: skip
        if light or count <= len(log):
            break
        log = np.empty((count, 5))
    return ChainResult(
        sample_rate_hz, angle, speed, acceleration, force, torque, count, unresolved, log[: 0 if light else count]
    )


def _check_run(sample_rate_hz: float, samples: int) -> None:
    if not (math.isfinite(sample_rate_hz) and sample_rate_hz > 0):
        raise ChainError(f"sample_rate_hz: must be > 0, got {sample_rate_hz}")
    if not 2 <= samples <= MAX_SAMPLES:
        raise ChainError(f"samples: needs 2 to {MAX_SAMPLES}, got {samples}; simulate longer runs in pieces")


def _default_start(chain: Chain, drive: Drive, rate: float) -> Array:
    if isinstance(drive, PrescribedMotion):
        return _smooth_start(chain, drive.motion, rate)
    if isinstance(drive, Servo):
        return steady_start(chain, float(drive.reference[0, 0]), float(drive.reference[1, 0]))
    return np.zeros(2 * len(chain.shafts))


def _smooth_start(chain: Chain, motion: Array, rate: float) -> Array:
    """Measured angles are noisy: speed and acceleration at the start are those of a parabola over its first samples."""
    angle = motion[0, :START_SAMPLES]
    curve = np.polynomial.Polynomial.fit(np.arange(angle.size) / rate, angle, 2)
    return steady_start(chain, float(angle[0]), float(curve.deriv()(0.0)), float(curve.deriv(2)(0.0)))


def stable_substeps(chain: Chain, sample_rate_hz: float, largest_phase: float = 0.5) -> int:
    """Steps per sample for which (fastest torsional mode or damping rate) * step <= `largest_phase`.

    At 0.5 the Runge-Kutta phase error of that fastest mode is 0.5^4 / 120 = 5e-4; it falls with the fourth power.
    """
    n = len(chain.shafts)
    stiffness = np.zeros((n, n))
    damping = np.zeros((n, n))
    for k, link in enumerate(chain.links):
        twist = np.zeros(n)
        twist[k], twist[k + 1] = 1.0 / link.ratio, -1.0
        hardest = link.stiffness_n_m_per_rad * (1.0 + sum(abs(wave.amplitude) for wave in link.stiffness_waves))
        hardest += link.hysteresis_n_m / link.hysteresis_rad
        stiffness += hardest * np.outer(twist, twist)
        damping += link.damping_n_m_s_per_rad * np.outer(twist, twist)
    inertia = np.array([shaft.inertia_kg_m2 for shaft in chain.shafts])
    for k, shaft in enumerate(chain.shafts):
        damping[k, k] += max(shaft.viscous_n_m_s, shaft.viscous_backward_n_m_s or 0.0)
    root = np.sqrt(inertia)
    scale = np.outer(root, root)
    fastest = math.sqrt(max(float(np.linalg.eigvalsh(stiffness / scale)[-1]), 0.0))
    decay = float(np.linalg.eigvalsh(damping / scale)[-1])
    return max(1, math.ceil(max(fastest, decay) / (sample_rate_hz * largest_phase)))


def steady_start(
    chain: Chain, angle_rad: float, speed_rad_s: float, acceleration_rad_s2: float = 0.0, known_n_m: float = 0.0
) -> Array:
    """Angles and speeds (2 shafts,) with the first shaft in steady motion, each twist in balance with its load.

    `known_n_m`: torque that the load is known to ask for besides.
    """
    n = len(chain.shafts)
    ratios = np.cumprod([1.0, *(link.ratio for link in chain.links)])
    speed = speed_rad_s / ratios
    angle = angle_rad / ratios
    way = float(np.sign(speed_rad_s))
    twist = np.zeros(n)
    load = known_n_m
    for k in range(n - 1, 0, -1):
        shaft, link = chain.shafts[k], chain.links[k - 1]
        at = (*shaft_row(shaft)[COULOMB_F : DRIFT + 1], float(speed[k]), way, 0.0)
        load += friction(*at) - shaft.offset_n_m
        load += shaft.inertia_kg_m2 * acceleration_rad_s2 / ratios[k]
        load += shaft.gravity_n_m * math.sin(angle[k] + shaft.gravity_phase_rad)
        error = sum(e.amplitude * math.sin(e.order * angle[e.shaft] + e.phase_rad) for e in link.errors)
        twist[k] = load / link.stiffness_n_m_per_rad + 0.5 * link.gap_rad * float(np.sign(load)) + error
        load /= link.ratio
    for k in range(1, n):
        angle[k] = angle[k - 1] / chain.links[k - 1].ratio - twist[k]
    return np.concatenate([angle, speed])
