"""Terms that this axis and these channels allow, one for every mechanism and place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim import mechanisms
from sim.chain.model import Chain, with_shaft
from sim.description.axis import Axis
from sim.investigation.data.excitation import errors_over, excitation_of
from sim.investigation.data.plausibility import LEAST_TURN
from sim.investigation.data.preprocessing import LOAD_CUT_HZ, Array, Measurement
from sim.investigation.hypotheses.friction import asymmetry, friction_felt, friction_terms, stribeck
from sim.investigation.hypotheses.gear_mesh import MOTOR, kinematic_terms, link_terms, ripple
from sim.investigation.hypotheses.generic import ORDERS as RIPPLE_ORDERS
from sim.investigation.hypotheses.generic import terms_of_catalogue
from sim.investigation.hypotheses.hypothesis import (
    AS_NEW_FACTOR,
    ENCODER_ERROR,
    Term,
    amplitude,
    cosine_and_sine,
    cosine_and_sine_probe,
    parameter_key,
    unchanged,
)
from sim.investigation.hypotheses.identifiability import HIGHEST_HUM, HUM_HZ, highest_order, lowest_order, that_show
from sim.investigation.model.effects import swing, swing_response
from sim.investigation.model.nominal import (
    has_links,
    locked_mode_hz,
    stages_of,
)
from sim.investigation.model.parameters import Owner, Parameter, Values
from sim.mechanisms import (
    ElectricalHum,
    EncoderError,
    GravityImbalance,
    StructuralResonance,
    TimeDelay,
    TorqueGain,
    TorqueOffset,
)

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


LATEST_S = 0.02  # what wants to be later is no delay
EDGE_S = 0.1  # over which a factor changes
HUM_SHARE = 0.003  # of the torque: less hum does not matter


def offset(level: float, peak: float = math.inf) -> Term:
    """Of the torque channel; `level`: rms of the torque, `peak`: the largest of it [N m].

    What wants to be larger than all that was measured is no offset: it stands against something else.
    """
    name, step = "offset_n_m", 0.01 * level
    return Term(
        TorqueOffset.name, "motor", (Parameter(name, 0.0, step, low=-peak, high=peak, unit="N m"),), (({name: step},),),
        lambda v: {"torque_n_m": v[name]}, replaces=(name,), size=0.5 * step,
        magnitude=lambda v: v[name] if abs(v[name]) < 0.99 * peak else 0.0,
    )  # fmt: skip


def delay(name: str, location: str, size: float) -> Term:
    parameters = (Parameter(name, 0.0, 0.2 * size, low=-LATEST_S, high=LATEST_S, unit="s"),)
    return Term(
        TimeDelay.name, location, parameters, (({name: size},), ({name: -size},)), lambda v: {"delay_s": v[name]},
        replaces=(name,), size=size, magnitude=lambda v: v[name] if abs(v[name]) < 0.99 * LATEST_S else 0.0,
    )  # fmt: skip


def gain(level: float, duration_s: float, start_s: float, end_s: float, among: int) -> Term:
    """The torque channel read by another factor between two times, which a fit may move.

    `level`: usual share [1]; `among`: windows of which this one was picked. The factor turns over `EDGE_S`, so that
    what is left has a slope over either time.
    """
    share, start, end = (parameter_key(TorqueGain.name, "motor", p.name) for p in TorqueGain.parameters)

    def torque(m: Measurement, values: Values) -> Array:
        since, until = ((m.time_s - values[name]) / EDGE_S for name in (start, end))
        factor = values[share] * 0.5 * (np.tanh(since) - np.tanh(until))
        return np.asarray(m.torque * factor / (1.0 + factor))

    numbers = TorqueGain.parameters[0]
    parameters = (
        Parameter(share, 0.0, 0.1 * level, low=numbers.low, high=numbers.high),
        Parameter(start, start_s, 0.5 * EDGE_S, low=0.0, high=duration_s, unit="s"),
        Parameter(end, end_s, 0.5 * EDGE_S, low=0.0, high=duration_s, unit="s"),
    )
    return Term(
        TorqueGain.name, "motor", parameters, (({share: level},),),
        lambda v: {"share": v[share], "start_s": v[start], "end_s": v[end]},
        torque=torque, shape=(start, end), size=0.5 * level, among=among,
        magnitude=lambda v: v[share] if abs(v[share]) < 0.99 * numbers.high else 0.0,
    )  # fmt: skip


def hum(frequency: float, level: float) -> Term:
    """Hum of the mains in the torque channel at a frequency [Hz]; `level`: rms of the torque [N m], for its step."""
    prefix = f"{ElectricalHum.name}{frequency:g}@motor"
    step = 0.01 * level

    def torque(m: Measurement, values: Values) -> Array:
        turn = 2.0 * np.pi * frequency * m.time_s
        return values[f"{prefix}.sine"] * np.sin(turn) + values[f"{prefix}.cosine"] * np.cos(turn)

    def report(values: Values) -> dict[str, float]:
        sine, cosine = values[f"{prefix}.sine"], values[f"{prefix}.cosine"]
        return {
            "torque_n_m": math.hypot(sine, cosine),
            "frequency_hz": frequency,
            "phase_rad": math.atan2(cosine, sine),
        }

    waves = tuple(replace(p, owner=Owner.MOTION) for p in cosine_and_sine(prefix, step, "N m"))
    return Term(
        ElectricalHum.name, "motor", waves, cosine_and_sine_probe(prefix, step), report,
        torque=torque, size=HUM_SHARE * level, frequency_hz=frequency,
    )  # fmt: skip


def encoder_error(axis: Axis) -> Term:
    names = ENCODER_ERROR
    step = max(axis.load_encoder.error_rad, 1e-5)
    parameters = tuple(Parameter(name, 0.0, step, unit="rad") for name in names)
    probes = (tuple({name: 2.0 * AS_NEW_FACTOR * step} for name in names),)
    report = amplitude(parameters, "amplitude_rad", "phase_rad")
    return Term(EncoderError.name, "load", parameters, probes, report, replaces=names, size=AS_NEW_FACTOR * step)


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
