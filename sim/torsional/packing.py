"""From a `Chain` and its drive to the flat arrays of `sim.torsional.kernel`; every parameter is checked, by name."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim import laws
from sim.rotational.components.elasto_backlash import CONTACT_LAWS
from sim.torsional import kernel
from sim.torsional.model import (
    CLOCK,
    Array,
    Chain,
    ChainError,
    Dent,
    Drive,
    Line,
    Link,
    Servo,
    Shaft,
)
from sim.torsional.rows import dent_rows, line_rows, link_row, shaft_row

MAX_SHAFTS = 4


def pack(chain: Chain) -> tuple[Array, NDArray[np.int64]]:
    """The arrays `p` and `q` of the kernel. Raises ChainError naming the first wrong parameter."""
    n = len(chain.shafts)
    if not 1 <= n <= MAX_SHAFTS:
        raise ChainError(f"shafts: 1 to {MAX_SHAFTS} can be simulated, got {n}")
    if len(chain.links) != n - 1:
        raise ChainError(f"links: {n} shafts need {n - 1}, got {len(chain.links)}")
    p = np.zeros(kernel.ROWS)
    q = np.zeros(kernel.Q_SIZE, dtype=np.int64)
    q[kernel.SHAFTS] = n
    for k, shaft in enumerate(chain.shafts):
        _place(p, kernel.WIDTH * k, f"shafts[{k}]", _pack_shaft(f"shafts[{k}]", shaft))
    for k, link in enumerate(chain.links):
        _place(p, kernel.LINKS + kernel.WIDTH * k, f"links[{k}]", _pack_link(f"links[{k}]", link))
    rows = [p]
    ripples = [
        row
        for k, shaft in enumerate(chain.shafts)
        for row in _lines(f"shafts[{k}].ripples", shaft.ripples, n, k, first=CLOCK)
    ]
    _append(rows, q, kernel.RIPPLES, [ripples])
    _append(rows, q, kernel.LINES, [_lines(f"links[{k}].errors", link.errors, n) for k, link in enumerate(chain.links)])
    waves = [_lines(f"links[{k}].stiffness_waves", link.stiffness_waves, n) for k, link in enumerate(chain.links)]
    _append(rows, q, kernel.WAVES, waves)
    _append(rows, q, kernel.DENTS, [_dents(f"links[{k}].dents", link.dents, n) for k, link in enumerate(chain.links)])
    return np.concatenate(rows), q


def _place(p: Array, offset: int, where: str, values: list[float]) -> None:
    if not all(map(math.isfinite, values)):
        raise ChainError(f"{where}: every parameter must be finite")
    p[offset : offset + len(values)] = values


def _append(rows: list[Array], q: NDArray[np.int64], slot: int, groups: Sequence[list[tuple[float, ...]]]) -> None:
    position = sum(row.size for row in rows)
    q[slot] = position
    for i, group in enumerate(groups):
        rows.extend(np.array(row) for row in group)
        position += laws.ROW * len(group)
        q[slot + i + 1] = position


def _lines(where: str, lines: Sequence[Line], n: int, acts_on: int = 0, first: int = 0) -> list[tuple[float, ...]]:
    for line in lines:
        numbers = (line.order, line.amplitude, line.phase_rad)
        if not (first <= line.shaft < n and all(map(math.isfinite, numbers))):
            raise ChainError(f"{where}: shaft must be {first} to {n - 1} and every number finite, got {line}")
    return line_rows(lines, acts_on)


def _dents(where: str, dents: Sequence[Dent], n: int) -> list[tuple[float, ...]]:
    for dent in dents:
        numbers = (dent.angle_rad, dent.half_width_rad, dent.depth_rad, dent.form)
        if not (0 <= dent.shaft < n and all(map(math.isfinite, numbers)) and dent.half_width_rad > 0):
            raise ChainError(f"{where}: shaft must be 0 to {n - 1}, half_width_rad > 0, numbers finite, got {dent}")
        if dent.flank not in (-1, 1) or dent.depth_rad < 0 or not dent.form > 1:
            raise ChainError(f"{where}: flank must be 1 or -1, depth_rad >= 0 and form > 1, got {dent}")
    return dent_rows(dents)


def _pack_shaft(where: str, shaft: Shaft) -> list[float]:
    row = shaft_row(shaft)
    back_coulomb, back_viscous = row[laws.COULOMB_B], row[laws.VISCOUS_B]
    if not shaft.inertia_kg_m2 > 0:
        raise ChainError(f"{where}.inertia_kg_m2: must be > 0, got {shaft.inertia_kg_m2}")
    for name, value in (
        ("coulomb", min(shaft.coulomb_n_m, back_coulomb)),
        ("viscous", min(shaft.viscous_n_m_s, back_viscous)),
    ):
        if not value >= 0:
            raise ChainError(f"{where}.{name}: friction must be >= 0, got {value}")
    if not shaft.stribeck_n_m >= -min(shaft.coulomb_n_m, back_coulomb):
        raise ChainError(
            f"{where}.stribeck_n_m: friction at standstill must be >= 0, got {shaft.stribeck_n_m} on Coulomb"
        )
    if not shaft.stribeck_speed_rad_s > 0:
        raise ChainError(f"{where}.stribeck_speed_rad_s: must be > 0, got {shaft.stribeck_speed_rad_s}")
    row[laws.J] = 1 / row[laws.J]
    return row


def _pack_link(where: str, link: Link) -> list[float]:
    if not (math.isfinite(link.ratio) and link.ratio != 0):
        raise ChainError(f"{where}.ratio: must be finite and not 0, got {link.ratio}")
    for name in ("stiffness_n_m_per_rad", "hysteresis_rad"):
        if not getattr(link, name) > 0:
            raise ChainError(f"{where}.{name}: must be > 0, got {getattr(link, name)}")
    for name in ("damping_n_m_s_per_rad", "gap_rad", "hysteresis_n_m", "loss_fraction", "cubic_per_rad2"):
        if not getattr(link, name) >= 0:
            raise ChainError(f"{where}.{name}: must be >= 0, got {getattr(link, name)}")
    if not all(0 < value <= 1 for value in link.efficiency) or not link.loss_fraction < 1:
        raise ChainError(f"{where}.efficiency: must be in (0, 1] and loss_fraction < 1, got {link.efficiency}")
    if not all(value >= 0 for value in link.bearing_n_m):
        raise ChainError(f"{where}.bearing_n_m: must be >= 0, got {link.bearing_n_m}")
    if link.law not in CONTACT_LAWS:
        raise ChainError(f"{where}.law: must be one of {', '.join(CONTACT_LAWS)}, got {link.law!r}")
    return link_row(link)


def checked(name: str, values: Array, shape: tuple[int, ...]) -> Array:
    """Finite float64 numbers of `shape`, or a ChainError that says what came."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape:
        raise ChainError(f"{name}: needs shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ChainError(f"{name}: must be finite, but value {int(np.argmin(np.isfinite(array)))} is not")
    return array


def pack_drive(drive: Drive, rate: float, samples: int) -> tuple[int, Array, Array, Array, Array]:
    """(kind, coefficients, given torque, servo, reference) of the kernel."""
    coefficients = np.zeros(8)
    nothing = np.zeros((3, 1))
    servo = np.zeros(6)
    if isinstance(drive, Servo):
        gains = (drive.position_gain_per_s, drive.speed_gain_n_m_s, drive.speed_limit_rad_s, drive.torque_limit_n_m)
        if not (all(gain > 0 for gain in gains) and drive.integral_time_s > 0):
            raise ChainError("servo: gains, limits and integral time must be > 0")
        servo[:] = gains[0], gains[1], 1 / (rate * drive.integral_time_s), gains[2], gains[3], drive.feed_forward
        return kernel.SERVO, coefficients, nothing, servo, checked("reference", drive.reference, (3, samples))
    coefficients[0], coefficients[2] = drive.offset_n_m, drive.amplitude_n_m
    coefficients[3], coefficients[4] = 2 * math.pi * drive.frequency_hz, drive.phase_rad
    if not np.isfinite(coefficients).all():
        raise ChainError("torque: amplitude, frequency, phase and offset must be finite")
    if drive.samples_n_m is None:
        return kernel.TORQUE, coefficients, nothing, servo, nothing
    torque = checked("samples_n_m", drive.samples_n_m, (samples,)) + drive.offset_n_m
    return kernel.TORQUE, coefficients, torque[np.newaxis], servo, nothing
