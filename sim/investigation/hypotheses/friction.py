"""Hypotheses about friction: Stribeck's, one that differs by direction, one that drifts."""

from __future__ import annotations

from itertools import zip_longest

import numpy as np

from sim.chain.model import Chain, with_shaft
from sim.description.axis import Axis
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.hypotheses.hypothesis import Term, parameter_key
from sim.investigation.model.effects import lopsided
from sim.investigation.model.nominal import (
    has_links,
    stages_of,
    turning_over,
    turning_width,
)
from sim.investigation.model.parameters import Parameter, Values
from sim.mechanisms import CoulombFriction, FrictionAsymmetry, FrictionDrift, StribeckFriction, ViscousFriction
from sim.mechanisms.mechanism import Mechanism

MOST_DRIFT = 1.0  # of friction, within a record


def friction_terms(axis: Axis, level: float, top: float, m: Measurement) -> list[Term]:
    """Dry and viscous friction where the description has none of it, and friction that drifts."""
    out = []
    n = len(stages_of(axis)) if has_links(axis) else 0
    at_load = n > 0
    scale = axis.ratio if at_load else 1.0
    motor, load = axis.motor, axis.load
    if not (motor.coulomb_friction_n_m or load.coulomb_friction_n_m):
        brings = turning_over(of_joint=not n and m.doubts.size > 0)
        out.append(_both(CoulombFriction, "coulomb_n_m", 0.05 * level, scale, n, brings))
    if not (motor.viscous_friction_n_m_s_per_rad or load.viscous_friction_n_m_s_per_rad):
        step = 0.05 * level / top
        out.append(_both(ViscousFriction, "viscous_n_m_s", step, scale * scale, n))
    out.append(_drift(n, float(m.time_s[-1])))
    return out


def friction_key(kind: type[Mechanism], end: str) -> str:
    """How dry or viscous friction at one end is called where the description has none of it."""
    return parameter_key(kind.name, None, end)


def _both(
    kind: type[Mechanism], field: str, step: float, scale: float, n: int, brings: tuple[Parameter, ...] = ()
) -> Term:
    """Friction at the motor and, behind gears, at the load; reported as felt at the motor. All of it matters: a
    description without any leaves it out."""
    names = [friction_key(kind, end) for end in (("motor", "load") if n else ("motor",))]
    sizes = [step, step * scale][: len(names)]

    def apply(chain: Chain, values: Values) -> Chain:
        for index, name in zip((0, n), names, strict=False):
            present = getattr(chain.shafts[index], field)
            chain = with_shaft(chain, index, **{field: present + values[name]})
        return chain

    def report(values: Values) -> dict[str, float]:
        return {kind.size: values[names[0]] + (values[names[1]] / scale if n else 0.0)}

    unit = kind.parameters[0].unit
    numbers = zip(names, sizes, strict=True)
    parameters = tuple(Parameter(name, 0.0, 0.05 * size, low=0.0, unit=unit) for name, size in numbers)
    probes = (tuple({name: size} for name, size in zip(names, sizes, strict=True)),)
    return Term(kind.name, None if n else "motor", parameters, probes, report, apply, size=0.0, brings=brings)


def stribeck(level: float, top: float, seen: float = 0.0) -> Term:
    """It falls with an exponent between 1 and 2 (Armstrong-Helouvry et al., Automatica 30 (1994) 1083).

    As large as dry friction is above what it has fallen to at the largest speed `top` [rad/s]: beside dry friction that
    turns over a wide range a large law of a small speed only bends it, and nothing falls. `seen`: speed that a motor
    which turns back gains within the rows over which torque is smoothed [rad/s]; what has fallen by then does not show.
    """
    names = ("torque_n_m", "speed_rad_s", "exponent")
    torque, speed, exponent = (parameter_key(StribeckFriction.name, "motor", p) for p in names)

    def apply(chain: Chain, values: Values) -> Chain:
        law = {"stribeck_speed_rad_s": values[speed], "stribeck_exponent": values[exponent]}
        return with_shaft(chain, 0, stribeck_n_m=values[torque], **law)

    def report(values: Values) -> dict[str, float]:
        return {"torque_n_m": values[torque], "speed_rad_s": values[speed], "exponent": values[exponent]}

    def fallen(values: Values) -> float:
        if values[speed] <= 1.01 * seen:
            return 0.0
        dry = sum(
            values.get(name, 0.0) for name in ("motor.coulomb_friction_n_m", friction_key(CoulombFriction, "motor"))
        )
        rises = values[torque] * np.exp(-((along / values[speed]) ** values[exponent]))
        felt = np.tanh(along / turning_width(values) / top) * (dry + rises)
        return float(felt.max() - felt[-1])

    along = top * np.geomspace(1e-3, 1.0, 64)
    step = 0.05 * level
    parameters = (
        Parameter(torque, 0.0, 0.3 * step, low=0.0, unit="N m"),
        Parameter(speed, max(0.07 * top, seen), 0.007 * top, 0.2 * top, max(0.01 * top, seen), 0.4 * top, unit="rad/s"),
        Parameter(exponent, 1.5, 0.05, 0.5, 1.0, 2.0),
    )
    probes = tuple(({torque: step, speed: max(share * top, seen)},) for share in (0.03, 0.08, 0.2))
    return Term(
        StribeckFriction.name, "motor", parameters, probes, report, apply, positive=True, size=0.1 * step,
        shape=(speed, exponent), magnitude=fallen,
    )  # fmt: skip


def friction_felt(chain: Chain, speed: float) -> float:
    """All friction while the motor turns at `speed` [rad/s], as felt at the motor [N m]."""
    ratio, felt = 1.0, 0.0
    for shaft, link in zip_longest(chain.shafts, chain.links):
        felt += (shaft.coulomb_n_m + shaft.viscous_n_m_s * speed / ratio) / ratio
        ratio *= link.ratio if link else 1.0
    return felt


def asymmetry(level: float, top: float, most: float, location: str | None) -> Term:
    """Of the motor's friction, or of motor's and load's alike.

    No more than `most`, all friction that there is: none pushes. What wants that limit is no asymmetry.
    """
    coulomb, viscous = (parameter_key(FrictionAsymmetry.name, location, p) for p in ("coulomb", "viscous"))

    def apply(chain: Chain, values: Values) -> Chain:
        return lopsided(chain, location, values[coulomb], values[viscous])

    def report(values: Values) -> dict[str, float]:
        return {"torque_n_m": values[coulomb], "coefficient_n_m_s_per_rad": values[viscous]}

    def magnitude(values: Values) -> float:
        if abs(values[coulomb]) > 0.99 * most:
            return 0.0
        return max(abs(values[coulomb] + share * top * values[viscous]) for share in (0.3, 1.0))

    step = 0.03 * level
    parameters = (
        Parameter(coulomb, 0.0, step, low=-most, high=most, unit="N m"),
        Parameter(viscous, 0.0, step / top, unit="N m s/rad"),
    )
    probes = (({viscous: step / top},), ({coulomb: step}, {viscous: step / top}))
    return Term(
        FrictionAsymmetry.name, location, parameters, probes, report, apply, size=0.1 * step, magnitude=magnitude
    )


def _drift(n: int, duration: float) -> Term:
    """Friction that changes by as much as there is of it is no oil that warms up: what wants the limit is none."""
    rate, most = parameter_key(FrictionDrift.name, None, "rate_per_s"), MOST_DRIFT / duration

    def apply(chain: Chain, values: Values) -> Chain:
        for index in {0, n}:
            chain = with_shaft(chain, index, drift_per_s=values[rate])
        return chain

    step = 0.1 / duration
    return Term(
        FrictionDrift.name, None, (Parameter(rate, 0.0, step, low=-most, high=most, unit="1/s"),), (({rate: step},),),
        lambda v: {"rate_per_s": v[rate]}, apply, size=0.3 * step,
        magnitude=lambda v: v[rate] if abs(v[rate]) < 0.99 * most else 0.0,
    )  # fmt: skip
