"""Hypotheses about the structure that carries the axis: gravity and a resonance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim.chain.model import Chain, with_shaft
from sim.description.axis import Axis
from sim.investigation.data.preprocessing import LOAD_CUT_HZ, Array, Measurement
from sim.investigation.hypotheses.harmonics import amplitude, cosine_and_sine, parameter_key
from sim.investigation.hypotheses.hypothesis import Term, unchanged
from sim.investigation.model.effects import swing, swing_response
from sim.investigation.model.nominal import (
    locked_mode_hz,
)
from sim.investigation.model.parameters import Parameter, Values
from sim.mechanisms import GravityImbalance, StructuralResonance

SOFTEST = 0.1  # damping ratio from which nothing swings: what is late or wrong in form asks for more
LEAST_PEAK = 0.5  # torque of a part that swings at its own frequency over that of the whole load, where damped by SHARP
SHARP = 0.035  # damping ratio; softer parts count less: of 45 good loads none that seems sharp gains enough to matter
HIGHEST_SWING_HZ = 0.6 * LOAD_CUT_HZ


def gravity(step: float, shaft: int) -> Term:
    pair = cosine_and_sine(f"{GravityImbalance.name}@load", step, "N m")
    sine, cosine = (p.name for p in pair)

    def apply(chain: Chain, values: Values) -> Chain:
        size, phase = math.hypot(values[sine], values[cosine]), math.atan2(values[cosine], values[sine])
        return with_shaft(chain, shaft, gravity_n_m=size, gravity_phase_rad=phase)

    probes = (tuple({p.name: step} for p in pair),)
    report = amplitude(pair, "torque_n_m", "phase_rad")
    return Term(GravityImbalance.name, "load", pair, probes, report, apply, size=0.05 * step)


def weight(step: float) -> Term:
    """The same of one body at its motor, over the angle of what that moves and felt there."""
    term = gravity(step, 0)
    sine, cosine = (p.name for p in term.parameters)

    def torque(m: Measurement, values: Values) -> Array:
        angle = m.angle / m.gear
        return np.asarray((values[sine] * np.sin(angle) + values[cosine] * np.cos(angle)) / m.gear)

    return replace(term, apply=unchanged, torque=torque)


def resonance(axis: Axis) -> Term:
    """A part of the load that swings on a spring of its own, where the load's motion is known well enough."""
    names = [parameter_key(StructuralResonance.name, "load", p) for p in ("share", "frequency_hz", "damping_ratio")]
    share, frequency, damping = names
    mode = locked_mode_hz(axis)
    start = min(mode, 0.8 * HIGHEST_SWING_HZ)

    def torque(m: Measurement, values: Values) -> Array:
        return -swing(m, axis.load.inertia_kg_m2, *(values[name] for name in names))

    parameters = (
        Parameter(share, 0.0, 0.005, low=0.0, high=1.0),
        Parameter(frequency, start, 0.003 * start, low=0.3 * start, high=HIGHEST_SWING_HZ, unit="Hz"),
        Parameter(damping, 0.02, 0.002, 0.02, 0.002, SOFTEST),
    )
    grid = np.geomspace(0.5 * start, min(2.0 * mode, HIGHEST_SWING_HZ), 24)
    probes = tuple(({share: 0.02, frequency: float(f)},) for f in grid)
    return Term(
        StructuralResonance.name, "load", parameters, probes,
        lambda v: {"frequency_hz": v[frequency], "share": v[share], "damping_ratio": v[damping]},
        load_torque=torque, positive=True, nonlinear=True,
        response=lambda s, v: swing_response(s, v[share], v[frequency], v[damping]),
        size=LEAST_PEAK, shape=(frequency, damping),
        magnitude=lambda v: v[share] / (2.0 * v[damping]) * SHARP / v[damping] if v[damping] < SOFTEST else 0.0,
    )  # fmt: skip
