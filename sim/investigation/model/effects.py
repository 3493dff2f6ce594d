"""Mechanisms that a description already has, in the chain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter, lfilter_zi

from sim.chain.model import Array, Chain, with_shaft
from sim.description.axis import Axis
from sim.investigation.data.preprocessing import Measurement
from sim.mechanisms import StructuralResonance
from sim.mechanisms.friction.friction_asymmetry import shared_halves

Response = NDArray[np.complex128]


def swing(m: Measurement, inertia_kg_m2: float, share: float, frequency_hz: float, damping_ratio: float) -> Array:
    """Torque that a part of the load on a spring of its own needs beyond that of its mass [N m], shape (n,).

    share J (H(s) - 1) theta'' with H = (w^2 + 2 d w s) / (s^2 + 2 d w s + w^2): Den Hartog, Mechanical Vibrations, 3.2.
    Settled when the record begins, which may be in the middle of a stroke.
    """
    if m.load_speed is None:
        return np.zeros(m.samples)
    w = 2.0 * math.pi * frequency_hz
    digital = bilinear([-1.0, 0.0, 0.0], [1.0, 2.0 * damping_ratio * w, w * w], m.rate_hz)
    acceleration = np.gradient(m.load_speed) * m.rate_hz
    first = float(acceleration[: max(1, round(m.rate_hz / frequency_hz))].mean())
    moved, _ = lfilter(*digital, acceleration, zi=first * lfilter_zi(*digital))
    return np.asarray(share * inertia_kg_m2 * moved)


def swing_response(s: Response, share: float, frequency_hz: float, damping_ratio: float) -> Response:
    """The same per angle and inertia of the load [1/s^2], at places `s` on the imaginary axis [rad/s], shape (k,)."""
    w = 2.0 * math.pi * frequency_hz
    return np.asarray(-share * s**4 / (s * s + 2.0 * damping_ratio * w * s + w * w))


def lopsided(chain: Chain, location: str | None, coulomb_n_m: float, viscous_n_m_s: float) -> Chain:
    """Friction that is larger forward and smaller backward, by as much at the motor; no location: of motor and load.

    There each has its share of it, as it has of the friction that the motor feels.
    """
    shared = location is None and bool(chain.links)
    ends = (0, len(chain.shafts) - 1) if shared else (0,)
    present = [(chain.shafts[k].coulomb_n_m, chain.shafts[k].viscous_n_m_s) for k in ends]
    felt = (1.0, 1.0 / chain.ratio)[: len(ends)]
    halves = shared_halves(coulomb_n_m, viscous_n_m_s, present, felt)
    for k, (dry, viscous), (c, v) in zip(ends, present, halves, strict=True):
        chain = with_shaft(
            chain, k, coulomb_n_m=dry + c, coulomb_backward_n_m=dry - c,
            viscous_n_m_s=viscous + v, viscous_backward_n_m_s=viscous - v,
        )  # fmt: skip
    return chain


def swinging(axis: Axis, m: Measurement) -> Array:
    """Torque that all that is described to swing needs at the load [N m], shape (n,)."""
    out = np.zeros(m.samples)
    for entry in axis.mechanisms:
        if entry.name == StructuralResonance.name:
            p = entry.parameters
            out += swing(m, axis.load.inertia_kg_m2, p["share"], p["frequency_hz"], p.get("damping_ratio", 0.02))
    return out
