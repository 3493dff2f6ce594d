"""From a `Chain` and its drive to the flat arrays of `sim.chain.kernel`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim import laws
from sim.chain import kernel
from sim.chain.model import Array, Chain, ChainError, Drive, Servo
from sim.chain.rows import dent_rows, line_rows, link_row, shaft_row

MAX_SHAFTS = 4


def pack(chain: Chain) -> tuple[Array, NDArray[np.int64]]:
    """The arrays `p` and `q` of the kernel. Raises ChainError for another number of shafts, or what is not finite."""
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
    _append(rows, q, kernel.WAVES, [line_rows(link.stiffness_waves) for link in chain.links])
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
