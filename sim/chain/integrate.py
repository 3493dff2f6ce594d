"""Simulate shafts in series with everything that is not affine (equations: `sim.chain.model`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim import laws
from sim.chain.model import Array, Chain, ChainError, ChainResult, Drive, Servo
from sim.chain.rows import dent_rows, line_rows, link_row, shaft_row
from sim.errors import RunError
from sim.laws import COULOMB_F, DRIFT, friction
from sim.residual import INSTANTS, SMALLEST, TOLERANCE, Residual, check_finite, instants

MAX_SHAFTS = 4


def pack(chain: Chain) -> tuple[Array, NDArray[np.int64]]:
    """The arrays `p` and `q` of the kernel. Raises ChainError for another number of shafts, or what is not finite."""
    from sim.chain import kernel

    n = len(chain.shafts)
    if not 1 <= n <= MAX_SHAFTS or len(chain.links) != n - 1:
        raise ChainError(
            f"shafts: 1 to {MAX_SHAFTS} with a link between each two, got {n} and {len(chain.links)} links"
        )
    p = np.zeros(kernel.ROWS)
    q = np.zeros(kernel.Q_SIZE, dtype=np.int64)
    q[kernel.SHAFTS] = n
    for k, shaft in enumerate(chain.shafts):
        row = shaft_row(shaft)
        row[laws.J] = 1 / row[laws.J] if row[laws.J] > 0 else math.nan
        p[kernel.WIDTH * k : kernel.WIDTH * k + len(row)] = row
    for k, link in enumerate(chain.links):
        first = kernel.LINKS + kernel.WIDTH * k
        row = link_row(link)
        p[first : first + len(row)] = row
    rows = [p]
    ripples = [row for k, shaft in enumerate(chain.shafts) for row in line_rows(shaft.ripples, k)]
    _append(rows, q, kernel.RIPPLES, [ripples])
    _append(rows, q, kernel.LINES, [line_rows(link.errors) for link in chain.links])
    _append(rows, q, kernel.DENTS, [dent_rows(link.dents) for link in chain.links])
    packed = np.concatenate(rows)
    if not np.isfinite(packed).all():
        raise ChainError("every number of a chain must be finite, and every inertia > 0")
    return packed, q


def _append(rows: list[Array], q: NDArray[np.int64], slot: int, groups: Sequence[list[tuple[float, ...]]]) -> None:
    position = sum(row.size for row in rows)
    q[slot] = position
    for i, group in enumerate(groups):
        rows.extend(np.array(row) for row in group)
        position += laws.ROW * len(group)
        q[slot + i + 1] = position


def pack_drive(drive: Drive, rate: float, samples: int) -> tuple[int, Array, Array, Array, Array]:
    """(kind, coefficients, given torque, servo, reference) of the kernel."""
    from sim.chain import kernel

    coefficients, nothing, servo = np.zeros(8), np.zeros((3, 1)), np.zeros(6)
    if isinstance(drive, Servo):
        gains = (drive.position_gain_per_s, drive.speed_gain_n_m_s, 1 / (rate * drive.integral_time_s))
        servo[:] = *gains, drive.speed_limit_rad_s, drive.torque_limit_n_m, drive.feed_forward
        return kernel.SERVO, coefficients, nothing, servo, checked("reference", drive.reference, (3, samples))
    coefficients[0], coefficients[2] = drive.offset_n_m, drive.amplitude_n_m
    coefficients[3], coefficients[4] = 2 * math.pi * drive.frequency_hz, drive.phase_rad
    if drive.samples_n_m is None:
        return kernel.TORQUE, coefficients, nothing, servo, nothing
    torque = checked("samples_n_m", drive.samples_n_m, (samples,)) + drive.offset_n_m
    return kernel.TORQUE, coefficients, torque[np.newaxis], servo, nothing


def checked(name: str, values: Array, shape: tuple[int, ...]) -> Array:
    """Finite float64 numbers of `shape`, or a ChainError that says what came."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ChainError(f"{name}: must be finite numbers of shape {shape}, got shape {array.shape}")
    return array


LOG_ROWS = 20_000
STICK = 1  # in the log
LINK, ALL = 0, 4  # rows of residuals that are of links, and of all shafts
WORDS = (
    "its torque is not that of its law",
    "the torques do not balance",
    "it sticks beyond its friction",
    "a sample does not follow from the one before",
    "the balance of energy is not fulfilled",
)
MAX_SAMPLES = 200_000_000
Names = Callable[[int, bool], str]


def run_chain(
    chain: Chain,
    drive: Drive,
    sample_rate_hz: float,
    samples: int,
    *,
    substeps: int | None = None,
    start: Array | None = None,
    watch: Array | None = None,
    names: Names | None = None,
) -> ChainResult:
    """Integrate `samples` output rows at `sample_rate_hz`; inputs given as samples have the same rate.

    `start`: angles then speeds, shape (2 shafts,); default `steady_start` of a servo, else rest. `substeps` per sample:
    default `stable_substeps`.
    `watch`: one number, which becomes the fraction that is done, for another thread to look at.
    `names` gives that of a shaft or, where its second argument is true, of a link for the words of errors.
    Raises ChainError for a wrong chain, drive or size before any work, RunError for a result that does not obey its
    equations.
    """
    from sim.chain import kernel

    p, q = pack(chain)
    n = len(chain.shafts)
    _check_run(sample_rate_hz, samples)
    substeps = stable_substeps(chain, sample_rate_hz) if substeps is None else substeps
    if not 1 <= substeps <= 10_000:
        raise ChainError(f"substeps: needs 1 to 10000, got {substeps}")
    kind, coefficients, given, servo, reference = pack_drive(drive, sample_rate_hz, samples)
    q[1] = kind
    p[kernel.DRIVE : kernel.DRIVE + 8] = coefficients
    state = np.zeros(11)
    if start is None and isinstance(drive, Servo):
        start = steady_start(chain, float(drive.reference[0, 0]), float(drive.reference[1, 0]))
    first = np.zeros(2 * n) if start is None else checked("start", start, (2 * n,))
    state[:n], state[4 : 4 + n] = first[:n], first[n:]
    tolerance = 1e-12 * max([1.0, *(link.stiffness_n_m_per_rad for link in chain.links)])
    grid = np.array([sample_rate_hz, substeps, tolerance])
    watch = np.zeros(1) if watch is None else watch
    angle, speed, acceleration = (np.empty((samples, n)) for _ in range(3))
    force = np.empty((samples, n - 1))
    torque = np.empty(samples)
    log = np.empty((max(LOG_ROWS, samples // 16), 5))
    while True:
        count, unresolved = kernel.run(
            p.copy(), q.copy(), given, servo, reference, grid, watch, state,
            log, angle, speed, acceleration, force, torque,
        )  # fmt: skip
        if count <= len(log):
            break
        log = np.empty((count, 5))
    if unresolved:
        raise RunError(f"events storm in {unresolved} steps; is a stiffness, a damping or a gap out of all proportion?")
    time = np.arange(samples) / sample_rate_hz
    result = ChainResult(time, angle, speed, acceleration, force, torque, log[:count])
    return replace(result, residual=_check(p, q, given, grid, result, names))


def _check(
    p: Array, q: NDArray[np.int64], given: Array, grid: Array, result: ChainResult, names: Names | None
) -> Residual:
    """Hold a result against the equations at `instants`; raise RunError where it does not obey them."""
    from sim.chain import equations
    from sim.chain.kernel import DRIVE, KIND, SERVO

    rate, time = float(grid[0]), result.time_s
    for values in (result.angle_rad, result.speed_rad_s):
        check_finite(time, values, lambda k: _named(names, equations.FLOW, k))
    at = _instants(len(time), rate, result.log)
    if q[KIND] == SERVO:
        ends = np.repeat(result.motor_torque_n_m[at, None], 2, axis=1)
    elif given.shape[1] > 1:
        ends = np.stack([given[0, at], given[0, at + 1]], axis=1)
    else:
        ends = np.full((len(at), 2), p[DRIVE])
    events = result.log[:, 0]
    quiet = np.searchsorted(events, time[at] - 1e-12) == np.searchsorted(events, time[at + 1] + 1e-12)
    motion = result.angle_rad, result.speed_rad_s, result.acceleration_rad_s2, result.force_n_m
    found, sizes = equations.residuals(at, quiet, ends, rate, int(grid[1]), *motion, p, q)
    sizes = np.maximum(sizes, SMALLEST * np.maximum(sizes.max(axis=1, keepdims=True), SMALLEST))
    share = found / sizes[:, None, :]
    if not share.max() <= TOLERANCE:
        kind, instant, column = (int(i) for i in np.unravel_index(int(np.argmax(share)), share.shape))
        raise RunError(
            f"{_named(names, kind, column)}: {WORDS[kind]} at {time[at[instant]]:.9g} s "
            f"(residual {share.max():.1e}, at most {TOLERANCE:g})"
        )
    force, balance, limit, flow, energy = share.max(axis=(1, 2)).tolist()
    return Residual(max(force, balance), limit, float("nan"), flow, energy)


def _instants(samples: int, rate: float, log: Array) -> NDArray[np.int64]:
    """Samples that are looked at: evenly spread, but for a quarter that are the last before a shaft breaks away."""
    releases = log[(log[:, 1] == STICK) & (log[:, 3] == 0.0), 0]
    chosen = releases[np.linspace(0, len(releases) - 1, min(len(releases), INSTANTS // 4)).astype(np.int64)]
    last = np.clip(np.ceil(chosen * rate).astype(np.int64) - 1, 0, samples - 2)
    return np.union1d(instants(samples)[len(chosen) :], last)


def _named(names: Names | None, kind: int, column: int) -> str:
    if kind == ALL:
        return "all shafts"
    link = kind == LINK
    return names(column, link) if names else f"{'link' if link else 'shaft'} {column}"


def _check_run(sample_rate_hz: float, samples: int) -> None:
    if not (math.isfinite(sample_rate_hz) and sample_rate_hz > 0):
        raise ChainError(f"sample_rate_hz: must be > 0, got {sample_rate_hz}")
    if not 2 <= samples <= MAX_SAMPLES:
        raise ChainError(f"samples: needs 2 to {MAX_SAMPLES}, got {samples}")


def stable_substeps(chain: Chain, sample_rate_hz: float, largest_phase: float = 0.1) -> int:
    """Steps per sample for which (fastest torsional mode or damping rate) * step <= `largest_phase`.

    At 0.1 the Runge-Kutta phase error of that fastest mode is 0.1^4 / 120 = 8e-7; it falls with the fourth power.
    """
    n = len(chain.shafts)
    stiffness = np.zeros((n, n))
    damping = np.zeros((n, n))
    for k, link in enumerate(chain.links):
        twist = np.zeros(n)
        twist[k], twist[k + 1] = 1.0 / link.ratio, -1.0
        hardest = link.stiffness_n_m_per_rad + link.hysteresis_n_m / link.hysteresis_rad
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
