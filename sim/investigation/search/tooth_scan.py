"""Where on a wheel a local fault would explain most: matched filter along the angle, through the linear drive train.

While the flanks touch, a small displacement e(t) in mesh k reaches motor torque and load through a linear filter
H_k(f). Correlating the whitened residual with the whitened H_k once gives, for every instant, what a displacement
there would explain; summing over the passages of an angle scans all teeth at the price of a few Fourier transforms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import freqz

from sim.chain.model import Array, Chain
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.observer import GUIDE_RAD_S

Complex = NDArray[np.complex128]
SPEEDS = 12


@dataclass(frozen=True)
class ToothPosition:
    """A local fault that a scan proposes; `gain` is the drop of the whitened sum of squares it promises."""

    link: int
    flank: int
    angle_rad: float
    half_width_rad: float
    depth_rad: float
    gain: float


def displacement_response(chain: Chain, frequency_hz: Array, guide: tuple[float, float]) -> tuple[Complex, Complex]:
    """Motor torque and guide torque per displacement in each mesh, shapes (links, f) [N m/rad]."""
    m = len(chain.links)
    s = 2j * np.pi * frequency_hz
    matrix = np.zeros((frequency_hz.size, m, m), dtype=complex)
    force = np.zeros((m, frequency_hz.size), dtype=complex)
    for k, link in enumerate(chain.links):
        z = link.stiffness_n_m_per_rad + link.damping_n_m_s_per_rad * s
        force[k] = z
        matrix[:, k, k] += chain.shafts[k + 1].inertia_kg_m2 * s**2 + chain.shafts[k + 1].viscous_n_m_s * s + z
        if k:
            matrix[:, k - 1, k - 1] += z / link.ratio**2
            matrix[:, k - 1, k] -= z / link.ratio
            matrix[:, k, k - 1] -= z / link.ratio
    pull = guide[0] + guide[1] * s
    matrix[:, m - 1, m - 1] += pull
    torque = np.zeros((m, frequency_hz.size), dtype=complex)
    drawn = np.zeros_like(torque)
    for k, link in enumerate(chain.links):
        right = np.zeros((frequency_hz.size, m), dtype=complex)
        right[:, k] = -force[k]
        if k:
            right[:, k - 1] = force[k] / link.ratio
        angle = np.linalg.solve(matrix, right[..., None])[..., 0]
        first = chain.links[0]
        torque[k] = (-force[0] * angle[:, 0] - (force[0] if k == 0 else 0.0)) / first.ratio
        drawn[k] = -pull * angle[:, m - 1]
    return torque, drawn


def scan(
    problem: Problem, terms: Sequence[Term], values: Mapping[str, float], teeth: Mapping[int, int]
) -> list[ToothPosition]:
    """Best place per link and flank where the model is off with these numbers; `teeth` of the driven gear by link."""
    m = problem.measurement
    chain = problem.chain(terms, values)
    torque, guide = problem.raw_residuals(terms, values)
    stride = m.load_stride
    count = torque.size // stride * stride
    frequency = np.asarray(np.fft.rfftfreq(count, 1.0 / m.rate_hz), dtype=np.float64)
    inertia = problem.observer.guide_inertia
    gains = (inertia * GUIDE_RAD_S**2, 1.4 * inertia * GUIDE_RAD_S) if problem.guided else (0.0, 0.0)
    to_torque, to_guide = displacement_response(chain, frequency, gains)
    to_guide *= m.passed_at_load(frequency)
    whitened = problem.white((torque, guide))
    first = np.fft.rfft(whitened[:count])
    turn = 2.0 * np.pi * frequency / m.rate_hz
    filter_torque = to_torque * freqz(problem.noise.torque, worN=turn)[1]
    second = np.zeros(0, dtype=complex)
    if guide.size:
        second = np.fft.rfft(whitened[torque.size : torque.size + count // stride])
        slow = freqz(problem.noise.guide, worN=turn[: second.size] * stride)[1]
    places = []
    load = np.sign(torque_sign(problem, chain))[:count]
    for k, number in teeth.items():
        spectrum = np.conj(filter_torque[k]) * first
        power = np.abs(filter_torque[k]) ** 2
        if guide.size:
            response = to_guide[k, : second.size] * slow
            spectrum[: second.size] -= np.conj(response) * second  # the guide's torque is itself the residual
            power[: second.size] += np.abs(response) ** 2 / stride
        match = np.fft.irfft(spectrum, count)
        ratio = math.prod(link.ratio for link in chain.links[: k + 1])
        angle, speed = m.angle[:count] / ratio, m.speed[:count] / ratio
        moving = (m.moving * m.valid)[:count] > 0.5
        for flank in (1, -1):
            places += _best(k, flank, number, angle, speed, match, moving & (load == flank), frequency, power)
    return places


def torque_sign(problem: Problem, chain: Chain) -> Array:
    """Torque that the first mesh transmits [N m]: which flank carries."""
    m = problem.measurement
    shaft = chain.shafts[0]
    friction = shaft.coulomb_n_m * np.sign(m.speed) + shaft.viscous_n_m_s * m.speed
    width = max(3, int(0.02 * m.rate_hz) | 1)
    smoothed = np.convolve(m.torque, np.ones(width) / width, "same")
    return np.asarray(smoothed - shaft.inertia_kg_m2 * m.slow_acceleration - friction, dtype=np.float64)


def _best(
    k: int, flank: int, teeth: int, angle: Array, speed: Array, match: Array, used: NDArray[np.bool_],
    frequency: Array, power: Array,
) -> list[ToothPosition]:  # fmt: skip
    pitch = 2.0 * math.pi / teeth
    bins = max(1024, 16 * teeth)
    index = np.floor((angle[used] % (2.0 * math.pi)) / (2.0 * math.pi) * bins).astype(np.int64) % bins
    matched = np.bincount(index, flank * match[used], bins)
    out = []
    top = float(np.abs(speed).max())
    grid = top * np.linspace(0.05, 1.0, SPEEDS)
    for half in (0.5 * pitch, pitch, 2.0 * pitch):
        level = np.interp(np.abs(speed[used]), grid, [_pulse_power(half, v, frequency, power) for v in grid])
        energy = np.bincount(index, level, bins)
        u = (np.arange(bins) - bins // 2) / bins * 2.0 * math.pi / half
        bump = np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 4, 0.0)
        kernel = np.fft.rfft(np.fft.ifftshift(bump))
        square = np.fft.rfft(np.fft.ifftshift(bump**2))
        inner = np.fft.irfft(np.fft.rfft(matched) * kernel, bins)
        norm = np.maximum(np.fft.irfft(np.fft.rfft(energy) * square, bins), 1e-300)
        enough = norm > 0.05 * norm.max()
        gain = np.where((inner > 0.0) & enough, inner**2 / norm, 0.0)
        at = int(np.argmax(gain))
        if gain[at] > 0.0:
            centre = (at + 0.5) / bins * 2.0 * math.pi
            out.append(ToothPosition(k, flank, centre, half, float(inner[at] / norm[at]), float(gain[at])))
    return out


def _pulse_power(half: float, speed: float, frequency: Array, power: Array) -> float:
    """Mean of |H W|^2 over the spectrum of one passage of a dent at `speed`."""
    width = half / speed
    x = frequency * width
    spectrum = np.exp(-2.0 * (1.05 * x) ** 2 * 2.0)  # (1 - u^2)^4 is nearly a Gaussian of sigma 0.33
    return float((spectrum * power).sum() / spectrum.sum())
