"""Terms that this axis and these channels allow, one for every mechanism and place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim import mechanisms
from sim.chain.model import Chain
from sim.description.axis import Axis
from sim.investigation.data.angle_series import errors_over
from sim.investigation.data.excitation import excitation_of
from sim.investigation.data.plausibility import LEAST_TURN
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.hypotheses.friction import asymmetry, friction_felt, friction_terms, stribeck
from sim.investigation.hypotheses.gear_mesh import MOTOR, kinematic_terms, link_terms, ripple
from sim.investigation.hypotheses.generic import ORDERS as RIPPLE_ORDERS
from sim.investigation.hypotheses.generic import terms_of_catalogue
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.hypotheses.identifiability import highest_order, lowest_order, that_show
from sim.investigation.hypotheses.sensors import HIGHEST_HUM, HUM_HZ, delay, encoder_error, hum, offset
from sim.investigation.hypotheses.structure import gravity, resonance, weight
from sim.investigation.model.nominal import (
    has_links,
    stages_of,
)

MOST_OF_SPEED = 0.4  # largest of the speeds at which low-speed friction has fallen


def twist_range(axis: Axis, m: Measurement) -> float | None:
    """Range of the twist at the load that both encoders show [rad], None without a load encoder.

    Of the angles that drive the chain: noise of the encoders is no twist. Nor is what they differ by over the angle:
    which flank carries hangs on where the load is pushed, and an error of gear or encoder on where it is.
    """
    if m.slow_load_angle is None:
        return None
    seen = m.load_valid > 0.5
    angle = m.slow_load_angle[seen]
    twist = m.slow_angle[seen] / axis.ratio - angle
    errors = np.stack([np.ones(angle.size), *errors_over(angle)], axis=1)
    return float(np.ptp(twist - errors @ np.linalg.lstsq(errors, twist, rcond=None)[0]))


def speed_within_a_row(m: Measurement) -> float:
    """Speed that the motor gains at a reversal within the two rows over which its torque is smoothed [rad/s]."""
    turns_back = np.flatnonzero(np.diff(np.sign(m.speed)))
    if not turns_back.size:
        return 0.0
    return 2.0 / m.rate_hz * float(np.median(np.abs(m.slow_acceleration[turns_back])))


def terms_of(axis: Axis, measurement: Measurement, present: Chain) -> tuple[Term, ...]:
    """Those of `all_terms_of` that this record can show; of those that are the same in it the first alone."""
    return tuple(that_show(axis, measurement, all_terms_of(axis, measurement, present)))


def torque_carried(axis: Axis, m: Measurement) -> float:
    """Effective torque that the gears carry, as felt at the motor [N m]: what the motor's own inertia takes away is
    none of it, and may be nearly all of the motor's torque."""
    own = m.torque - axis.motor.inertia_kg_m2 * m.slow_acceleration
    return min(m.torque_rms, float(np.sqrt(np.mean(own**2))))


def shown_despite_doubts(weight: Term, m: Measurement, ratio: float) -> Term:
    """A weight matters where it is more than what the masses of a described body may be off by, as felt at the load."""
    doubted = math.sqrt(float(np.mean(np.sum(m.doubts**2, axis=1)))) * ratio if m.doubts.size else 0.0
    return replace(weight, size=max(weight.size, doubted))


def all_terms_of(axis: Axis, measurement: Measurement, present: Chain) -> tuple[Term, ...]:
    """Every mechanism of the telemetry at every place where the description lacks it; tooth damage is scanned apart.

    `present`: the model so far; friction can rise at low speed only where there is dry friction.
    """
    level, peak = measurement.torque_rms, float(np.abs(measurement.torque).max())
    top = float(np.abs(measurement.speed).max())
    out = [*friction_terms(axis, level, top, measurement), offset(level, peak)]
    if any(shaft.coulomb_n_m > 0.0 for shaft in present.shafts):
        seen = speed_within_a_row(measurement)
        out += [stribeck(level, top, seen)] if seen < MOST_OF_SPEED * top else []
    if all(shaft.coulomb_backward_n_m is None for shaft in present.shafts):
        seen_apart = has_links(axis) and measurement.load_angle is not None
        most = friction_felt(present, top)
        places = ((MOTOR, None) if seen_apart else (MOTOR,)) if most > 0.0 else ()
        out += [asymmetry(level, top, most, place) for place in places]
    travel = float(np.ptp(measurement.angle))
    excited = excitation_of(measurement)
    lowest = lowest_order(excited, doubted=measurement.doubts.size > 0)
    out += [ripple(order, level, axis, present) for order in RIPPLE_ORDERS if order >= lowest]
    out += [hum(frequency, level) for frequency in HUM_HZ if frequency < HIGHEST_HUM * measurement.rate_hz]
    half = 0.5 / measurement.rate_hz  # channels of a log are read one after the other
    if not measurement.doubts.size:  # late friction looks as if it built up over a way: of all joints' torques together
        out.append(delay("torque_delay_s", "motor", max(6e-4, half)))
    if has_links(axis):
        twist, carried = twist_range(axis, measurement), torque_carried(axis, measurement)
        out += [term for k in range(len(stages_of(axis))) for term in link_terms(axis, k, level, carried, twist)]
        fastest = highest_order(excited)
        out += [term for k in range(len(stages_of(axis))) for term in kinematic_terms(axis, k, level, fastest)]
        if travel / axis.ratio > LEAST_TURN:
            out.append(
                shown_despite_doubts(gravity(0.05 * level * axis.ratio, len(stages_of(axis))), measurement, axis.ratio)
            )
        if measurement.load_angle is not None:
            out.append(encoder_error(axis))
            out.append(delay("load_delay_s", "load", max(4e-4, half)))
            out.append(resonance(axis))
    elif travel / measurement.gear > LEAST_TURN:
        out.append(shown_despite_doubts(weight(0.05 * level * measurement.gear), measurement, measurement.gear))
    known = (term for term in out if term.mechanism in mechanisms.MECHANISMS)
    return (*known, *terms_of_catalogue(axis, measurement))
